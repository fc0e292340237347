"""Strokes over a photograph while they are drawn: a value, what changes it, and the way back. It knows no Qt."""

import math
from dataclasses import dataclass, field, replace
from itertools import pairwise

Point = tuple[float, float]  # pixels of the photograph: x to the right, y down
Line = tuple[Point, ...]

CROWN, BRANCH = "crown", "branch"
MIN_STROKE_PX = 3.0  # of the screen: what is shorter is a click
_DIGITS = 2  # of a pixel, as a file of strokes has them


@dataclass(frozen=True)
class DrawnTree:
    """The strokes of one tree."""

    crown: Line = ()
    branches: tuple[Line, ...] = ()

    @property
    def is_empty(self) -> bool:
        return not self.crown and not self.branches


@dataclass(frozen=True)
class Stroke:
    """Which stroke of a tree is meant."""

    kind: str  # CROWN or BRANCH
    number: int = 0  # of the branch


@dataclass(frozen=True)
class Drawing:
    """All that is drawn over one photograph."""

    trees: tuple[DrawnTree, ...] = (DrawnTree(),)
    current: int = 0  # tree that is drawn
    values: tuple[tuple[str, float], ...] = ()  # of sliders that somebody moved, by name

    @property
    def tree(self) -> DrawnTree:
        return self.trees[self.current]

    def with_tree(self, tree: DrawnTree) -> "Drawing":
        trees = (*self.trees[: self.current], tree, *self.trees[self.current + 1 :])
        return replace(self, trees=trees)


def draw_stroke(drawing: Drawing, kind: str, points: Line) -> Drawing:
    """With one stroke more; a crown takes the place of the one before."""
    line = _rounded(points)
    tree = drawing.tree
    if kind == CROWN:
        return drawing.with_tree(replace(tree, crown=line))
    return drawing.with_tree(replace(tree, branches=(*tree.branches, line)))


def delete_stroke(drawing: Drawing, stroke: Stroke) -> Drawing:
    """Without a stroke of the current tree."""
    tree = drawing.tree
    if stroke.kind == CROWN:
        return drawing.with_tree(replace(tree, crown=()))
    branches = (*tree.branches[: stroke.number], *tree.branches[stroke.number + 1 :])
    return drawing.with_tree(replace(tree, branches=branches))


def add_tree(drawing: Drawing) -> Drawing:
    """With one tree more, which is drawn next; an empty one at the end is taken first."""
    if drawing.trees[-1].is_empty:
        return replace(drawing, current=len(drawing.trees) - 1)
    return replace(drawing, trees=(*drawing.trees, DrawnTree()), current=len(drawing.trees))


def choose_value(drawing: Drawing, name: str, value: float | None) -> Drawing:
    """With a slider moved; None: with none of this name any more."""
    values = {**dict(drawing.values), name: value}
    return replace(drawing, values=tuple(sorted((each, v) for each, v in values.items() if v is not None)))


def list_strokes(tree: DrawnTree) -> list[tuple[Stroke, Line]]:
    """All strokes of a tree, the crown first."""
    crown = [(Stroke(CROWN), tree.crown)] if tree.crown else []
    return crown + [(Stroke(BRANCH, number), line) for number, line in enumerate(tree.branches)]


def find_stroke(tree: DrawnTree, at: Point, reach_px: float) -> Stroke | None:
    """The stroke that is nearest to a place, within reach; None where there is none."""
    nearest, found = reach_px, None
    for stroke, line in list_strokes(tree):
        closed = (*line, line[0]) if stroke.kind == CROWN else line
        away = distance_to(closed, at)
        if away <= nearest:
            nearest, found = away, stroke
    return found


def distance_to(line: Line, at: Point) -> float:
    """From a place to the nearest one of a line."""
    return min(_distance(at, one, two) for one, two in zip(line, line[1:] or line, strict=False))


def length_of(line: Line) -> float:
    return sum(math.dist(one, two) for one, two in pairwise(line))


def simplify(line: Line, tolerance_px: float) -> Line:
    """A line of fewer points, none of the others farther from it than this (Douglas and Peucker)."""
    if len(line) < 3:
        return line
    keeps = {0, len(line) - 1}
    spans = [(0, len(line) - 1)]
    while spans:
        first, last = spans.pop()
        if last - first < 2:
            continue
        away = [_distance(line[at], line[first], line[last]) for at in range(first + 1, last)]
        farthest = max(range(len(away)), key=away.__getitem__)
        if away[farthest] > tolerance_px:
            at = first + 1 + farthest
            keeps.add(at)
            spans += [(first, at), (at, last)]
    return tuple(line[at] for at in sorted(keeps))


def _distance(at: Point, one: Point, two: Point) -> float:
    along = (two[0] - one[0], two[1] - one[1])
    square = along[0] ** 2 + along[1] ** 2
    share = 0.0
    if square > 0:
        share = ((at[0] - one[0]) * along[0] + (at[1] - one[1]) * along[1]) / square
        share = min(max(share, 0.0), 1.0)
    return math.dist(at, (one[0] + share * along[0], one[1] + share * along[1]))


def _rounded(line: Line) -> Line:
    """As a file has it, without points that follow themselves."""
    rounded = [(round(x, _DIGITS), round(y, _DIGITS)) for x, y in line]
    return tuple(point for at, point in enumerate(rounded) if at == 0 or point != rounded[at - 1])


# Files


class UnfinishedError(Exception):
    """A drawing that cannot be saved yet."""


def to_strokes(drawing: Drawing, head: dict) -> dict:
    """What a file of strokes holds: head is the photograph's name and size.

    Raises:
        UnfinishedError: There is no tree, or one without a crown.
    """
    drawn = [tree for tree in drawing.trees if not tree.is_empty]
    if not drawn:
        raise UnfinishedError("nothing is drawn yet: draw around the crown with the left button")
    if any(len(tree.crown) < 3 for tree in drawn):
        raise UnfinishedError("a tree has no crown yet: draw around it with the left button")
    trees = [
        {"crown": [list(point) for point in tree.crown], "branches": [[list(p) for p in b] for b in tree.branches]}
        for tree in drawn
    ]
    return {**head, "trees": trees, **({"settings": dict(drawing.values)} if drawing.values else {})}


def place_of_tree(drawing: Drawing) -> int:
    """The number of the current tree among those that to_strokes writes."""
    return sum(not tree.is_empty for tree in drawing.trees[: drawing.current])


def from_strokes(strokes: dict) -> Drawing:
    """The drawing of a file of strokes, as usdfoliage has read it."""
    trees = strokes.get("trees", [strokes])
    return Drawing(
        trees=tuple(
            DrawnTree(
                crown=tuple(map(tuple, tree["crown"])),
                branches=tuple(tuple(map(tuple, line)) for line in tree["branches"]),
            )
            for tree in trees
        ),
        values=tuple(sorted(strokes.get("settings", {}).items())),
    )


# The way back


@dataclass(frozen=True)
class History:
    """A drawing, those before it, and those that were undone."""

    now: Drawing = field(default_factory=Drawing)
    before: tuple[Drawing, ...] = ()
    after: tuple[Drawing, ...] = ()
    saved: Drawing | None = None  # as the file has it

    @property
    def is_saved(self) -> bool:
        empty = all(tree.is_empty for tree in self.now.trees)
        return empty if self.saved is None else _content(self.saved) == _content(self.now)

    def do(self, drawing: Drawing) -> "History":
        """With a new drawing; what was undone is gone. The same drawing changes nothing."""
        if drawing == self.now:
            return self
        return replace(self, now=drawing, before=(*self.before, self.now), after=())

    def undo(self) -> "History":
        if not self.before:
            return self
        return replace(self, now=self.before[-1], before=self.before[:-1], after=(self.now, *self.after))

    def redo(self) -> "History":
        if not self.after:
            return self
        return replace(self, now=self.after[0], before=(*self.before, self.now), after=self.after[1:])

    def mark_saved(self) -> "History":
        return replace(self, saved=self.now)


def _content(drawing: Drawing) -> tuple:
    """What of a drawing is saved."""
    return tuple(tree for tree in drawing.trees if not tree.is_empty), drawing.values
