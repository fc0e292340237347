"""The panel beside a window that fills the screen, with long names, in the preview interpreter.

small_session.py ASSET FOLDER: FOLDER holds scene.usda. Prints a JSON object with what was seen.
"""

import json
import os
import sys
from pathlib import Path

from session import Api, load

# isort: split
from pxr import Usd  # session has found it
from PySide6 import QtCore, QtTest, QtWidgets


def cut_widgets(panel):
    """Texts that have less room than they need, and what stands out of the panel's width."""
    kinds = (QtWidgets.QLabel, QtWidgets.QAbstractButton, QtWidgets.QAbstractSpinBox)
    widgets = [widget for kind in kinds for widget in panel.findChildren(kind) if widget.isVisible()]
    cut = [widget for widget in widgets if widget.width() < widget.minimumSizeHint().width()]
    right = panel.scroll_area.viewport().width()
    beyond = [
        widget
        for widget in widgets
        if panel.content.isAncestorOf(widget)
        and widget.mapTo(panel.content, QtCore.QPoint(widget.width(), 0)).x() > right
    ]
    return [f"{type(widget).__name__} {widget.text()}" for widget in (*cut, *beyond)]


def turn_wheel(application, dock, box):
    """Turn the wheel over a box that nobody has clicked."""
    place = box.mapTo(dock, box.rect().center())
    QtTest.QTest.wheelEvent(dock.windowHandle(), QtCore.QPointF(place), QtCore.QPoint(0, -120))
    application.processEvents()


def main(folder):
    application = QtWidgets.QApplication(["usdview"])
    stage, window, seen = Usd.Stage.Open(str(Path(folder) / "scene.usda")), QtWidgets.QMainWindow(), {}
    central = QtWidgets.QWidget()
    central.setMinimumSize(window.screen().availableGeometry().width() - 20, 300)  # usdview needs 631 of 640
    window.setCentralWidget(central)
    window.show()
    api = Api(stage, window)
    load(api).commands["FoliageContainer.panel"].run()
    application.processEvents()
    dock = window.findChild(QtWidgets.QDockWidget, "usdviewFoliage")
    panel = dock.widget()
    screen = window.screen().availableGeometry()
    seen["on_screen"] = screen.contains(dock.geometry()) and dock.isFloating()
    dock.resize(dock.minimumSizeHint().width(), 300)
    application.processEvents()
    seen["size"] = [dock.minimumSizeHint().width(), dock.minimumSizeHint().height()]
    seen["cut"] = cut_widgets(panel)
    seen["sideways"] = panel.scroll_area.horizontalScrollBar().maximum()
    seen["tip"] = panel.plant_box.toolTip()
    box, bar = panel.sliders.boxes["Shape", "width"], panel.scroll_area.verticalScrollBar()
    panel.scroll_area.ensureWidgetVisible(box)
    before = [box.value(), bar.value()]
    turn_wheel(application, dock, box)
    seen["wheel"] = [box.value() == before[0], bar.value() > before[1]]
    bar.setValue(bar.maximum())
    last = panel.sliders.sliders["Curl", "silhouette"]
    seen["reached"] = last.mapTo(panel.content, QtCore.QPoint(0, 0)).y() < bar.maximum() + 300
    print(json.dumps(seen))
    sys.stdout.flush()
    os._exit(0)  # Blender's clean-up may crash


if __name__ == "__main__":
    main(sys.argv[2])
