"""Actions of a script, done in the viewer's window with the same widgets that a hand would use."""

from pathlib import Path

from PySide6 import QtCore, QtGui, QtWidgets
from view_window import ViewWindow

BUTTONS = {"left": QtCore.Qt.LeftButton, "middle": QtCore.Qt.MiddleButton, "right": QtCore.Qt.RightButton}
DRAG_STEPS = 4


class ScriptError(Exception):
    """An action that is unknown or cannot be done."""


def run_script(window, actions: list[dict], known: dict | None = None) -> None:
    """Do one action after the other, each drawn before the next; ScriptError for the first that fails.

    known has the actions of a window by their names: those of a ViewWindow unless another one's are given.
    """
    known = ACTIONS if known is None else known
    for number, action in enumerate(actions):
        ((name, value),) = action.items()
        if name not in known:
            raise ScriptError(f"action {number}: nothing is known of {name!r}; there are {', '.join(known)}")
        try:
            known[name](window, value)
        except Exception as error:
            raise ScriptError(f"action {number}, {name}: {error}") from error
        settle(window)


def settle(window) -> None:
    """Let Qt handle what waits, and Storm draw."""
    for _ in range(3):
        QtWidgets.QApplication.processEvents()
    if window.view is not None:
        window.view.repaint()
    QtWidgets.QApplication.processEvents()


def _variant(window: ViewWindow, chosen: dict) -> None:
    for name, variant in chosen.items():
        box = window.panel.variant_boxes[name]
        at = box.findText(variant)
        if at < 0:
            raise ValueError(f"{name} has no variant {variant}")
        box.setCurrentIndex(at)
        box.activated.emit(at)


def _edit(window: ViewWindow, values: dict) -> None:
    for name, value in values.items():
        group, _, label = name.rpartition("/")
        boxes = [box for (of, row), box in window.panel.sliders.boxes.items() if row == label and of.startswith(group)]
        if not boxes or not boxes[0].isEnabled():
            raise ValueError(f"there is no slider {name} that can be moved")
        boxes[0].setValue(value)


def _slide(window: ViewWindow, values: dict) -> None:
    for name, step in values.items():
        group, _, label = name.rpartition("/")
        sliders = window.panel.sliders.sliders
        slider = next(slider for (of, row), slider in sliders.items() if row == label and of.startswith(group))
        slider.sliderPressed.emit()
        slider.setValue(step)
        settle(window)
        slider.sliderReleased.emit()


def _drag(window: ViewWindow, drag: dict) -> None:
    view = window.view
    button = BUTTONS[drag.get("button", "left")]
    modifiers = QtCore.Qt.AltModifier if drag.get("alt") else QtCore.Qt.NoModifier
    (x0, y0), (x1, y1) = drag["from"], drag["to"]
    kinds = [QtCore.QEvent.MouseButtonPress, *[QtCore.QEvent.MouseMove] * DRAG_STEPS, QtCore.QEvent.MouseButtonRelease]
    for step, kind in enumerate(kinds):
        part = min(step, DRAG_STEPS) / DRAG_STEPS
        at = QtCore.QPointF(x0 + (x1 - x0) * part, y0 + (y1 - y0) * part)
        pressed = QtCore.Qt.NoButton if kind == QtCore.QEvent.MouseButtonRelease else button
        of = QtCore.Qt.NoButton if kind == QtCore.QEvent.MouseMove else button
        event = QtGui.QMouseEvent(kind, at, view.mapToGlobal(at), of, pressed, modifiers)
        QtWidgets.QApplication.sendEvent(view, event)
        settle(window)


def _wheel(window: ViewWindow, delta: int) -> None:
    view = window.view
    at = QtCore.QPointF(view.width() / 2, view.height() / 2)
    event = QtGui.QWheelEvent(
        at,
        view.mapToGlobal(at),
        QtCore.QPoint(),
        QtCore.QPoint(0, delta),
        QtCore.Qt.NoButton,
        QtCore.Qt.NoModifier,
        QtCore.Qt.NoScrollPhase,
        False,
    )
    QtWidgets.QApplication.sendEvent(view, event)


def _guide(window: ViewWindow, guides: dict) -> None:
    for name, on in guides.items():
        if not window.panel.guide_boxes[name].isEnabled():
            raise ValueError(f"there is no guide {name}")
        window.panel.show_guide(name, on)


def _purpose(window: ViewWindow, purposes: dict) -> None:
    for name, on in purposes.items():
        window.purpose_actions[name].setChecked(on)


def save_window(window, path: str) -> None:
    """Write a picture of the whole window."""
    picture = window.grab()
    # A widget's grab leaves OpenGL out in some versions of Qt.
    if window.view is not None:
        painter = QtGui.QPainter(picture)
        painter.drawImage(window.view.mapTo(window, QtCore.QPoint(0, 0)), window.view.grabFramebuffer())
        painter.end()
    if not picture.save(path):
        raise ValueError(f"{path} cannot be written")


ACTIONS = {
    "variant": _variant,
    "edit": _edit,
    "slide": _slide,
    "drag": _drag,
    "wheel": _wheel,
    "frame_all": lambda window, _: window.view.frame_all(),
    "guide": _guide,
    "purpose": _purpose,
    "frame": lambda window, frame: window.frame_box.setValue(frame),
    "show_edits": lambda window, on: window.panel.show_box.setChecked(on),
    "show_look": lambda window, on: window.look_action.setChecked(on),
    "reset": lambda window, _: window.panel.reset_button.click(),
    "save_look": lambda window, path: window.panel.save(str(Path(path).absolute())),
    "picture": lambda window, path: window.save_picture(path),
    "window": save_window,
}
