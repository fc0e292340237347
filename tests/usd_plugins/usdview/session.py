"""A session of what usdview does with the plug-in, in the preview interpreter: session.py ASSET FOLDER.

Prints a JSON object with what was seen.
"""

import json
import os
import sys
from pathlib import Path
from types import SimpleNamespace

import record

record.load_usd()
import pxr  # noqa: E402

pxr.__path__.append(str(Path(__file__).resolve().parent))  # pxr.Usdviewq

from pxr import Plug, Sdf, Tf, Usd, UsdGeom  # noqa: E402
from pxr.Usdviewq import plugin  # noqa: E402
from PySide6 import QtCore, QtWidgets  # noqa: E402

ROOT = Path(__file__).resolve().parents[3]


class DataModel(QtCore.QObject):
    """The rootDataModel, which also announces another stage."""

    signalStageReplaced = QtCore.Signal()

    def __init__(self):
        super().__init__()
        self.viewSettings = SimpleNamespace(displayGuide=False, displayCameraOracles=False)


class Api:
    """The usdviewApi."""

    def __init__(self, stage, window):
        self.stage, self.qMainWindow = stage, window
        self.dataModel = DataModel()
        self.messages, self.redrawn = [], 0

    def UpdateViewport(self):
        self.redrawn += 1

    def UpdateGUI(self):
        pass

    def PrintStatus(self, msg):
        self.messages.append(msg)


def load(api):
    """As usdview loads plug-ins; returns the registry of commands."""
    Plug.Registry().RegisterPlugins([str(ROOT / "usd_plugins" / "usdviewFoliage")])
    registry, builder = plugin.Registry(api), plugin.UIBuilder(api.qMainWindow)
    for kind in Plug.Registry.GetAllDerivedTypes(Tf.Type.Find(plugin.PluginContainer)):
        Plug.Registry().GetPluginForType(kind).Load()
        container = kind.pythonClass()
        container.registerPlugins(registry, api)
        container.configureView(registry, builder)
    return registry


def titles(menu):
    return {
        action.text(): titles(action.menu()) if action.menu() else None for action in menu.actions() if action.text()
    }


def reopen(api, window, asset, application):
    """What the panel does after Reopen Stage, and after 2,000 steps of a slider."""
    before = window.findChild(QtWidgets.QDockWidget, "usdviewFoliage").widget().host.product
    first, api.stage = api.stage, None
    api.dataModel.signalStageReplaced.emit()
    closed = window.findChild(QtWidgets.QDockWidget, "usdviewFoliage").widget() is None
    first.Reload()
    api.stage = Usd.Stage.Open(first.GetRootLayer(), Sdf.Layer.CreateAnonymous())
    api.dataModel.signalStageReplaced.emit()
    application.processEvents()
    panel = window.findChild(QtWidgets.QDockWidget, "usdviewFoliage").widget()
    leaves = api.stage.GetDefaultPrim().GetPath().AppendPath("geo/render/Leaves.primvars:leaf:edit:width")
    slider = panel.sliders.sliders["Shape", "width"]
    for step in range(2000):
        slider.setValue((37 * step) % 1000)
        if not step % 100:
            application.processEvents()
    panel.sliders.boxes["Shape", "width"].setValue(1.25)
    widths = [stage.GetAttributeAtPath(leaves).Get() for stage in (api.stage, first)]
    return {"closed": closed, "widths": widths, "same_product": panel.host.product is before}


def helpers():
    """How many processes this one has started that still run."""
    tasks = Path(f"/proc/{os.getpid()}/task").glob("*/children")
    return sum(len(children.read_text(encoding="ascii").split()) for children in tasks)


def main(asset, folder):
    application = QtWidgets.QApplication(["usdview"])
    stage, window, seen = Usd.Stage.Open(asset), QtWidgets.QMainWindow(), {}
    api = Api(stage, window)
    commands = load(api).commands
    (bar,) = window.menuBar().actions()
    seen["menus"] = {bar.text(): titles(bar.menu())}

    def run(name):
        commands[f"FoliageContainer.{name}"].run()
        application.processEvents()

    plant = stage.GetDefaultPrim()
    leaves = plant.GetPath().AppendPath("geo/render/Leaves")

    def selected(name):
        return plant.GetVariantSets().GetVariantSet(name).GetVariantSelection()

    def width():
        return stage.GetAttributeAtPath(leaves.AppendProperty("primvars:leaf:edit:width")).Get()

    run("representation.mesh")
    seen["mesh"] = [selected("representation"), stage.GetPrimAtPath(leaves).GetTypeName()]
    run("representation.bezier")
    run("lod.crown")
    seen["no_crown"] = [selected("lod"), api.messages[-1]]

    run("panel")
    dock = window.findChild(QtWidgets.QDockWidget, "usdviewFoliage")
    panel = dock.widget()
    seen["panel"] = not dock.isHidden()
    seen["sentence"] = panel.reason.text()
    seen["boxes"] = sorted(panel.variant_boxes)
    seen["product"] = api.messages and panel.host.product is not None
    seen["curves"] = len(panel.drawing.curves)
    redrawn = api.redrawn
    panel.sliders.boxes["Shape", "width"].setValue(1.5)
    panel.sliders.boxes["Shape", "bend"].setValue(0.25)
    panel.sliders.boxes["Jitter", "amplitude"].setValue(0.02)
    seen["edited"] = [width(), api.redrawn > redrawn]
    seen["extent"] = [list(corner) for corner in UsdGeom.Boundable(stage.GetPrimAtPath(leaves)).GetExtentAttr().Get()]
    panel.save(str(Path(folder) / "saved.usda"))
    seen["status"] = api.messages[-1]
    try:
        panel.save(str(Path(folder) / "saved.txt"))
    except Exception as error:  # noqa: BLE001
        seen["refused"] = str(error)
    panel.show_box.setChecked(False)
    seen["hidden"] = [width(), panel.sliders.boxes["Shape", "width"].value(), panel.reason.text()]
    panel.show_box.setChecked(True)
    seen["visible"] = [width(), panel.sliders.boxes["Shape", "width"].value(), panel.reason.text()]
    panel.variant_boxes["representation"].setCurrentText("subdiv")
    panel.variant_boxes["representation"].activated.emit(0)
    seen["subdiv"] = [selected("representation"), panel.sliders.isEnabled(), panel.reason.text()]
    run("representation.bezier")
    seen["back"] = [panel.sliders.isEnabled(), width()]
    run("reset")
    seen["reset"] = [width(), panel.sliders.boxes["Shape", "width"].value(), api.messages[-1]]

    panel.sliders.boxes["Shape", "width"].setValue(1.5)
    stage.GetSessionLayer().Export(str(Path(folder) / "overrides.usda"))  # what "Save Overrides As" writes
    run("reset")

    with Usd.EditContext(stage, stage.GetSessionLayer()):  # in another part of usdview
        plant.GetVariantSets().SetSelection("representation", "mesh")
    application.processEvents()
    seen["elsewhere"] = [panel.variant_boxes["representation"].currentText(), panel.sliders.isEnabled()]
    run("representation.bezier")

    stage.SetEditTarget(stage.GetSessionLayer())
    guide = UsdGeom.Scope.Define(stage, plant.GetPath().AppendPath("geo/guide/Skeleton"))
    panel.refresh()
    run("guide.Skeleton")
    seen["guide"] = [api.dataModel.viewSettings.displayGuide, guide.ComputeVisibility(), api.messages[-1]]
    run("guide.Skeleton")
    seen["no_guide"] = [api.dataModel.viewSettings.displayGuide, api.messages[-1]]
    run("guide.Cloud")
    seen["no_cloud"] = api.messages[-1]
    seen["untouched"] = not any(layer.dirty for layer in stage.GetUsedLayers() if not layer.anonymous)
    seen["again"] = reopen(api, window, asset, application)
    for _ in range(3):
        run("panel")
    seen["helpers"] = helpers()
    print(json.dumps(seen))
    sys.stdout.flush()
    os._exit(0)  # Blender's clean-up may crash


if __name__ == "__main__":
    main(*sys.argv[1:3])
