"""The photograph with the strokes over it: the left button draws a crown, the right button branches."""

from drawing import BRANCH, CROWN, MIN_STROKE_PX, Drawing, Stroke, find_stroke, length_of, list_strokes, simplify
from PySide6 import QtCore, QtGui, QtWidgets

CROWN_COLOR, BRANCH_COLOR = QtGui.QColor(235, 60, 45), QtGui.QColor(45, 120, 255)
TRACED_COLOR, CHOSEN_COLOR = QtGui.QColor(255, 214, 0), QtGui.QColor(255, 255, 255)
LEAVES_COLOR = QtGui.QColor(0, 225, 255, 95)  # over leaves of any hue
BACKGROUND = QtGui.QColor(40, 41, 43)
REACH_PX = 8.0  # of the screen, within which a stroke is meant
SIMPLE_PX = 0.7  # of the screen, by which a stroke may leave the way of the mouse
ZOOM = 1.0015  # of an eighth of a degree of the wheel
MAX_ZOOM = 30.0  # pixels of the screen, of one of the picture


class DrawingCanvas(QtWidgets.QWidget):
    """Shows a drawing, and reports what the mouse draws; it changes nothing itself."""

    drawn = QtCore.Signal(str, tuple)  # a stroke: its kind, and its points in the photograph
    chosen = QtCore.Signal(object)  # the stroke that was clicked, or None

    def __init__(self, picture_file: str, photo_width_px: int, parent=None) -> None:
        super().__init__(parent)
        self._picture = QtGui.QPixmap(picture_file)
        self._shrunk = self._picture.width() / photo_width_px  # the picture is a smaller photograph
        self.drawing = Drawing()
        self.selected: Stroke | None = None
        self.hovered: Stroke | None = None
        self.shows = {"leaves": True, "traced": True, "strokes": True}
        self._leaves: QtGui.QImage | None = None
        self._traced: list[QtGui.QPolygonF] = []
        self._pending: list[tuple[float, float]] = []
        self._kind = ""
        self._zoom = 0.0  # 0: the whole picture is in the window
        self._offset = QtCore.QPointF()
        self._panned_from: QtCore.QPointF | None = None
        self._at = QtCore.QPointF(-100, -100)
        self.setMouseTracking(True)
        self.setFocusPolicy(QtCore.Qt.StrongFocus)
        self.setContextMenuPolicy(QtCore.Qt.PreventContextMenu)
        self.setCursor(QtCore.Qt.CrossCursor)
        self.setMinimumSize(200, 160)

    # What is shown

    def show_drawing(self, drawing: Drawing) -> None:
        self.drawing = drawing
        self.selected = self.hovered = None
        self.update()

    def show_traced(self, leaves_file: str, branches: list) -> None:
        """Show which pixels are leaves, and the branches that were found, in pixels of the photograph."""
        self._leaves = self._tint(leaves_file) if leaves_file else None
        self._traced = [QtGui.QPolygonF([QtCore.QPointF(x, y) * self._shrunk for x, y in line]) for line in branches]
        self.update()

    def show_layer(self, name: str, visible: bool) -> None:
        self.shows[name] = visible
        self.update()

    def fit(self) -> None:
        """Show the whole photograph."""
        self._zoom = 0.0
        self.update()

    @property
    def is_drawing(self) -> bool:
        """Whether a button is down."""
        return bool(self._kind)

    @staticmethod
    def _tint(file: str) -> QtGui.QImage:
        mask = QtGui.QImage(file).convertToFormat(QtGui.QImage.Format_Grayscale8)
        mask.reinterpretAsFormat(QtGui.QImage.Format_Alpha8)
        tinted = QtGui.QImage(mask.size(), QtGui.QImage.Format_ARGB32_Premultiplied)
        tinted.fill(LEAVES_COLOR)
        painter = QtGui.QPainter(tinted)
        painter.setCompositionMode(QtGui.QPainter.CompositionMode_DestinationIn)
        painter.drawImage(0, 0, mask)
        painter.end()
        return tinted

    # Between the window and the photograph

    def _scale(self) -> float:
        """Pixels of the screen, of one of the picture."""
        if self._zoom:
            return self._zoom
        return min(self.width() / self._picture.width(), self.height() / self._picture.height())

    def _corner(self) -> QtCore.QPointF:
        """Where the picture's first corner is in the window."""
        if self._zoom:
            return self._offset
        scale = self._scale()
        return QtCore.QPointF(
            (self.width() - scale * self._picture.width()) / 2, (self.height() - scale * self._picture.height()) / 2
        )

    def to_photo(self, at: QtCore.QPointF) -> tuple[float, float]:
        """The place in the photograph of one in the window."""
        place = (at - self._corner()) / (self._scale() * self._shrunk)
        return place.x(), place.y()

    def from_photo(self, x: float, y: float) -> QtCore.QPointF:
        """The place in the window of one in the photograph."""
        return self._corner() + QtCore.QPointF(x, y) * (self._scale() * self._shrunk)

    def _in_photo(self, at: QtCore.QPointF) -> tuple[float, float]:
        """Likewise, and never beyond its border."""
        x, y = self.to_photo(at)
        width, height = self._picture.width() / self._shrunk, self._picture.height() / self._shrunk
        return min(max(x, 0.0), width), min(max(y, 0.0), height)

    # The mouse

    def mousePressEvent(self, event) -> None:
        self.setFocus()
        if event.button() == QtCore.Qt.MiddleButton:
            self._panned_from = event.position()
            self.setCursor(QtCore.Qt.ClosedHandCursor)
            return
        kinds = {QtCore.Qt.LeftButton: CROWN, QtCore.Qt.RightButton: BRANCH}
        if event.button() in kinds and not self._kind:
            self._kind = kinds[event.button()]
            self._pending = [self._in_photo(event.position())]
            self.update()

    def mouseMoveEvent(self, event) -> None:
        self._at = event.position()
        if self._panned_from is not None:
            self._offset, self._zoom = self._corner() + event.position() - self._panned_from, self._scale()
            self._panned_from = event.position()
        elif self._kind:
            self._pending.append(self._in_photo(event.position()))
        else:
            self.hovered = self._stroke_at(event.position())
        self.update()

    def mouseReleaseEvent(self, event) -> None:
        if event.button() == QtCore.Qt.MiddleButton:
            self._panned_from = None
            self.setCursor(QtCore.Qt.CrossCursor)
            return
        ended = {CROWN: QtCore.Qt.LeftButton, BRANCH: QtCore.Qt.RightButton}.get(self._kind)
        if event.button() != ended:
            return
        kind, pixel = self._kind, 1 / (self._scale() * self._shrunk)
        line = simplify((*self._pending, self._in_photo(event.position())), SIMPLE_PX * pixel)
        self._kind, self._pending = "", []
        if length_of(line) < MIN_STROKE_PX * pixel or len(line) < (3 if kind == CROWN else 2):
            self.selected = self._stroke_at(event.position())
            self.chosen.emit(self.selected)
        else:
            self.drawn.emit(kind, line)
        self.update()

    def leaveEvent(self, _event) -> None:
        self.hovered, self._at = None, QtCore.QPointF(-100, -100)
        self.update()

    def wheelEvent(self, event) -> None:
        scale, at = self._scale(), event.position()
        smallest = 0.5 * min(self.width() / self._picture.width(), self.height() / self._picture.height())
        zoom = min(max(scale * ZOOM ** event.angleDelta().y(), smallest), MAX_ZOOM)
        self._offset = at - (at - self._corner()) * (zoom / scale)
        self._zoom = zoom
        self.update()

    def _stroke_at(self, at: QtCore.QPointF) -> Stroke | None:
        return find_stroke(self.drawing.tree, self.to_photo(at), REACH_PX / (self._scale() * self._shrunk))

    # Painting

    def paintEvent(self, _event) -> None:
        painter = QtGui.QPainter(self)
        painter.fillRect(self.rect(), BACKGROUND)
        painter.setRenderHint(QtGui.QPainter.Antialiasing)
        painter.setRenderHint(QtGui.QPainter.SmoothPixmapTransform, self._scale() < 3)
        painter.save()
        painter.translate(self._corner())
        painter.scale(self._scale(), self._scale())
        painter.drawPixmap(0, 0, self._picture)
        if self.shows["leaves"] and self._leaves is not None:
            target = QtCore.QRectF(0, 0, self._picture.width(), self._picture.height())
            painter.drawImage(target, self._leaves)
        if self.shows["traced"]:
            self._paint_lines(painter, self._traced, TRACED_COLOR, 2.0)
        painter.restore()
        if self.shows["strokes"]:
            self._paint_strokes(painter)
        self._paint_pending(painter)
        painter.end()

    @staticmethod
    def _paint_lines(painter: QtGui.QPainter, lines: list, color: QtGui.QColor, width: float) -> None:
        for border, tint in ((2.0, QtGui.QColor(0, 0, 0, 120)), (0.0, color)):
            painter.setPen(_pen(tint, width + border))
            for line in lines:
                painter.drawPolyline(line)

    def _paint_strokes(self, painter: QtGui.QPainter) -> None:
        for number, tree in enumerate(self.drawing.trees):
            is_current = number == self.drawing.current
            painter.setOpacity(1.0 if is_current else 0.4)
            for stroke, line in list_strokes(tree):
                places = QtGui.QPolygonF([self.from_photo(x, y) for x, y in line])
                is_marked = is_current and stroke in (self.selected, self.hovered)
                width = 5.0 if is_current and stroke == self.selected else 3.0
                if is_marked:
                    painter.setPen(_pen(CHOSEN_COLOR, width + 3))
                    (painter.drawPolygon if stroke.kind == CROWN else painter.drawPolyline)(places)
                painter.setPen(_pen(CROWN_COLOR if stroke.kind == CROWN else BRANCH_COLOR, width))
                (painter.drawPolygon if stroke.kind == CROWN else painter.drawPolyline)(places)
        painter.setOpacity(1.0)

    def _paint_pending(self, painter: QtGui.QPainter) -> None:
        if self._kind:
            color = CROWN_COLOR if self._kind == CROWN else BRANCH_COLOR
            places = QtGui.QPolygonF([self.from_photo(x, y) for x, y in self._pending])
            painter.setPen(_pen(color, 3.0))
            painter.drawPolyline(places)
            if self._kind == CROWN and len(self._pending) > 1:  # how it will be closed
                painter.setPen(_pen(color, 1.5, QtCore.Qt.DashLine))
                painter.drawLine(places.first(), places.last())
            painter.setPen(_pen(CHOSEN_COLOR, 1.5))
            painter.drawEllipse(self._at, 6, 6)


def _pen(color: QtGui.QColor, width: float, style=QtCore.Qt.SolidLine) -> QtGui.QPen:
    pen = QtGui.QPen(color, width, style, QtCore.Qt.RoundCap, QtCore.Qt.RoundJoin)
    pen.setCosmetic(True)
    return pen
