"""Branches that a photograph shows, traced from the strokes over it.

P. Tan et al., Single image tree modeling, 2008, section 2: the colours under the strokes and those elsewhere are two
mixtures, and a circle moves along a branch to the clusters of its pixels that are of branches. A circle loses thin
branches, whose pixels have gaps. Here the same pixels are followed by cheapest ways from the strokes, along the middle
of branches and across short gaps; the longest way is a branch, then the longest of those that leave it, and so on. A
stroke is a branch also where leaves hide it.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra

from usdfoliage.geometry.lines import arc_lengths, points_at
from usdfoliage.sketch.drawing import SHIFT, dilate, draw_lines, fixed_points
from usdfoliage.sketch.foliage import Foliage, fill_outline
from usdfoliage.sketch.mixtures import Mixture, fit_mixture, log_density
from usdfoliage.sketch.strokes import TreeStrokes

Floats = NDArray[np.float64]

_PAPER_PX = 1500.0  # longer side of the paper's pictures
_STRAIGHT_DEG = 30.0  # joints that bend less are left out,
_OFF_CHORD = 0.08  # unless the branch would move by more than this share of its edge
_FEW_PIXELS = 30  # that are enough for the colours of branches
_FEW_COLORS = 0.2  # share of the colours under the strokes, that is enough if all others are those of leaves
_UNSEEN = 0.7  # pixels: half of the thickness of a branch that the picture does not show
_HIDDEN = 0.02  # weight of a point of a stroke that shows no branch, where a stroke is made smooth
_ONWARD = 0.7  # cosine of the angle by which a branch turns at most where a stroke of it ends
_FREE, _NONE = -1, -2  # a pixel of no branch yet, and one on a way that is none


@dataclass(frozen=True, kw_only=True)
class TraceSettings:
    """How branches are followed. Lengths are pixels of a picture of 1500."""

    components: int = 5  # of either mixture
    stroke_width: float = 4.0  # under which colours are those of branches
    like_leaves: float = 1.5  # standard deviations between means, within which a component is one of leaves
    through: float = 0.7  # of the pixels of a way must show a branch
    gap: float = 5.0  # that a way crosses
    gap_cost: float = 8.0  # of a pixel of a gap, in those of a branch
    border_cost: float = 2.0  # of a pixel at the border of a branch
    widest: float = 1.0  # of the parent's thickness
    shortest: float = 40.0  # branch that counts
    within: float = 0.5  # of a branch, that is inside of the crown's stroke: shade below it looks like bark
    beyond: float = 0.03  # of the crown's width, that branches may go beyond its stroke

    def __post_init__(self) -> None:
        for name in ("stroke_width", "gap", "shortest", "widest"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be above 0, not {getattr(self, name)}")
        if self.components < 1:
            raise ValueError(f"components must be 1 or more, not {self.components}")


@dataclass(frozen=True, kw_only=True, eq=False)
class TracedBranch:
    """One branch in the picture."""

    points_px: Floats  # (K, 2), from its parent or the root on
    half_px: Floats  # (K,) half of its thickness as the picture shows it; NaN where it is hidden
    parent: int  # -1 for one that begins at a root
    parent_point: int  # of the parent
    drawn: bool  # by hand


@dataclass(frozen=True, kw_only=True, eq=False)
class TracedTree:
    """The branches of a tree in its photograph, each after its parent."""

    branches: tuple[TracedBranch, ...]
    likely: NDArray[np.float32]  # (H, W) logarithm of odds for a branch


def branch_odds(
    srgb: NDArray[np.uint8],
    strokes: TreeStrokes,
    foliage: Foliage | None,
    seed: int,
    settings: TraceSettings = TraceSettings(),
) -> NDArray[np.float32]:
    """(H, W) logarithm of how much likelier a pixel's colour is under a stroke of a branch than elsewhere.

    Below a crown of leaves the stem has colours of its own, and is compared with what is outside of the crown.

    Args:
        srgb: (H, W, 3), the photograph.
        strokes: Of the tree, at least one of a branch.
        foliage: Its leaves; components of the branches' colours that are theirs are left out.
        seed: Of the mixtures.
        settings: How.
    """
    height, width = srgb.shape[:2]
    scale = max(height, width) / _PAPER_PX
    under = draw_lines(strokes.branches_px, srgb.shape, max(1, round(settings.stroke_width * scale)))
    beside = cv2.dilate(under.astype(np.uint8), np.ones((3, 3), np.uint8), iterations=max(1, round(6 * scale)))
    colors = srgb.astype(np.float64)
    visible = under.copy()
    if foliage is not None and not foliage.is_thin and (visible & ~foliage.mask).sum() >= _FEW_PIXELS:
        visible &= ~foliage.mask  # leaves hide what the stroke goes on over
    code, seen = _colors_once(srgb)

    def odds_of(under: Mixture, elsewhere: NDArray[np.bool_]) -> NDArray[np.float32]:
        other = fit_mixture(colors[elsewhere], settings.components, seed + 1)
        odds = log_density(under, seen) - log_density(other, seen)
        return np.asarray(np.clip(odds, -20, 20)[code].reshape(height, width), np.float32)

    branch = fit_mixture(colors[visible], settings.components, seed)
    if foliage is None or foliage.is_bare:
        return odds_of(branch, beside == 0)
    apart = _distances(branch, foliage.leaves).min(axis=1) > settings.like_leaves
    if branch.weight[apart].sum() >= _FEW_COLORS:
        found = odds_of(branch.only(apart), beside == 0)
    else:
        found = np.full((height, width), -20, np.float32)  # branches have no colours that leaves have not
    outside = ~foliage.inside
    stem, around = visible & outside, (beside == 0) & outside
    if stem.sum() >= _FEW_PIXELS and around.sum() >= _FEW_PIXELS:
        if np.median(found[stem]) < 0:  # what was seen between leaves was no branch
            found[:] = -20
        below = odds_of(fit_mixture(colors[stem], settings.components, seed), around)
        # One bright spot of the bark would halve the thickness.
        found[outside] = cv2.medianBlur(below, 5)[outside]
    return found


def _colors_once(srgb: NDArray[np.uint8]) -> tuple[NDArray[np.int64], Floats]:
    """(H * W,) the number of each pixel's colour, and (K, 3) these colours, slightly blurred, to 2 of 255.

    A picture of a million pixels has some ten thousand.
    """
    smooth = (cv2.GaussianBlur(srgb, (0, 0), 0.6) >> 1).astype(np.int32)
    code = (smooth[..., 0] << 14) | (smooth[..., 1] << 7) | smooth[..., 2]
    codes, number = np.unique(code, return_inverse=True)
    return number.reshape(-1), 2.0 * np.stack([codes >> 14, codes >> 7 & 127, codes & 127], axis=-1) + 0.5


def trace_tree(
    odds: NDArray[np.float32],
    strokes: TreeStrokes,
    settings: TraceSettings = TraceSettings(),
) -> TracedTree:
    """Follow branches from the strokes of a tree to all pixels that show one.

    Args:
        odds: (H, W), as branch_odds gives them.
        strokes: Of the tree; its first branch begins at the root.
        settings: How.
    """
    height, width = odds.shape
    scale = max(height, width) / _PAPER_PX
    is_branch = odds > 0
    depth = cv2.distanceTransform(is_branch.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    drawn = _draw_along(strokes, depth, scale, settings)
    crown = fill_outline(strokes.crown_px, (width, height))
    domain = dilate(crown, settings.beyond * float(np.ptp(strokes.crown_px[:, 0])))
    growth = _Growth(depth, drawn, crown)
    paths = _cheapest_paths(odds, depth, domain, growth.owner >= 0, scale, settings)
    shortest = settings.shortest * scale
    for end in paths.ends:
        growth.add_path(paths, int(end), shortest, settings)
    return TracedTree(branches=growth.finish(), likely=odds)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Paths:
    """Cheapest ways from the strokes to pixels."""

    before: NDArray[np.int64]  # (H * W,) the pixel before on its way, -1 at a stroke and where there is none
    ends: NDArray[np.int64]  # (E,) pixels of branches, by the length of their ways, the longest first
    shows: NDArray[np.bool_]  # (H * W,) whether a pixel is one of a branch


def _cheapest_paths(
    odds: NDArray[np.float32],
    depth: NDArray[np.float32],
    domain: NDArray[np.bool_],
    begin: NDArray[np.bool_],
    scale: float,
    settings: TraceSettings,
) -> _Paths:
    """Ways along the middle of branches, and across short gaps, from the pixels where they begin."""
    shows = (odds > 0) & (domain | begin)
    gap = max(1.5, settings.gap * scale)
    node = (dilate(shows, gap) & domain) | begin
    number = np.full(odds.shape, -1, np.int64)
    number[node] = np.arange(np.count_nonzero(node))
    # A pixel in the middle costs less than one of the border, and one that shows no branch the most.
    price = np.where(shows, 1 + settings.border_cost / (depth + 0.5), 1 + 2 * settings.border_cost + settings.gap_cost)
    rows, columns, costs = [], [], []
    height, width = odds.shape
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        one = np.s_[: height - down, max(-right, 0) : width - max(right, 0)]
        two = np.s_[down:, max(right, 0) : width + min(right, 0)]
        both = (number[one] >= 0) & (number[two] >= 0)
        rows.append(number[one][both])
        columns.append(number[two][both])
        costs.append((np.hypot(down, right) * 0.5 * (price[one] + price[two]))[both])
    count = int(node.sum())
    graph = csr_array(
        coo_array((np.concatenate(costs), (np.concatenate(rows), np.concatenate(columns))), (count, count))
    )
    cost, before, _ = dijkstra(graph, directed=False, indices=number[begin], min_only=True, return_predecessors=True)
    pixel = np.flatnonzero(node)
    back = np.full(odds.size, -1, np.int64)
    back[pixel] = np.where(before >= 0, pixel[np.maximum(before, 0)], -1)
    reached = np.isfinite(cost) & shows.ravel()[pixel] & (cost > 0)
    order = np.argsort(-cost[reached], kind="stable")
    return _Paths(before=back, ends=pixel[reached][order], shows=shows.ravel())


@dataclass(eq=False)
class _Growing:
    """A branch that may still be left from."""

    points: Floats
    half: Floats
    parent: int
    parent_point: int
    drawn: bool
    forks: set[int]


class _Growth:
    """Branches so far, and which pixels they cover."""

    def __init__(
        self, depth: NDArray[np.float32], drawn: list[tuple[Floats, Floats]], crown: NDArray[np.bool_]
    ) -> None:
        self.depth = depth
        self.crown = crown  # inside of its stroke
        self.width = depth.shape[1]
        self.owner = np.full(depth.shape, _FREE, np.int32)  # branch that covers a pixel
        self.point = np.full(depth.shape, -1, np.int32)  # and which point of it
        self.branches: list[_Growing] = []
        for points, half in drawn:
            parent, at = -1, -1
            if self.branches:
                parent, at = self.nearest(points[0])
                points = np.concatenate([self.branches[parent].points[at : at + 1], points[1:]])
                self.branches[parent].forks.add(at)
            self.branches.append(
                _Growing(points=points, half=half, parent=parent, parent_point=at, drawn=True, forks=set())
            )
            self.cover(len(self.branches) - 1)

    def nearest(self, place: Floats) -> tuple[int, int]:
        """The point of a branch that is nearest to a place."""
        away = [float(np.linalg.norm(each.points - place, axis=1).min()) for each in self.branches]
        number = int(np.argmin(away))
        return number, int(np.linalg.norm(self.branches[number].points - place, axis=1).argmin())

    def cover(self, number: int) -> None:
        """Mark the pixels of a branch, and those beside it that show nothing else."""
        branch = self.branches[number]
        free = self.owner < 0
        marked = np.zeros(self.owner.shape, np.int32)
        for at in range(len(branch.points) - 1):
            wide = max(3, round(2 * float(branch.half[at : at + 2].max()) + 3))
            cv2.polylines(marked, [fixed_points(branch.points[at : at + 2])], False, at + 1, wide, shift=SHIFT)
        new = free & (marked > 0)
        self.owner[new] = number
        self.point[new] = marked[new] - 1

    def add_path(self, paths: _Paths, end: int, shortest: float, settings: TraceSettings) -> None:
        """A branch along the way to a pixel, from the branch that it comes from, where it is long and sure enough."""
        owner, point = self.owner.ravel(), self.point.ravel()
        if owner[end] != _FREE:
            return
        track = [end]
        while owner[track[-1]] == _FREE and paths.before[track[-1]] >= 0:
            track.append(int(paths.before[track[-1]]))
        last = track[-1]
        if owner[last] == _NONE:  # it joins a way that was too short
            owner[track] = _NONE
            return
        pixels = np.array(track[::-1])
        places = np.stack([pixels % self.width + 0.5, pixels // self.width + 0.5], axis=-1)
        arc = arc_lengths(places)
        parent, at = int(owner[last]), int(point[last])
        visible = paths.shows[pixels].mean()
        half = np.maximum(self.depth.ravel()[pixels], _UNSEEN)
        carrying = self.branches[parent]
        at += int(np.linalg.norm(carrying.points[at + 1] - places[0]) < np.linalg.norm(carrying.points[at] - places[0]))
        if (
            arc[-1] < shortest
            or visible < settings.through
            or self.crown.ravel()[pixels].mean() < settings.within
            or np.median(half) > settings.widest * float(carrying.half[at]) + 0.5
        ):
            owner[pixels[owner[pixels] == _FREE]] = _NONE
            return
        line = _even(_smooth(places), max(3.0, 0.1 * shortest))
        along = np.interp(np.linspace(0, arc[-1], len(line)), arc, half)
        if carrying.drawn and at == len(carrying.points) - 1 and at not in carrying.forks:
            ahead, arrived = line[len(line) // 3] - carrying.points[-1], carrying.points[-1] - carrying.points[-2]
            if ahead @ arrived > _ONWARD * np.linalg.norm(ahead) * np.linalg.norm(arrived):
                # A stroke ends where somebody stopped drawing; the branch goes on.
                carrying.points = np.concatenate([carrying.points, line[1:]])
                carrying.half = np.concatenate([carrying.half, np.minimum(along[1:], carrying.half[at])])
                self.cover(parent)
                return
        line[0] = carrying.points[at]
        carrying.forks.add(at)
        self.branches.append(
            _Growing(
                points=line,
                half=np.minimum(along, carrying.half[at]),
                parent=parent,
                parent_point=at,
                drawn=False,
                forks=set(),
            )
        )
        self.cover(len(self.branches) - 1)

    def finish(self) -> tuple[TracedBranch, ...]:
        """The branches with few joints."""
        joints = [_joints(each.points, each.forks) for each in self.branches]
        return tuple(
            TracedBranch(
                points_px=each.points[chosen],
                half_px=np.where(each.half[chosen] > _UNSEEN, each.half[chosen], np.nan),
                parent=each.parent,
                parent_point=-1 if each.parent < 0 else int(np.searchsorted(joints[each.parent], each.parent_point)),
                drawn=each.drawn,
            )
            for each, chosen in zip(self.branches, joints, strict=True)
        )


def _draw_along(
    strokes: TreeStrokes, depth: NDArray[np.float32], scale: float, settings: TraceSettings
) -> list[tuple[Floats, Floats]]:
    """Points along each stroke, in the middle of what it is drawn over, and half of the thickness there."""
    lines = []
    for stroke in strokes.branches_px:
        drawn = _even(stroke, max(4.0, 8 * scale))
        points = np.array([_centre(depth, point, scale, settings) for point in drawn])
        shows = _at(depth, points) > 0
        points = _fair(points, np.where(shows, 1.0, _HIDDEN))
        lines.append((points, _half_along(_at(depth, points), shows)))
    return lines


def _at(image: NDArray[np.float32], points: Floats) -> Floats:
    x, y = np.clip(np.floor(points).astype(int), 0, [image.shape[1] - 1, image.shape[0] - 1]).T
    return image[y, x].astype(np.float64)


def _half_along(half: Floats, shows: NDArray[np.bool_]) -> Floats:
    """(K,) half of the thickness, where it is hidden that of the last place that shows it, becoming thinner."""
    if not shows.any():
        return np.full(len(half), _UNSEEN)
    at = np.arange(len(half))
    known = np.interp(at, at[shows], half[shows])
    return np.maximum(known, _UNSEEN)


def _fair(points: Floats, weight: Floats) -> Floats:
    """A smooth line (K, 2) near points by their weights (Whittaker), which keeps its ends."""
    count = len(points)
    if count < 5:
        return points
    weight = weight.copy()
    weight[[0, -1]] = 10.0
    second = np.diff(np.eye(count), 2, axis=0)
    stiffness = 0.02 * (0.08 * count) ** 4 * _HIDDEN + 0.5
    return np.asarray(np.linalg.solve(np.diag(weight) + stiffness * second.T @ second, weight[:, None] * points))


def _centre(depth: NDArray[np.float32], point: Floats, scale: float, settings: TraceSettings) -> Floats:
    """The middle of the branch beside a point of a stroke, within its reach; the point where there is none."""
    reach = int(max(3, 2 * settings.stroke_width * scale))
    x, y = np.floor(point).astype(int)
    x0, y0 = max(x - reach, 0), max(y - reach, 0)
    part = depth[y0 : max(y + reach + 1, 0), x0 : max(x + reach + 1, 0)]
    if not part.size or part.max() <= 0:
        return point
    rows, columns = np.mgrid[: part.shape[0], : part.shape[1]]
    away = np.hypot(columns + x0 + 0.5 - point[0], rows + y0 + 0.5 - point[1])
    row, column = divmod(int(np.argmax(part - 0.35 * away)), part.shape[1])
    return np.array([column + x0 + 0.5, row + y0 + 0.5]) if part[row, column] > 0 else point


def _smooth(points: Floats) -> Floats:
    """Points of a line, each but the ends the mean of itself and its neighbours."""
    if len(points) < 5:
        return points
    smooth = points.copy()
    smooth[1:-1] = (points[:-2] + 2 * points[1:-1] + points[2:]) / 4
    return smooth


def _joints(points: Floats, forks: set[int]) -> NDArray[np.int64]:
    """The points that stay: ends, forks, and where the branch has turned by 30 degrees, or left the chord."""
    stays = [0]
    last = len(points) - 1
    for at in range(1, last):
        if at in forks:
            stays.append(at)
            continue
        before, after = points[at] - points[stays[-1]], points[at + 1] - points[at]
        size = np.linalg.norm(before) * np.linalg.norm(after)
        turned = np.degrees(np.arccos(np.clip(before @ after / max(size, 1e-9), -1, 1)))
        chord = points[at + 1] - points[stays[-1]]
        between = points[stays[-1] + 1 : at + 1] - points[stays[-1]]
        across = np.abs(chord[0] * between[:, 1] - chord[1] * between[:, 0]) / max(float(np.linalg.norm(chord)), 1e-9)
        if turned >= _STRAIGHT_DEG or across.max(initial=0) > _OFF_CHORD * np.linalg.norm(chord):
            stays.append(at)
    return np.array([*stays, last])


def _even(line: Floats, step: float) -> Floats:
    """Points along a line at even distances, its ends included."""
    length = arc_lengths(line)[-1]
    return points_at(line, np.linspace(0, length, max(2, int(np.ceil(length / step)) + 1)))


def _distances(one: Mixture, other: Mixture) -> Floats:
    """(K, L) distances between means, in standard deviations of both."""
    away = one.mean[:, None] - other.mean
    spread = one.covariance[:, None] + other.covariance
    return np.asarray(np.sqrt(np.einsum("kla,klab,klb->kl", away, np.linalg.inv(spread), away)))
