"""The menu Foliage of usdview."""

from pxr import Tf
from pxr.Usdviewq.plugin import PluginContainer


class FoliageContainer(PluginContainer):
    """Commands are imported when the first one runs, so that usdview starts as fast as without."""

    def registerPlugins(self, plugRegistry, usdviewApi) -> None:
        del usdviewApi  # commands are given it when they run
        commands = self.deferredImport("usdviewFoliage.commands")

        def register(name: str, label: str, callback, tip: str):
            return plugRegistry.registerCommandPlugin(f"FoliageContainer.{name}", label, callback, tip)

        self._panel = register("panel", "Leaf edits…", commands.open_panel, "Sliders that edit all leaves of an asset")
        self._save = register("save", "Save edits as look…", commands.save_look, "Write the edits as a layer")
        self._reset = register("reset", "Reset edits", commands.reset_edits, "Take all edits back")
        self._representations = [
            register(f"representation.{name}", name, _with(commands.select, "representation", name), tip)
            for name, tip in (
                ("bezier", "The leaves that edits act on"),
                ("nurbs", "One exact patch a leaf"),
                ("subdiv", "One subdivision surface"),
                ("mesh", "One polygon mesh"),
            )
        ]
        self._lods = [
            register(f"lod.{name}", name, _with(commands.select, "lod", name), tip)
            for name, tip in (
                ("leaves", "Leaves and branches"),
                ("both", "Leaves and branches, and the crown as proxy"),
                ("crown", "The crown alone"),
                ("auto", "Leaves and branches near, the crown far away"),
            )
        ]
        self._guides = [
            register(f"guide.{name}", f"Show {name.lower()}", _with(commands.toggle_guide, name), tip)
            for name, tip in (
                ("Skeleton", "Axes of the branches"),
                ("Cloud", "Points of the capture"),
                ("Cameras", "Where photographs were taken"),
            )
        ]

    def configureView(self, plugRegistry, plugUIBuilder) -> None:
        del plugRegistry
        menu = plugUIBuilder.findOrCreateMenu("Foliage")
        for title, commands in (("Representation", self._representations), ("Level of detail", self._lods)):
            submenu = menu.findOrCreateSubmenu(title)
            for command in commands:
                submenu.addItem(command)
        menu.addSeparator()
        for command in self._guides:
            menu.addItem(command)
        menu.addSeparator()
        for command in (self._panel, self._reset, self._save):
            menu.addItem(command)


def _with(command, *words: str):
    """A command of usdview: it is called with the usdviewApi."""
    return lambda usdviewApi: command(usdviewApi, *words)


Tf.Type.Define(FoliageContainer)
