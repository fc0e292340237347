"""Sliders of the edits, in groups, of which those that are used often are open."""

from usdviewFoliage.edit_rows import ROWS, row_value, with_row
from usdviewFoliage.qt import QtCore, QtWidgets

STEPS = 1000  # of a slider
MAX_TYPED = 1000.0  # what usdfoliage accepts
LABEL_PX = 84
OPEN = ("Shape", "Curl", "Jitter")
NARROWEST_PX = 48  # a slider


class EditSliders(QtWidgets.QWidget):
    """A slider and a box of numbers for every row of edit_rows."""

    changed = QtCore.Signal(object)  # the edits, a dict, after a move: as Signal(dict), tuples in it become lists
    dragged = QtCore.Signal(bool)  # a slider is pressed, is let go

    def __init__(self, parent=None) -> None:
        super().__init__(parent)
        self.edits = {}
        self.boxes = {}  # by (group, label)
        self.sliders = {}
        layout = QtWidgets.QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        for group in dict.fromkeys(row.group for row in ROWS):
            inside = QtWidgets.QWidget()
            grid = QtWidgets.QGridLayout(inside)
            grid.setContentsMargins(6, 0, 6, 4)
            grid.setVerticalSpacing(2)
            grid.setColumnMinimumWidth(0, LABEL_PX)  # sliders of all groups begin at one place
            grid.setColumnStretch(1, 1)
            for line, row in enumerate(row for row in ROWS if row.group == group):
                self._add_row(grid, line, row)
            layout.addWidget(_header(group, inside))
            layout.addWidget(inside)
        layout.addStretch(1)

    def _add_row(self, grid, line: int, row) -> None:
        slider = QtWidgets.QSlider(QtCore.Qt.Horizontal)
        slider.setRange(0, STEPS)
        box = QtWidgets.QDoubleSpinBox()
        box.setDecimals(4)
        low = 0.0 if row.parts[0][1] is None else -MAX_TYPED
        box.setRange(0.01 if row.label == "frequency" else low, MAX_TYPED)
        box.setSingleStep((row.high - row.low) / 100)
        box.setKeyboardTracking(False)
        slider.setMinimumWidth(NARROWEST_PX)
        for widget in (slider, box):
            widget.setToolTip(row.tip)
            widget.setFocusPolicy(QtCore.Qt.StrongFocus)  # the wheel alone gives no focus
            widget.installEventFilter(self)
        slider.valueChanged.connect(lambda step: self._move(row, row.low + (row.high - row.low) * step / STEPS))
        slider.sliderPressed.connect(lambda: self.dragged.emit(True))
        slider.sliderReleased.connect(lambda: self.dragged.emit(False))
        box.valueChanged.connect(lambda value: self._move(row, value))
        grid.addWidget(QtWidgets.QLabel(row.label), line, 0)
        grid.addWidget(slider, line, 1)
        grid.addWidget(box, line, 2)
        self.sliders[row.group, row.label], self.boxes[row.group, row.label] = slider, box

    def eventFilter(self, widget, event) -> bool:
        """The wheel scrolls the panel: it edits only where the user has clicked before."""
        if event.type() == QtCore.QEvent.Wheel and not widget.hasFocus():
            event.ignore()  # goes on to what scrolls
            return True
        return False

    def show_edits(self, edits: dict) -> None:
        """Show edits; nothing is emitted. A row that these edits lack is switched off."""
        self.edits = dict(edits)
        for row in ROWS:
            slider, box = self.sliders[row.group, row.label], self.boxes[row.group, row.label]
            there = all(name in edits for name, _ in row.parts)
            slider.setEnabled(there)
            box.setEnabled(there)
            if not there:
                continue
            value = row_value(row, edits)
            part = min(max((value - row.low) / (row.high - row.low), 0.0), 1.0)
            for widget, number in ((slider, round(part * STEPS)), (box, value)):
                blocked = widget.blockSignals(True)
                widget.setValue(number)
                widget.blockSignals(blocked)

    def _move(self, row, value: float) -> None:
        self.show_edits(with_row(row, self.edits, value))
        self.changed.emit(dict(self.edits))


def _header(group: str, inside):
    """A button that opens a group and closes it. A QGroupBox has its title cut by usdview's style."""
    button = QtWidgets.QPushButton()
    button.setStyleSheet("text-align: left; padding: 2px 6px;")
    button.setCheckable(True)

    def open_group(opened: bool) -> None:
        button.setText(f"{'▾' if opened else '▸'} {group}")
        inside.setVisible(opened)

    button.toggled.connect(open_group)
    button.setChecked(group in OPEN)
    open_group(group in OPEN)
    return button
