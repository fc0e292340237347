"""What the menu does, on the panel of the window that it is called in."""

from usdviewFoliage import plants
from usdviewFoliage.panel import FoliagePanel
from usdviewFoliage.product import ProductError, find_product
from usdviewFoliage.qt import QtCore, QtWidgets
from usdviewFoliage.sentences import NO_PLANT, RESET, describe_guide, describe_selection

_DOCK = "usdviewFoliage"  # the panel's object name, by which a window's is found again


class UsdviewHost:
    """usdview, as the panel sees it."""

    leaf_file = ""

    def __init__(self, usdviewApi, product) -> None:
        self._api = usdviewApi
        self.product = product

    @property
    def stage(self):
        return self._api.stage

    def redraw(self) -> None:
        self._api.UpdateViewport()

    def draw_guides(self, visible: bool) -> None:
        self._api.dataModel.viewSettings.displayGuide = visible

    def draw_cameras(self, visible: bool) -> None:
        self._api.dataModel.viewSettings.displayCameraOracles = visible

    def drag(self, pressed: bool) -> None:
        """Do nothing: usdview draws coarsely by its own settings alone."""

    def show_message(self, text: str) -> None:
        self._api.PrintStatus(text)


def panel_of(usdviewApi) -> FoliagePanel:
    """The panel of usdview's window, made when it is first asked for, and anew for another stage."""
    window = usdviewApi.qMainWindow
    dock = window.findChild(QtWidgets.QDockWidget, _DOCK)
    if dock is None:
        dock = QtWidgets.QDockWidget("Foliage", window)
        dock.setObjectName(_DOCK)
        dock.product = find_product()  # one process, however many stages are opened one after the other
        usdviewApi.dataModel.signalStageReplaced.connect(lambda: _renew(usdviewApi, dock))
        window.addDockWidget(QtCore.Qt.RightDockWidgetArea, dock)
        dock.hide()
    panel = dock.widget()
    if panel is None or panel.stage != usdviewApi.stage:
        panel = _renew(usdviewApi, dock)
    return panel


def _renew(usdviewApi, dock) -> FoliagePanel | None:
    """Put a panel of the stage that usdview has now into the dock; none where it has no stage, as while one opens."""
    old = dock.widget()
    if old is not None:
        old.leave_stage()
        dock.product = old.host.product  # None where it has ended
        dock.setWidget(None)
        old.deleteLater()
    if not usdviewApi.stage:
        return None
    panel = FoliagePanel(UsdviewHost(usdviewApi, dock.product), dock)
    dock.setWidget(panel)
    return panel


def open_panel(usdviewApi) -> None:
    panel = panel_of(usdviewApi)
    panel.refresh()
    dock = panel.parentWidget()
    _fit_screen(usdviewApi.qMainWindow, dock)
    dock.show()


def _fit_screen(window, dock) -> None:
    """Let the panel float where the screen has no room for it beside usdview, which needs some 630 pixels itself."""
    if not dock.isHidden():
        return
    screen = window.screen().availableGeometry()
    if window.minimumSizeHint().width() + dock.minimumSizeHint().width() <= screen.width():
        return
    dock.setFloating(True)
    size = dock.sizeHint().boundedTo(screen.size())
    dock.setGeometry(screen.right() + 1 - size.width(), screen.top(), size.width(), size.height())


def select(usdviewApi, name: str, chosen: str) -> None:
    """Select a variant on every plant that has it."""
    count = plants.select_variant(usdviewApi.stage, name, chosen)
    usdviewApi.PrintStatus(describe_selection(name, chosen, count))
    panel_of(usdviewApi).refresh()
    usdviewApi.UpdateGUI()


def toggle_guide(usdviewApi, name: str) -> None:
    """Show the guides of a name, or hide them again."""
    panel = panel_of(usdviewApi)
    box = panel.guide_boxes[name]
    if name not in plants.guide_prims(usdviewApi.stage):
        usdviewApi.PrintStatus(describe_guide(name, None))
        return
    box.setChecked(not box.isChecked())
    usdviewApi.PrintStatus(describe_guide(name, box.isChecked()))
    usdviewApi.UpdateGUI()


def reset_edits(usdviewApi) -> None:
    panel = panel_of(usdviewApi)
    if panel.look is None:
        usdviewApi.PrintStatus(NO_PLANT)
        return
    panel.reset()
    usdviewApi.PrintStatus(RESET)
    usdviewApi.UpdateGUI()


def save_look(usdviewApi) -> None:
    panel = panel_of(usdviewApi)
    if panel.look is None:
        usdviewApi.PrintStatus(NO_PLANT)
        return
    path, _ = QtWidgets.QFileDialog.getSaveFileName(usdviewApi.qMainWindow, "Save look", "look.usda", "Looks (*.usda)")
    if not path:
        return
    try:
        panel.save(path if path.endswith(".usda") else f"{path}.usda")
    except (ProductError, ValueError) as error:
        QtWidgets.QMessageBox.warning(usdviewApi.qMainWindow, "Save look", str(error))
