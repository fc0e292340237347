"""The tree of a drawing, in Storm: its shoots while it grows, then the draft of its asset, turning."""

import math
import time

from pxr import Gf, Sdf, Usd, UsdGeom, Vt
from PySide6 import QtCore, QtWidgets
from storm_view import StormView

TURN_S = 24.0  # for a whole turn
REST = 1.5  # times as long as a picture takes, nothing is drawn after it, so that the window stays fluent
SHORTEST_MS = 40
WIDE, THIN = 0.016, 0.006  # of the tree's height: shoots while it grows
BARK = (0.17, 0.11, 0.07)


class GrownTree(QtWidgets.QStackedWidget):
    """A place for the tree; empty, with a line of text, until one grows."""

    failed = QtCore.Signal(str)

    def __init__(self, dome_texture: str, is_busy, parent=None) -> None:
        """is_busy: whether turning has to wait, as while somebody draws."""
        super().__init__(parent)
        self.view: StormView | None = None
        self.turns = True
        self._dome_texture, self._is_busy = dome_texture, is_busy
        self._points: list[Gf.Vec3f] = []
        self._counts: list[int] = []
        self._widths: list[float] = []
        self._turned = time.monotonic()
        self._stage = Usd.Stage.CreateInMemory()
        UsdGeom.SetStageUpAxis(self._stage, UsdGeom.Tokens.y)
        UsdGeom.SetStageMetersPerUnit(self._stage, 1.0)
        self._draft = self._stage.DefinePrim("/Draft", "Xform")
        self._shoots = UsdGeom.BasisCurves.Define(self._stage, "/Shoots")
        self._shoots.CreateTypeAttr(UsdGeom.Tokens.linear)
        self._shoots.CreateDisplayColorAttr([BARK])
        text = QtWidgets.QLabel("The tree grows here.")
        text.setAlignment(QtCore.Qt.AlignCenter)
        text.setStyleSheet("background: #5c5e61; color: #d0d2d4;")
        self.addWidget(text)
        self.setMinimumSize(200, 160)
        self._timer = QtCore.QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.timeout.connect(self._turn)

    def show_shoots(self, shoots: list, first: int) -> None:
        """Show a tree that grows: shoots (K, 3) in metres, after those that were shown before their number."""
        begins = first == 0
        if begins:
            self._points, self._counts, self._widths = [], [], []
        height = max((point[1] for line in shoots for point in line), default=1.0) if begins else self._height()
        for line in shoots:
            self._points += [Gf.Vec3f(*point) for point in line]
            self._counts.append(len(line))
            self._widths.append((WIDE if begins else THIN) * max(height, 1e-3))
        if not self._points:
            return
        with Sdf.ChangeBlock():
            self._shoots.CreatePointsAttr(Vt.Vec3fArray(self._points))
            self._shoots.CreateCurveVertexCountsAttr(Vt.IntArray(self._counts))
            self._shoots.CreateWidthsAttr(Vt.FloatArray(self._widths))
            self._shoots.CreateExtentAttr(self._extent())
        self._shoots.SetWidthsInterpolation(UsdGeom.Tokens.uniform)
        if begins:
            self._draft.GetReferences().ClearReferences()
            self._shoots.MakeVisible()
        self._show(frames=begins)

    def show_asset(self, file: str) -> None:
        """Show an asset in place of what was shown."""
        self._draft.GetReferences().SetReferences([Sdf.Reference(file)])
        self._shoots.MakeInvisible()
        self._show(frames=True)

    def set_turning(self, turns: bool) -> None:
        self.turns = turns
        self._turned = time.monotonic()
        self._wait_to_turn()

    def frame_all(self) -> None:
        if self.view is not None:
            self.view.frame_all()

    def _height(self) -> float:
        return max(point[1] for point in self._points) if self._points else 1.0

    def _extent(self) -> Vt.Vec3fArray:
        low = Gf.Vec3f(*(min(point[k] for point in self._points) for k in range(3)))
        high = Gf.Vec3f(*(max(point[k] for point in self._points) for k in range(3)))
        return Vt.Vec3fArray([low, high])

    def _show(self, *, frames: bool) -> None:
        if self.view is None:
            self.view = StormView(self._stage, self._dome_texture)
            self.view.failed.connect(self.failed)
            self.addWidget(self.view)
            self.setCurrentWidget(self.view)
            self._wait_to_turn()
        elif frames:
            self.view.frame_all()
        self.view.update()

    def _wait_to_turn(self) -> None:
        if self.turns and self.view is not None:
            self._timer.start(max(SHORTEST_MS, round(1000 * REST * self.view.seconds)))

    def _turn(self) -> None:
        now = time.monotonic()
        passed, self._turned = now - self._turned, now
        if self.turns and self.isVisible() and not self._is_busy():
            self.view.turn(2 * math.pi * min(passed, 0.5) / TURN_S)
        self._wait_to_turn()
