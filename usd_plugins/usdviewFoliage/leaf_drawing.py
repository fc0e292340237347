"""The average leaf from the front and from its side, with the control polygons of its curves."""

from usdviewFoliage.qt import QtCore, QtGui, QtWidgets

COLORS = {"axis": "#d05040", "silhouette": "#2f6f30", "inner": "#6b8fc0", "outer": "#b08a3a"}
BLADE = "#a9c795"
MARGIN = 0.08  # of the height, left free


class LeafDrawing(QtWidgets.QWidget):
    """Curves as usdfoliage.jobs.preview.viewer gives them: name, points and controls, in leaf space."""

    def __init__(self, parent=None) -> None:
        super().__init__(parent)
        self.curves = []
        self.text = ""
        self.setMinimumSize(200, 150)
        self.setToolTip(
            "The average leaf under the edits, from the front and from its right side; dots are control points."
        )

    def show_curves(self, curves: list) -> None:
        self.curves, self.text = curves, ""
        self.update()

    def show_text(self, text: str) -> None:
        self.curves, self.text = [], text
        self.update()

    def sizeHint(self) -> QtCore.QSize:
        return QtCore.QSize(300, 230)

    def paintEvent(self, _event) -> None:
        painter = QtGui.QPainter(self)
        painter.setRenderHint(QtGui.QPainter.Antialiasing)
        painter.fillRect(self.rect(), QtGui.QColor("#f3f2ee"))
        if not self.curves:
            painter.setPen(QtGui.QColor("#555555"))
            flags = QtCore.Qt.AlignCenter | QtCore.Qt.TextWordWrap
            painter.drawText(self.rect().adjusted(8, 8, -8, -8), flags, self.text)
            return
        # One scale for both views: a leaf that is curled beyond its length is drawn smaller, not cut.
        all_points = [
            point for curve in self.curves for points in (curve["points"], curve["controls"]) for point in points
        ]
        low, high = ([pick(numbers) for numbers in zip(*all_points, strict=True)] for pick in (min, max))
        wide, tall, deep = (max(high[k] - low[k], 1e-6) for k in range(3))
        gap = 0.15
        scale = min(
            self.height() * (1 - 2 * MARGIN) / tall,
            self.width() * (1 - 2 * MARGIN) / (wide + gap + max(deep, 0.2)),
        )
        left = (self.width() - scale * (wide + gap + max(deep, 0.2))) / 2
        bottom = (self.height() + scale * tall) / 2

        def front(point):
            return QtCore.QPointF(left + (point[0] - low[0]) * scale, bottom - (point[1] - low[1]) * scale)

        def side(point):
            across = left + (wide + gap + point[2] - low[2]) * scale
            return QtCore.QPointF(across, bottom - (point[1] - low[1]) * scale)

        for place in (front, side):
            self._draw(painter, place, filled=place is front)

    def _draw(self, painter, place, *, filled: bool) -> None:
        edges = [curve["points"] for curve in self.curves if curve["name"] == "silhouette"]
        if filled and len(edges) == 2:
            outline = [place(point) for point in [*edges[0], *reversed(edges[1])]]
            painter.setPen(QtCore.Qt.NoPen)
            painter.setBrush(QtGui.QColor(BLADE))
            painter.drawPolygon(QtGui.QPolygonF(outline))
        for curve in self.curves:
            color = QtGui.QColor(COLORS[curve["name"]])
            controls = [place(point) for point in curve["controls"]]
            painter.setBrush(QtCore.Qt.NoBrush)
            painter.setPen(QtGui.QPen(color, 1.0, QtCore.Qt.DotLine))
            painter.drawPolyline(QtGui.QPolygonF(controls))
            painter.setPen(QtGui.QPen(color, 1.8))
            painter.drawPolyline(QtGui.QPolygonF([place(point) for point in curve["points"]]))
            painter.setPen(QtCore.Qt.NoPen)
            painter.setBrush(color)
            for point in controls:
                painter.drawEllipse(point, 2.6, 2.6)
