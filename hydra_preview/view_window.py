"""The viewer's window: Storm's view, and beside it the panel that stands in usdview too."""

from captured import show_cameras
from PySide6 import QtCore, QtGui, QtWidgets
from storm_view import StormView
from usdviewFoliage.panel import FoliagePanel
from usdviewFoliage.product import Product

PANEL_WIDTH_PX = 340


class ViewerHost:
    """The window, as the panel sees it."""

    def __init__(self, window: "ViewWindow", view: StormView, product: Product, leaf_file: str) -> None:
        self._window, self._view = window, view
        self.product = product
        self.leaf_file = leaf_file

    @property
    def stage(self):
        return self._view.stage

    def redraw(self) -> None:
        self._view.update()

    def draw_guides(self, visible: bool) -> None:
        self._window.purpose_actions["guide"].setChecked(visible)

    def draw_cameras(self, visible: bool) -> None:
        show_cameras(self._view.stage, visible)

    def drag(self, pressed: bool) -> None:
        self._view.draw_coarsely(pressed)

    def show_message(self, text: str) -> None:
        self._window.statusBar().showMessage(text)


class ViewWindow(QtWidgets.QMainWindow):
    """One asset, its variants, its purposes, its leaves."""

    def __init__(self, stage, request: dict, product: Product) -> None:
        super().__init__()
        self.setWindowTitle(f"{request['title']} – usdfoliage")
        self.stage = stage
        self.view = StormView(stage, request["dome_texture"])
        self.setCentralWidget(self.view)
        self._look = request["look"]
        self._add_actions()
        self.panel = FoliagePanel(ViewerHost(self, self.view, product, request["look"]))
        dock = QtWidgets.QDockWidget("Foliage")
        dock.setObjectName("foliage")
        dock.setWidget(self.panel)
        dock.setFeatures(QtWidgets.QDockWidget.DockWidgetMovable | QtWidgets.QDockWidget.DockWidgetFloatable)
        self.addDockWidget(QtCore.Qt.RightDockWidgetArea, dock)
        self.resizeDocks([dock], [PANEL_WIDTH_PX], QtCore.Qt.Horizontal)
        self.resize(request["width_px"], request["height_px"])
        self.statusBar().showMessage("Drag: left orbits, middle pans, right or wheel zooms; F frames all")

    def _add_actions(self) -> None:
        bar = self.addToolBar("View")
        bar.setObjectName("view")
        frame = bar.addAction("Frame all", self.view.frame_all)
        frame.setShortcut(QtGui.QKeySequence("F"))
        picture = bar.addAction("Save picture…", self._ask_and_save)
        picture.setShortcut(QtGui.QKeySequence("Ctrl+P"))
        bar.addSeparator()
        self.purpose_actions = {}
        for name, visible in self.view.purposes.items():
            action = bar.addAction(name)
            action.setToolTip(f"Draw what has the purpose {name}")
            action.setCheckable(True)
            action.setChecked(visible)
            action.toggled.connect(lambda on, name=name: self.view.show_purpose(name, on))
            self.purpose_actions[name] = action
        bar.addSeparator()
        self.look_action = bar.addAction("look")
        self.look_action.setToolTip("Show the look that was opened, or mute it")
        self.look_action.setCheckable(True)
        self.look_action.setChecked(True)
        self.look_action.setVisible(bool(self._look))
        self.look_action.toggled.connect(self.show_look)

        if self.stage.HasAuthoredTimeCodeRange():
            bar.addSeparator()
            bar.addWidget(QtWidgets.QLabel("frame "))
            self.frame_box = QtWidgets.QSpinBox()
            self.frame_box.setToolTip("Of what moves: growth, sway")
            self.frame_box.setRange(round(self.stage.GetStartTimeCode()), round(self.stage.GetEndTimeCode()))
            self.frame_box.valueChanged.connect(self.view.show_time)
            bar.addWidget(self.frame_box)

    def show_look(self, visible: bool) -> None:
        """Mute the look that was opened, or show it again; edits that were made over it stay."""
        (self.stage.UnmuteLayer if visible else self.stage.MuteLayer)(self._look)
        self.panel.refresh()

    def save_picture(self, path: str) -> None:
        """Write what the view shows. ValueError where it cannot be written."""
        if not self.view.grabFramebuffer().save(path):
            raise ValueError(f"{path} cannot be written; its name must end in .png or .jpg, in a folder that is there")
        self.statusBar().showMessage(f"picture: {path}")

    def _ask_and_save(self) -> None:
        path, _ = QtWidgets.QFileDialog.getSaveFileName(self, "Save picture", "picture.png", "Pictures (*.png *.jpg)")
        if not path:
            return
        try:
            self.save_picture(path)
        except ValueError as error:
            QtWidgets.QMessageBox.warning(self, "Save picture", str(error))
