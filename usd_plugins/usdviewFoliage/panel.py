"""The panel of a plant: variants, guides, the average leaf, and sliders that edit all leaves at once.

It stands in usdview and in the viewer of usdfoliage, and knows neither. What it needs of the program is a host:

    stage                       the stage that is shown
    product                     usdviewFoliage.product.Product, or None where there is no usdfoliage
    leaf_file                   the file of which product shall read the leaves, such as a look; "" for the asset's own
    redraw()                    the stage has changed
    draw_guides(visible)        draw prims of purpose guide, or not
    draw_cameras(visible)       draw the stage's cameras, or not
    drag(pressed)               whether a slider is pressed: then what is drawn may be coarse
    show_message(text)          a line for the user
"""

from pxr import Tf, Usd

from usdviewFoliage import plants
from usdviewFoliage.edit_sliders import EditSliders
from usdviewFoliage.leaf_drawing import LeafDrawing
from usdviewFoliage.live_look import LiveLook
from usdviewFoliage.product import ProductError, ProductGoneError
from usdviewFoliage.qt import QtCore, QtWidgets
from usdviewFoliage.sentences import NO_PRODUCT, describe_look, describe_saved

NAME_CHARACTERS = 8  # of a name, for which a box has room at least; a longer one is in its tip
WIDEST_PX = 320  # the panel asks for no more, whatever a style or a font needs


class FoliagePanel(QtWidgets.QWidget):
    """Everything that can be done with the plants of a stage."""

    def __init__(self, host, parent=None) -> None:
        super().__init__(parent)
        self.host = host
        self.stage = host.stage
        self._listener = Tf.Notice.Register(Usd.Notice.ObjectsChanged, self._note_change, self.stage)
        self._timer = QtCore.QTimer(self)  # what changes at once is followed once
        self._timer.setSingleShot(True)
        self._timer.setInterval(0)
        self._timer.timeout.connect(self._follow_stage)
        self.looks = {}  # by the asset's interface layer, made when it is first shown
        self.look = None
        self._pressed = False  # a slider
        self.setWindowTitle("Foliage")
        outer = QtWidgets.QVBoxLayout(self)
        outer.setContentsMargins(0, 0, 0, 0)
        self.content = QtWidgets.QWidget()  # scrolls as a whole, so that a small window has all of it
        self.scroll_area = QtWidgets.QScrollArea()
        self.scroll_area.setWidgetResizable(True)
        self.scroll_area.setFrameShape(QtWidgets.QFrame.NoFrame)
        self.scroll_area.setWidget(self.content)
        outer.addWidget(self.scroll_area, 1)
        layout = QtWidgets.QVBoxLayout(self.content)
        self.plant_box = _name_box()
        self.plant_box.currentIndexChanged.connect(lambda _: self._choose_plant())
        layout.addWidget(self.plant_box)

        self.variant_form = QtWidgets.QFormLayout()
        self.variant_form.setRowWrapPolicy(QtWidgets.QFormLayout.WrapLongRows)
        self.variant_boxes = {}
        layout.addLayout(self.variant_form)

        guides = QtWidgets.QHBoxLayout()
        self.guide_boxes = {}
        for name in plants.GUIDES:
            box = QtWidgets.QCheckBox(name.lower())
            box.toggled.connect(lambda _: self._show_guides())
            self.guide_boxes[name] = box
            guides.addWidget(box)
        layout.addLayout(guides)

        self.drawing = LeafDrawing()
        layout.addWidget(self.drawing)
        self.reason = QtWidgets.QLabel()
        self.reason.setWordWrap(True)
        layout.addWidget(self.reason)
        self.sliders = EditSliders()
        self.sliders.changed.connect(self._edit)
        self.sliders.dragged.connect(self._press)
        layout.addWidget(self.sliders, 1)

        buttons = QtWidgets.QHBoxLayout()
        buttons.setContentsMargins(6, 0, 6, 6)
        self.show_box = QtWidgets.QCheckBox("show edits")
        self.show_box.setChecked(True)
        self.show_box.toggled.connect(self._mute)
        self.reset_button = QtWidgets.QPushButton("Reset")
        self.reset_button.setToolTip("Take all edits back")
        self.reset_button.clicked.connect(lambda: self.reset())
        self.save_button = QtWidgets.QPushButton("Save look…")
        self.save_button.setToolTip(
            "Write the edits as a layer to be sublayered into a scene; the asset stays as it is"
        )
        self.save_button.clicked.connect(lambda: self._ask_and_save())
        for widget in (self.show_box, self.reset_button, self.save_button):
            buttons.addWidget(widget)
        outer.addLayout(buttons)
        self.find_plants()

    # What is shown

    def find_plants(self) -> None:
        """Look for the plants of the stage anew."""
        found = plants.one_of_each(plants.find_plants(self.stage))
        before = self.plant_box.currentData()
        self.plant_box.blockSignals(True)
        self.plant_box.clear()
        for plant in found:
            self.plant_box.addItem(plant.GetName(), str(plant.GetPath()))
            tip = f"{plant.GetName()}: edits act on all plants of this asset."
            self.plant_box.setItemData(self.plant_box.count() - 1, tip, QtCore.Qt.ToolTipRole)
        self.plant_box.setCurrentIndex(max(self.plant_box.findData(before), 0 if found else -1))
        self.plant_box.blockSignals(False)
        self.plant_box.setVisible(len(found) > 1)
        self._choose_plant()

    def refresh(self) -> None:
        """Show what the stage has now."""
        self._list_variants()
        guides = plants.guide_prims(self.stage)
        for name, box in self.guide_boxes.items():
            box.setEnabled(name in guides)
        can_edit, sentence = describe_look(self.look)
        self.reason.setText(sentence)
        for widget in (self.sliders, self.save_button, self.reset_button):
            widget.setEnabled(can_edit)
        can_hide = self.look is not None and not self.look.why_not()
        self.show_box.setEnabled(can_hide)
        self.drawing.setVisible(can_hide)
        if can_hide:
            self.sliders.show_edits(self.look.values())
            self._draw_leaf()
        self._fit_width()
        self.host.redraw()

    def leave_stage(self) -> None:
        """Listen to the stage no more: it is being closed, or has been."""
        self._timer.stop()
        if self._listener is not None:
            self._listener.Revoke()
            self._listener = None

    def _fit_width(self) -> None:
        """Be no narrower than what the panel has, so that no label is cut; beyond a limit it scrolls sideways."""
        bar = self.style().pixelMetric(QtWidgets.QStyle.PM_ScrollBarExtent)
        self.scroll_area.setMinimumWidth(min(self.content.minimumSizeHint().width() + bar, WIDEST_PX))

    def _note_change(self, notice, _stage) -> None:
        """Prims have come or gone, as where a variant was selected in another part of the program."""
        if notice.GetResyncedPaths():
            self._timer.start()

    def _follow_stage(self) -> None:
        if self._pressed:  # a slider is not moved under the hand that holds it
            self._timer.start(200)
            return
        self._timer.setInterval(0)
        self.find_plants()

    def _choose_plant(self) -> None:
        self.plant_box.setToolTip(self.plant_box.currentData(QtCore.Qt.ToolTipRole) or "")
        plant = self.stage.GetPrimAtPath(self.plant_box.currentData() or "/")
        self.look = None
        if self.plant_box.count() and plant:
            key = plants.interface_file(plant) or str(plant.GetPath())
            if key not in self.looks:
                self.looks[key] = LiveLook(self.stage, plant)
            self.look = self.looks[key]
            self.show_box.blockSignals(True)
            self.show_box.setChecked(self.look.is_visible())
            self.show_box.blockSignals(False)
        self.refresh()

    def _list_variants(self) -> None:
        """A box for each set; made anew where a selection has brought other sets or variants."""
        variants = plants.variants(self.look.plant) if self.look and self.look.plant else {}
        listed = {name: [box.itemText(i) for i in range(box.count())] for name, box in self.variant_boxes.items()}
        if listed != {name: names for name, (names, _) in variants.items()}:
            while self.variant_form.rowCount():
                self.variant_form.removeRow(0)
            self.variant_boxes = {}
            for name, (names, _) in variants.items():
                box = _name_box()
                box.addItems(names)
                for number, variant in enumerate(names):
                    box.setItemData(number, variant, QtCore.Qt.ToolTipRole)
                box.activated.connect(lambda _, name=name: self.select(name, self.variant_boxes[name].currentText()))
                self.variant_form.addRow(name, box)
                self.variant_boxes[name] = box
        for name, (names, chosen) in variants.items():
            if chosen in names:
                self.variant_boxes[name].setCurrentIndex(names.index(chosen))
            self.variant_boxes[name].setToolTip(f"{name}: {chosen}")

    def _draw_leaf(self) -> None:
        if self.host.product is None:
            self.drawing.show_text(NO_PRODUCT)
            return
        try:
            self.drawing.show_curves(self.host.product.leaf_curves(self._read_file(), self.sliders.edits))
        except ProductError as error:
            self.drawing.show_text(str(error))

    def _read_file(self) -> str:
        return self.host.leaf_file or self.look.interface

    # What is done

    def select(self, name: str, chosen: str) -> None:
        """Select a variant on all plants of the asset."""
        plants.select_variant(self.stage, name, chosen, self.look.interface if self.look else None)
        self.refresh()

    def show_guide(self, name: str, visible: bool) -> None:
        """Show the guides of a name, or hide them; those of other names stay as their boxes are."""
        self.guide_boxes[name].setChecked(visible)

    def reset(self) -> None:
        """Take all edits back."""
        self.look.reset()
        self.refresh()

    def save(self, path: str) -> None:
        """Write the edits as a look; through usdfoliage where it is, whose extents are tighter.

        Raises:
            ProductError, ValueError: It cannot be written there.
        """
        edits = dict(self.sliders.edits)
        if self.host.product is not None:
            try:
                self.host.product.write_look(path, self._read_file(), edits)
            except ProductGoneError:
                self.host.product = None
            else:
                self.host.show_message(describe_saved(path, with_product=True))
                return
        self.look.write(path, edits)
        self.host.show_message(describe_saved(path, with_product=False))

    def _edit(self, edits: dict) -> None:
        self.look.apply(edits, self._bounds(edits))
        self.reason.setText(describe_look(self.look)[1])
        self._draw_leaf()
        self.host.redraw()

    def _bounds(self, edits: dict) -> list | None:
        """How far the leaves reach, if usdfoliage can compute it; while a slider is pressed a wider guess will do."""
        if self.host.product is None or self._pressed:
            return None
        try:
            return self.host.product.leaf_bounds(self._read_file(), edits)
        except ProductError as error:
            self.host.show_message(str(error))
            return None

    def _press(self, pressed: bool) -> None:
        self._pressed = pressed
        if not pressed and self.look is not None and self.look.is_visible():
            self.look.apply(self.sliders.edits, self._bounds(self.sliders.edits))
        self.host.drag(pressed)

    def _mute(self, visible: bool) -> None:
        self.look.show(visible)
        self.refresh()

    def _show_guides(self) -> None:
        checked = {name for name, box in self.guide_boxes.items() if box.isChecked()}
        plants.show_guides(self.stage, checked)
        self.host.draw_guides(bool(checked))
        self.host.draw_cameras("Cameras" in checked)
        self.host.redraw()

    def _ask_and_save(self) -> None:
        path, _ = QtWidgets.QFileDialog.getSaveFileName(self, "Save look", "look.usda", "Looks (*.usda)")
        if not path:
            return
        try:
            self.save(path if path.endswith(".usda") else f"{path}.usda")
        except (ProductError, ValueError) as error:
            QtWidgets.QMessageBox.warning(self, "Save look", str(error))


def _name_box():
    """A box to choose a name in, as narrow as the panel needs it."""
    box = QtWidgets.QComboBox()
    box.setSizeAdjustPolicy(QtWidgets.QComboBox.AdjustToMinimumContentsLengthWithIcon)
    box.setMinimumContentsLength(NAME_CHARACTERS)
    return box
