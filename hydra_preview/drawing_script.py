"""Actions of a script in the window of a photograph, by the mouse and the keys that a hand would use."""

import time
from pathlib import Path

from drawing_window import DrawingWindow
from PySide6 import QtCore, QtGui, QtWidgets
from view_script import BUTTONS, save_window, settle

PATIENCE_S = 900.0  # for what usdfoliage answers


def _wait(window: DrawingWindow, *, shows: bool = False) -> None:
    """Until all that was asked is answered; shows: or until the first shoots of a tree are drawn."""
    end = time.monotonic() + PATIENCE_S
    while window.link.waits and not (shows and window.view is not None):
        if time.monotonic() > end:
            raise ValueError(f"usdfoliage did not answer within {PATIENCE_S:g} s")
        QtWidgets.QApplication.processEvents(QtCore.QEventLoop.AllEvents, 20)
        time.sleep(0.005)
    if not shows:  # else the tree would go on growing
        settle(window)


def _mouse(window: DrawingWindow, kind, place: QtCore.QPointF, button, pressed) -> None:
    canvas = window.canvas
    event = QtGui.QMouseEvent(kind, place, canvas.mapToGlobal(place), button, pressed, QtCore.Qt.NoModifier)
    QtWidgets.QApplication.sendEvent(canvas, event)


def _stroke(window: DrawingWindow, stroke: dict) -> None:
    button = BUTTONS[stroke["button"]]
    places = [window.canvas.from_photo(x, y) for x, y in stroke["points"]]
    _mouse(window, QtCore.QEvent.MouseButtonPress, places[0], button, button)
    for place in places[1:]:
        _mouse(window, QtCore.QEvent.MouseMove, place, QtCore.Qt.NoButton, button)
        QtWidgets.QApplication.processEvents()
    if stroke.get("window"):
        save_window(window, stroke["window"])
    _mouse(window, QtCore.QEvent.MouseButtonRelease, places[-1], button, QtCore.Qt.NoButton)
    _wait(window)


def _click(window: DrawingWindow, at: list) -> None:
    place = window.canvas.from_photo(*at)
    _mouse(window, QtCore.QEvent.MouseButtonPress, place, QtCore.Qt.LeftButton, QtCore.Qt.LeftButton)
    _mouse(window, QtCore.QEvent.MouseButtonRelease, place, QtCore.Qt.LeftButton, QtCore.Qt.NoButton)


def _hover(window: DrawingWindow, at: list) -> None:
    place = window.canvas.from_photo(*at)
    _mouse(window, QtCore.QEvent.MouseMove, place, QtCore.Qt.NoButton, QtCore.Qt.NoButton)


def _key(window: DrawingWindow, key: str) -> None:
    """What a key does: the action that has it as its shortcut."""
    wanted = QtGui.QKeySequence(key)
    found = [action for action in window.findChildren(QtGui.QAction) if action.shortcut() == wanted]
    if not found or not found[0].isEnabled():
        raise ValueError(f"the key {key} does nothing now")
    found[0].trigger()
    _wait(window)


def _value(window: DrawingWindow, values: dict) -> None:
    for name, value in values.items():
        window.sliders.boxes[name].setValue(value)
    _wait(window)


def _slide(window: DrawingWindow, values: dict) -> None:
    for name, step in values.items():
        slider = window.sliders.sliders[name]
        slider.setSliderDown(True)
        slider.setValue(step)
        settle(window)
        slider.setSliderDown(False)
    _wait(window)


def _grow(window: DrawingWindow, path: bool | str) -> None:
    """Grow; with a path a picture of the window while the tree grows."""
    window.grow_action.trigger()
    if isinstance(path, str):
        _wait(window, shows=True)
        save_window(window, path)
    _wait(window)


def _make(window: DrawingWindow, order: dict) -> None:
    window.make(str(Path(order["path"]).absolute()), preview=order.get("preview", True))
    _wait(window)
    _expect_message(window, "asset: ")


def _save(window: DrawingWindow, path: str) -> None:
    window.write(str(Path(path).absolute()))
    _wait(window)


def _load(window: DrawingWindow, path: str) -> None:
    window.load(str(Path(path).absolute()))
    _wait(window)


def _expect_message(window: DrawingWindow, text: str) -> None:
    """See that the line at the bottom begins with a text."""
    message = window.statusBar().currentMessage()
    if not message.startswith(text):
        raise ValueError(message)


def _choose_tree(window: DrawingWindow, number: int | str) -> None:
    if number == "new":
        window.new_tree_button.click()
    else:
        window.choose_tree(number)
    _wait(window)


def _turn(window: DrawingWindow, seconds: float) -> None:
    """Let the tree turn for so long."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        QtWidgets.QApplication.processEvents(QtCore.QEventLoop.AllEvents, 20)


def _seconds(window: DrawingWindow, path: str) -> None:
    Path(path).write_text("\n".join(f"{each:.3f}" for each in window.seconds), encoding="utf-8")


ACTIONS = {
    "stroke": _stroke,
    "click": _click,
    "hover": _hover,
    "key": _key,
    "value": _value,
    "slide": _slide,
    "tree": _choose_tree,
    "grow": _grow,
    "turn": _turn,
    "turning": lambda window, on: window.turn_box.setChecked(on),
    "layer": lambda window, layers: [window.layer_boxes[name].setChecked(on) for name, on in layers.items()],
    "propose": lambda window, _: (window.propose_action.trigger(), _wait(window)),
    "save_strokes": _save,
    "load_strokes": _load,
    "make": _make,
    "message": _expect_message,
    "seconds": _seconds,
    "window": save_window,
}
