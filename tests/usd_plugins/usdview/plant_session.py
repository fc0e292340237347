"""A session of usdview with a whole plant, in the preview interpreter: plant_session.py ASSET FOLDER.

Prints a JSON object with what was seen.
"""

import json
import os
import sys
from pathlib import Path

from session import Api, load

# isort: split
from pxr import Usd  # session has found it
from PySide6 import QtWidgets


def main(asset, folder):
    application = QtWidgets.QApplication(["usdview"])
    stage, window, seen = Usd.Stage.Open(asset), QtWidgets.QMainWindow(), {}
    api = Api(stage, window)
    commands = load(api).commands

    def run(name):
        commands[f"FoliageContainer.{name}"].run()
        application.processEvents()

    def width():
        leaves = stage.GetDefaultPrim().GetPath().AppendPath("geo/render/Leaves")
        attribute = stage.GetAttributeAtPath(leaves.AppendProperty("primvars:leaf:edit:width"))
        return attribute.Get() if attribute else None

    run("lod.crown")  # before anything looked at the leaves
    run("panel")
    panel = window.findChild(QtWidgets.QDockWidget, "usdviewFoliage").widget()
    box = panel.variant_boxes["lod"]
    seen["lods"] = [box.itemText(number) for number in range(box.count())]
    seen["crown"] = [panel.sliders.isEnabled(), panel.reason.text()]
    run("lod.both")
    seen["again"] = [panel.sliders.isEnabled(), panel.reason.text()]
    panel.sliders.boxes["Shape", "width"].setValue(1.5)
    panel.save(str(Path(folder) / "saved.usda"))
    seen["widths"] = {}
    for lod in seen["lods"]:
        run(f"lod.{lod}")
        seen["widths"][lod] = width()
    print(json.dumps(seen))
    sys.stdout.flush()
    os._exit(0)  # Blender's clean-up may crash


if __name__ == "__main__":
    main(*sys.argv[1:3])
