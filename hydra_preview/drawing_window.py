"""The window of a photograph: strokes are drawn over it, and the tree of them grows beside it."""

from dataclasses import replace
from pathlib import Path

from drawing import (
    Drawing,
    History,
    Stroke,
    UnfinishedError,
    add_tree,
    choose_value,
    delete_stroke,
    draw_stroke,
    from_strokes,
    list_strokes,
    place_of_tree,
    to_strokes,
)
from drawing_canvas import DrawingCanvas
from drawing_link import DrawingLink
from grown_tree import GrownTree
from PySide6 import QtCore, QtGui, QtWidgets
from value_sliders import ValueSliders

PANEL_WIDTH_PX = 300
STROKES_FILTER = "Strokes (*.json)"
LAYERS = {"leaves": "Leaves that were found", "traced": "Branches that were traced", "strokes": "Strokes"}


class DrawingWindow(QtWidgets.QMainWindow):
    """One photograph, its strokes, its tree."""

    def __init__(self, request: dict, link: DrawingLink) -> None:
        super().__init__()
        self._title = request["title"]
        self._head, self._strokes_path = request["head"], request["strokes_path"]
        self._asks_to_close = request["script"] is None
        self.link = link
        self.history = History()
        self._trace_number = self._grow_number = 0
        self._grows = self._makes = False
        self._grown: Drawing | None = None  # of which the tree is
        self.seconds: list[float] = []  # of what was traced, from the stroke to its picture
        self.canvas = DrawingCanvas(request["photo"], request["head"]["width"])
        self.grown = GrownTree(request["dome_texture"], lambda: self.canvas.is_drawing)
        self.canvas.drawn.connect(self._add_stroke)
        self.canvas.chosen.connect(lambda _: self._refresh_actions())
        self.grown.failed.connect(lambda text: self._warn(f"the tree cannot be drawn: {text}"))
        self.link.ended.connect(lambda: self._warn("usdfoliage has ended; save nothing more, and start again"))
        self._add_actions()
        self._add_widgets(request["sliders"])
        self.resize(request["width_px"], request["height_px"])
        if request["strokes"] is not None:
            self.history = History(now=from_strokes(request["strokes"])).mark_saved()
        self._refresh(traces=True)

    @property
    def view(self):
        """Storm's view; None before a tree has grown."""
        return self.grown.view

    @property
    def drawing(self) -> Drawing:
        return self.history.now

    # What the window has

    def _add_actions(self) -> None:
        bar = self.addToolBar("Drawing")
        bar.setObjectName("drawing")
        bar.setMovable(False)

        def add(text: str, key: str, tip: str, does) -> QtGui.QAction:
            action = bar.addAction(text, does)
            action.setShortcut(QtGui.QKeySequence(key))
            action.setToolTip(f"{tip} ({key})" if key else tip)
            return action

        self.undo_action = add("Undo", "Ctrl+Z", "Take the last change back", self.undo)
        self.redo_action = add("Redo", "Ctrl+Shift+Z", "Make it again", self.redo)
        self.delete_action = add("Delete", "Del", "Delete the stroke that is chosen, or under the mouse", self.delete)
        bar.addSeparator()
        self.load_action = add("Load strokes…", "Ctrl+O", "Read strokes of a file", self._ask_and_load)
        self.save_action = add("Save strokes", "Ctrl+S", "Save strokes and sliders beside the photograph", self.save)
        self.propose_action = add("Propose", "", "Strokes that are found without a hand", self.propose)
        bar.addSeparator()
        self.fit_action = add("Fit", "F", "Show the whole photograph and the whole tree", self._fit)
        self.grow_action = add("Grow", "G", "Grow the tree of the strokes", self.grow)
        self.stop_action = add("Stop", "Esc", "Stop the growth", self.stop)
        self.make_action = add("Save asset…", "Ctrl+E", "Make the asset, as usdfoliage sketch does", self._ask_and_make)

    def _add_widgets(self, rows: list[dict]) -> None:
        self.hint = QtWidgets.QLabel()
        self.hint.setSizePolicy(QtWidgets.QSizePolicy.Ignored, QtWidgets.QSizePolicy.Fixed)  # never widens the window
        self.hint.setStyleSheet("padding: 5px; background: #2f3133; color: #e8e8e8;")
        left = QtWidgets.QWidget()
        column = QtWidgets.QVBoxLayout(left)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(0)
        column.addWidget(self.hint)
        column.addWidget(self.canvas, 1)
        splitter = QtWidgets.QSplitter()
        splitter.addWidget(left)
        splitter.addWidget(self.grown)
        splitter.setSizes([600, 400])
        splitter.setStretchFactor(0, 3)
        splitter.setStretchFactor(1, 2)
        self.setCentralWidget(splitter)

        self.sliders = ValueSliders(rows)
        self.sliders.chosen.connect(self._choose)
        self.tree_box = QtWidgets.QComboBox()
        self.tree_box.setToolTip("The tree that is drawn")
        self.tree_box.activated.connect(self.choose_tree)
        self.new_tree_button = QtWidgets.QPushButton("New tree")
        self.new_tree_button.setToolTip("Draw another tree of the same photograph")
        self.new_tree_button.clicked.connect(lambda: self._change(add_tree(self.drawing)))
        trees = QtWidgets.QHBoxLayout()
        trees.addWidget(self.tree_box, 1)
        trees.addWidget(self.new_tree_button)
        self.turn_box = QtWidgets.QCheckBox("Turn the tree")
        self.turn_box.setChecked(True)
        self.turn_box.toggled.connect(self.grown.set_turning)
        self.layer_boxes = {}
        self.facts = QtWidgets.QLabel()
        self.facts.setWordWrap(True)
        panel = QtWidgets.QWidget()
        column = QtWidgets.QVBoxLayout(panel)
        column.addLayout(trees)
        column.addWidget(self.sliders)
        column.addWidget(self.turn_box)
        for name, text in LAYERS.items():
            box = QtWidgets.QCheckBox(text)
            box.setChecked(True)
            box.toggled.connect(lambda on, name=name: self.canvas.show_layer(name, on))
            self.layer_boxes[name] = box
            column.addWidget(box)
        column.addWidget(self.facts)
        column.addStretch(1)
        dock = QtWidgets.QDockWidget("Tree")
        dock.setObjectName("tree")
        dock.setWidget(panel)
        dock.setFeatures(QtWidgets.QDockWidget.DockWidgetMovable | QtWidgets.QDockWidget.DockWidgetFloatable)
        self.addDockWidget(QtCore.Qt.RightDockWidgetArea, dock)
        self.resizeDocks([dock], [PANEL_WIDTH_PX], QtCore.Qt.Horizontal)
        self.progress = QtWidgets.QProgressBar()
        self.progress.setRange(0, 100)
        self.progress.setMaximumWidth(260)
        self.progress.hide()
        self.statusBar().addPermanentWidget(self.progress)

    # Changes

    def undo(self) -> None:
        self._step(self.history.undo())

    def redo(self) -> None:
        self._step(self.history.redo())

    def delete(self) -> None:
        stroke: Stroke | None = self.canvas.selected or self.canvas.hovered
        if stroke is None:
            self._report("Click a stroke first; Delete removes it then")
            return
        self._change(delete_stroke(self.drawing, stroke))

    def choose_tree(self, number: int) -> None:
        """Draw this one of the trees; it is no change of the drawing."""
        self.history = replace(self.history, now=replace(self.drawing, current=number))
        self._refresh(traces=True)

    def _add_stroke(self, kind: str, line: tuple) -> None:
        self._change(draw_stroke(self.drawing, kind, line))

    def _choose(self, name: str, value: float | None) -> None:
        before = self.drawing
        if name == "seed" and value is not None:
            value = round(value)
        self._change(choose_value(before, name, value), traces=False)
        if self.drawing != before and self._grown is not None:
            self.grow()

    def _change(self, drawing: Drawing, *, traces: bool = True) -> None:
        self.history = self.history.do(drawing)
        self._refresh(traces=traces)

    def _step(self, history: History) -> None:
        traces = history.now.tree != self.drawing.tree
        regrows = history.now.values != self.drawing.values and self._grown is not None
        self.history = history
        self._refresh(traces=traces)
        if regrows:
            self.grow()

    def _refresh(self, *, traces: bool) -> None:
        """Show the drawing everywhere; traces: its strokes are others."""
        drawing = self.drawing
        self.canvas.show_drawing(drawing)
        self.sliders.show_values(dict(drawing.values))
        self.tree_box.clear()
        self.tree_box.addItems([f"Tree {number}" for number in range(1, len(drawing.trees) + 1)])
        self.tree_box.setCurrentIndex(drawing.current)
        self._refresh_actions()
        if traces:
            self._trace()

    def _refresh_actions(self) -> None:
        drawing, history = self.drawing, self.history
        has_crown = len(drawing.tree.crown) >= 3
        self.undo_action.setEnabled(bool(history.before))
        self.redo_action.setEnabled(bool(history.after))
        self.delete_action.setEnabled(bool(list_strokes(drawing.tree)))
        self.grow_action.setEnabled(has_crown and not self._makes)
        self.make_action.setEnabled(has_crown and not self._makes)
        self.stop_action.setEnabled(self._grows)
        self.setWindowTitle(f"{'' if history.is_saved else '*'}{self._title} – usdfoliage")
        self.hint.setText(self._hint())

    def _hint(self) -> str:
        tree = self.drawing.tree
        if not tree.crown:
            return "Draw around the leaves of the tree: left button"
        if not tree.branches:
            return "Draw up the trunk, from the root into the crown: right button"
        if self.canvas.selected is not None:
            return "Delete removes the stroke that is chosen"
        if self._grown is None or (self._grown.tree != tree and not self._grows):
            return "G grows the tree. Right button: more branches. Delete: removes a stroke"
        return "Sliders change the tree. Ctrl+S saves the strokes, Ctrl+E the asset"

    # Tracing

    def _trace(self) -> None:
        self.link.forget(self._trace_number)
        tree = self.drawing.tree
        clock = QtCore.QElapsedTimer()
        clock.start()

        def receive(reply: dict) -> None:
            if "error" in reply:
                self.canvas.show_traced("", [])
                self._warn(reply["error"])
                return
            self.canvas.show_traced(reply["foliage"], reply["branches"])
            if not tree.crown:
                return
            self.seconds.append(clock.elapsed() / 1000)
            self._report(
                "Looking for the leaves…"
                if reply["rough"]
                else f"traced in {reply['seconds']:.2f} s; branches: {len(reply['branches'])}"
            )

        crown = [list(point) for point in tree.crown]
        branches = [[list(point) for point in line] for line in tree.branches]
        self._trace_number = self.link.ask(
            receive, op="trace", tree={"crown": crown, "branches": branches}, settings=dict(self.drawing.values)
        )

    # Growing

    def grow(self) -> None:
        """Grow the current tree, in place of one that grows."""
        drawing = self.drawing
        if not drawing.tree.crown or self._makes:
            self._report(self._hint())
            return
        strokes = self._finished_strokes()
        if strokes is None:
            return
        self.link.forget(self._grow_number)
        self._grows, self._grown = True, drawing

        def receive(reply: dict) -> None:
            if "shoots" in reply:
                self.grown.show_shoots(reply["shoots"], reply["first"])
            elif "step" in reply:
                self._show_progress(reply["step"], reply["share"])
            elif "asset" in reply:
                self._end_progress()
                self.grown.show_asset(reply["asset"])
                self.facts.setText("\n".join([*reply["facts"], "", *reply["remarks"]]))
                self._report("Grown")
            else:
                self._end_progress()
                self._grown = None
                self._warn(reply["error"]) if "error" in reply else self._report("Stopped")
                self._refresh_actions()

        self._grow_number = self.link.ask(receive, op="grow", strokes=strokes, tree=place_of_tree(drawing))
        self._report("The tree grows…")
        self._show_progress("tree", 0.0)
        self._refresh_actions()

    def stop(self) -> None:
        if self._grows:
            self.link.stop_growth()

    def _show_progress(self, step: str, share: float) -> None:
        self.progress.show()
        self.progress.setValue(round(100 * share))
        self.progress.setFormat(f"{step} %p %")

    def _end_progress(self) -> None:
        self.progress.hide()
        self._grows = self._makes = False
        self._refresh_actions()

    def _finished_strokes(self) -> dict | None:
        """The drawing as a file has it; None, with a warning, where it is none yet."""
        try:
            return to_strokes(self.drawing, self._head)
        except UnfinishedError as error:
            self._warn(str(error))
            return None

    # Files

    def save(self) -> None:
        """Save strokes and sliders beside the photograph, where usdfoliage sketch finds them."""
        self.write(self._strokes_path)

    def write(self, path: str) -> None:
        """Write strokes and sliders into a file."""
        drawing = self.drawing
        strokes = self._finished_strokes()
        if strokes is None:
            return

        def receive(reply: dict) -> None:
            if "error" in reply:
                self._warn(reply["error"])
                return
            if path == self._strokes_path:
                self._mark_saved(drawing)
            self._report(f"strokes: {reply['written']}")

        self.link.ask(receive, op="write", path=path, strokes=strokes)

    def load(self, path: str) -> None:
        """Take the strokes of a file in place of the drawing; undo brings it back."""

        def receive(reply: dict) -> None:
            if "error" in reply:
                self._warn(reply["error"])
                return
            self._change(from_strokes(reply["strokes"]))
            self._report(f"loaded: {path}")

        self.link.ask(receive, op="read", path=path)

    def propose(self) -> None:
        """Strokes that are found without a hand, in place of those of the current tree."""

        def receive(reply: dict) -> None:
            if "error" in reply:
                self._warn(reply["error"])
                return
            self._change(self.drawing.with_tree(from_strokes(reply["strokes"]).tree))

        self._report("Looking for the tree…")
        self.link.ask(receive, op="propose")

    def make(self, path: str, *, preview: bool = True) -> None:
        """Save the strokes, and make the asset of them."""
        drawing = self.drawing
        strokes = self._finished_strokes()
        if strokes is None:
            return
        self._makes, self._grows = True, False
        self.link.forget(self._grow_number)

        def receive(reply: dict) -> None:
            if "step" in reply:
                self._show_progress(reply["step"], reply["share"])
                return
            self._end_progress()
            if "error" in reply:
                self._warn(reply["error"])
                return
            self._mark_saved(drawing)
            self._report(f"asset: {reply['asset']}; strokes: {self._strokes_path}")

        self.link.ask(receive, op="make", path=path, strokes_path=self._strokes_path, strokes=strokes, preview=preview)
        self._show_progress("tree", 0.0)
        self._refresh_actions()

    def _mark_saved(self, drawing: Drawing) -> None:
        self.history = replace(self.history, saved=drawing)
        self._refresh_actions()

    def _ask_and_load(self) -> None:
        folder = str(Path(self._strokes_path).parent)
        path, _ = QtWidgets.QFileDialog.getOpenFileName(self, "Load strokes", folder, STROKES_FILTER)
        if path:
            self.load(path)

    def _ask_and_make(self) -> None:
        suggested = str(Path(self._strokes_path).parent / Path(self._title).stem)
        path, _ = QtWidgets.QFileDialog.getSaveFileName(
            self, "Save asset: a name for its folder", suggested, options=QtWidgets.QFileDialog.DontConfirmOverwrite
        )
        if path:
            self.make(path)

    def _fit(self) -> None:
        self.canvas.fit()
        self.grown.frame_all()

    # Messages

    def _report(self, text: str) -> None:
        self.statusBar().setStyleSheet("")
        self.statusBar().showMessage(text)

    def _warn(self, text: str) -> None:
        self.statusBar().setStyleSheet("QStatusBar { background: #7a1f1a; color: white; }")
        self.statusBar().showMessage(text)

    def closeEvent(self, event) -> None:
        if self._asks_to_close and not self.history.is_saved:
            buttons = QtWidgets.QMessageBox
            answer = buttons.question(
                self,
                "Close",
                "The strokes are not saved.",
                buttons.Save | buttons.Discard | buttons.Cancel,
                buttons.Save,
            )
            if answer == buttons.Cancel:
                event.ignore()
                return
            if answer == buttons.Save:
                self.save()
                if self.link.waits:  # it closes when they are written
                    QtCore.QTimer.singleShot(100, self.close)
                    event.ignore()
                    return
        event.accept()
