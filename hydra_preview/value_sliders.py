"""A slider and a box for each value of a drawing."""

from PySide6 import QtCore, QtWidgets

STEPS = 1000  # of a slider
AUTO = "auto"  # what a box shows that stands at no value of its own


class ValueSliders(QtWidgets.QWidget):
    """Reports a value when a hand has chosen it: when a slider is released, or a number is typed.

    A value whose default is None has one step more below its lowest, which is reported as None.
    """

    chosen = QtCore.Signal(str, object)

    def __init__(self, rows: list[dict], parent=None) -> None:
        """rows: name, label, low, high, default, decimals, unit and tip of each."""
        super().__init__(parent)
        self._rows = {row["name"]: row for row in rows}
        self.sliders: dict[str, QtWidgets.QSlider] = {}
        self.boxes: dict[str, QtWidgets.QDoubleSpinBox] = {}
        grid = QtWidgets.QGridLayout(self)
        grid.setContentsMargins(0, 0, 0, 0)
        for at, row in enumerate(rows):
            label = QtWidgets.QLabel(row["label"])
            label.setToolTip(row["tip"])
            grid.addWidget(label, at, 0)
            grid.addWidget(self._add_slider(row), at, 1)
            grid.addWidget(self._add_box(row), at, 2)

    def show_values(self, values: dict[str, float | None]) -> None:
        """Stand at these values, and at the defaults of the others."""
        for name, row in self._rows.items():
            self._stand(name, values.get(name, row["default"]))

    def _add_slider(self, row: dict) -> QtWidgets.QSlider:
        name = row["name"]
        slider = QtWidgets.QSlider(QtCore.Qt.Horizontal)
        slider.setToolTip(row["tip"])
        slider.setRange(0, STEPS)
        slider.setMinimumWidth(110)
        slider.valueChanged.connect(lambda step: self._slide(name, step))
        slider.sliderReleased.connect(lambda: self.chosen.emit(name, self._value(name)))
        self.sliders[name] = slider
        return slider

    def _add_box(self, row: dict) -> QtWidgets.QDoubleSpinBox:
        name, low, high = row["name"], row["low"], row["high"]
        box = QtWidgets.QDoubleSpinBox()
        box.setToolTip(row["tip"])
        box.setKeyboardTracking(False)
        box.setDecimals(row["decimals"])
        box.setRange(row["lowest"], row["highest"])
        if row["default"] is None:
            box.setMinimum(row["lowest"] - 10.0 ** -row["decimals"])
            box.setSpecialValueText(AUTO)
        box.setSingleStep(1 if row["decimals"] == 0 else (high - low) / 50)
        box.setSuffix(row["unit"])
        box.valueChanged.connect(lambda value: self._type(name, value))
        self.boxes[name] = box
        self._stand(name, row["default"])
        return box

    def _value(self, name: str) -> float | None:
        box = self.boxes[name]
        is_auto = self._rows[name]["default"] is None and box.value() <= box.minimum()
        return None if is_auto else box.value()

    def _stand(self, name: str, value: float | None) -> None:
        row = self._rows[name]
        if value is None:
            value = self.boxes[name].minimum()
        share = (value - row["low"]) / (row["high"] - row["low"])
        for widget, stands_at in ((self.sliders[name], round(STEPS * share)), (self.boxes[name], value)):
            widget.blockSignals(True)
            widget.setValue(stands_at)
            widget.blockSignals(False)

    def _slide(self, name: str, step: int) -> None:
        row = self._rows[name]
        self._stand(name, row["low"] + step / STEPS * (row["high"] - row["low"]))
        if not self.sliders[name].isSliderDown():  # by a key or the wheel
            self.chosen.emit(name, self._value(name))

    def _type(self, name: str, value: float) -> None:
        self._stand(name, value)
        self.chosen.emit(name, self._value(name))
