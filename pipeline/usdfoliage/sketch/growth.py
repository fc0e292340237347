"""A whole tree, grown from the branches that were traced.

P. Tan et al., Single image tree modeling, 2008, sections 3.1 and 3.2: branches are replaced by subtrees of a library,
each time the one that brings the tree nearest to its attractors; these are in turns points of the leaves in the
picture, and joints of the tree turned about its trunk. Distances are updated for what is new alone. What no subtree
comes to gets shoots of its own at the end, from the nearest branch: our own.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.geometry.directions import unit_vectors
from usdfoliage.geometry.lines import arc_lengths
from usdfoliage.progress import Progress
from usdfoliage.sketch.axes import Axis, sample_axis
from usdfoliage.sketch.bounds import CrownBounds
from usdfoliage.sketch.subtrees import Subtree, place_subtree

Floats = NDArray[np.float64]
Watch = Callable[[Sequence[Axis]], None]  # called with a tree that grows, after each step

_HANGING = 1.5  # by which full gravity turns the end of a new branch, as a tangent of what was level
_CARRIERS = 12  # places on branches that are compared for a shoot
_BENDING = 1.0  # by which a shoot seems longer that leaves at a right angle
_ARCHED = 0.4  # of a shoot's length, by which full gravity lifts its middle over its end


@dataclass(frozen=True, kw_only=True)
class SketchGrowthSettings:
    """How a tree grows."""

    iterations: int = 100  # of replacing a branch
    rotations: int = 12  # of a subtree about its supporting branch
    candidates: int = 8  # branches that are compared each time
    image_spacing: float = 0.035  # of the crown's size, between attractors in the picture
    attractors_3d: int = 400  # at most
    nearest: float = 0.35  # of its length, that the end of a new branch keeps from others
    shortest: float = 0.06  # of the crown's size: no shorter branch is replaced
    min_gain: float = 1e-3  # of the sum of distances; less ends the growth of that kind
    image_shoots: float = 0.024  # of the crown's size, between the ends of shoots in the picture
    space_shoots: float = 0.08  # and in space
    max_shoots: int = 2000
    from_trunk: int = 3  # traced branches, from which on none grows from a trunk
    gravity: float = 0.0  # 1: new branches hang, -1: they rise

    def __post_init__(self) -> None:
        for name in ("iterations", "rotations", "candidates", "attractors_3d"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be 1 or more, not {getattr(self, name)}")
        if not -1 <= self.gravity <= 1:
            raise ValueError(f"gravity must be -1 to 1, not {self.gravity:g}")
        for name in ("image_spacing", "image_shoots", "space_shoots", "shortest"):
            if not 0 < getattr(self, name) < 1:
                raise ValueError(f"{name} must be between 0 and 1, not {getattr(self, name)}")


@dataclass(frozen=True, kw_only=True, eq=False)
class GrownAxes:
    """The axes of a tree, and how it came to them."""

    axes: list[Axis]
    traced: int  # the first so many were in the picture
    stages: tuple[int, ...]  # axes after each replacement
    cost_px: tuple[float, ...]  # mean distance of the attractors in the picture, after each replacement of that kind


def grow_axes(
    axes: Sequence[Axis],
    library: Sequence[Subtree],
    bounds: CrownBounds,
    rng: np.random.Generator,
    settings: SketchGrowthSettings = SketchGrowthSettings(),
    report: Progress | None = None,
    watch: Watch | None = None,
) -> GrownAxes:
    """Grow a tree into its crown.

    Args:
        axes: As they were traced, in space.
        library: Subtrees.
        bounds: Where leaves are.
        rng: For what is drawn.
        settings: How.
        report: Called with the number of replacements that are done, and how many there are.
        watch: Called with the axes so far; new ones stand behind those before.
    """
    size = crown_size(bounds)
    growth = _Growth(list(axes), library, bounds, rng, settings, size)
    image = thin_out(_leaf_places(bounds), settings.image_spacing * size, rng)
    away = growth.distances(image)
    costs = [float(away.mean())] if len(image) else []
    stages = [len(growth.axes)]
    for turn in range(settings.iterations):
        if turn % 2 == 0:
            grown = growth.replace_branch(image, away)
            away = np.minimum(away, growth.distances(image, grown))
            costs.append(float(away.mean()))
        else:
            targets = growth.rotated_joints()
            growth.replace_branch(targets, growth.distances(targets))
        stages.append(len(growth.axes))
        if report is not None:
            report(turn + 1, settings.iterations)
        if watch is not None:
            watch(growth.axes)
    growth.add_shoots(thin_out(_leaf_places(bounds), settings.image_shoots * size, rng), settings.image_shoots * size)
    growth.add_shoots(_places_in_space(bounds, settings.space_shoots * size, rng), settings.space_shoots * size)
    return GrownAxes(axes=growth.axes, traced=len(axes), stages=tuple(stages), cost_px=tuple(costs))


class _Growth:
    """The tree so far."""

    def __init__(
        self,
        axes: list[Axis],
        library: Sequence[Subtree],
        bounds: CrownBounds,
        rng: np.random.Generator,
        settings: SketchGrowthSettings,
        size: float,
    ) -> None:
        self.axes, self.library, self.bounds, self.rng, self.settings, self.size = (
            axes,
            library,
            bounds,
            rng,
            settings,
            size,
        )
        self.step = 0.5 * settings.image_spacing * size
        self.samples = [sample_axis(axis.points, self.step) for axis in axes]
        self.replaced = [0] * len(axes)
        self.placed: dict[tuple[int, int], tuple[Floats, NDArray[np.bool_]]] = {}
        self.keeps_trunk = sum(axis.order == 1 for axis in axes) >= settings.from_trunk
        trunk = axes[0].points
        self.pivot = trunk[len(trunk) // 2]

    def distances(self, targets: Floats, first: int = 0) -> Floats:
        """(N,) of targets (N, 2 or 3) from the axes from a number on, in the picture or in space."""
        if not len(targets) or first >= len(self.samples):
            return np.full(len(targets), np.inf)
        points = np.concatenate(self.samples[first:])[:, : targets.shape[1]]
        return np.asarray(cKDTree(points).query(targets)[0])

    def rotated_joints(self) -> Floats:
        """(M, 3) joints of the tree, turned by a quarter about the trunk, where they come to lie in the crown."""
        joints = np.concatenate([axis.points[1:] for axis in self.axes if axis.order > 0] or [np.zeros((0, 3))])
        if len(joints) > self.settings.attractors_3d:
            joints = joints[self.rng.choice(len(joints), self.settings.attractors_3d, replace=False)]
        from_pivot = joints - self.pivot
        side = 1.0 if self.rng.random() < 0.5 else -1.0
        turned = self.pivot + np.column_stack([side * from_pivot[:, 2], from_pivot[:, 1], -side * from_pivot[:, 0]])
        return turned[self.bounds.contains(turned)]

    def candidates(self) -> list[int]:
        """Branches that may be replaced: the longer and the older ones rather, as their radii are not known yet."""
        shortest = self.settings.shortest * self.size
        able = [
            (axis.length / (1 + self.replaced[number]), number)
            for number, axis in enumerate(self.axes)
            if axis.length >= shortest and self.replaced[number] < 3 and (axis.order > 0 or not self.keeps_trunk)
        ]
        able.sort(key=lambda each: (-each[0], each[1]))
        chosen = []
        for _, number in able:
            if self.rng.random() < 1.0 / (1.0 + 0.5 * max(self.axes[number].order - 1, 0)):
                chosen.append(number)
                if len(chosen) == self.settings.candidates:
                    break
        return chosen

    def replace_branch(self, targets: Floats, away: Floats) -> int:
        """The best replacement of a branch by a subtree; returns the number of the first new axis."""
        before = len(self.axes)
        if not len(targets):
            return before
        best: tuple[float, int, Floats, Subtree] | None = None
        flat = targets.shape[1]
        target_32, away_32 = targets.astype(np.float32), away.astype(np.float32)
        square = (target_32**2).sum(axis=1)
        for number in self.candidates():
            for which, subtree in enumerate(self.library):
                children, good = self._place(number, which)
                ends = children[:, :, 1:, :flat].astype(np.float32)
                points = ends.reshape(-1, flat)
                squared = (points**2).sum(axis=1)[:, None] - 2 * points @ target_32.T + square
                squared[~good.reshape(-1)] = np.inf
                nearest = np.sqrt(np.maximum(squared.reshape(len(children), -1, len(targets)).min(axis=1), 0))
                gain = np.maximum(away_32 - nearest, 0).sum(axis=1)
                turn = int(np.argmax(gain))
                if best is None or gain[turn] > best[0]:
                    best = float(gain[turn]), number, children[turn], subtree
        if best is None or best[0] < self.settings.min_gain * float(away.sum()):
            return before
        _, number, lines, subtree = best
        self.replaced[number] += 1
        others = cKDTree(np.concatenate(self.samples))
        for at, line in zip(subtree.at, lines, strict=True):
            self._add_child(number, float(at), line, others)
        return before

    def _place(self, number: int, which: int) -> tuple[Floats, NDArray[np.bool_]]:
        """(R, C, P, 3) the children of a subtree on a branch in each turn, and (R, C, P - 1) how far each stays inside.

        Neither changes while the tree grows.
        """
        if (number, which) not in self.placed:
            placed = place_subtree(self.library[which], self._support(number), self.settings.rotations)
            children = _weighed_down(placed, self.settings.gravity)
            good = np.logical_and.accumulate(self.bounds.contains(children[:, :, 1:]), axis=2)
            self.placed[number, which] = children, good
        return self.placed[number, which]

    def _support(self, number: int) -> Floats:
        """The part of a branch that carries a subtree: of a trunk that in the crown."""
        axis = self.axes[number]
        if axis.order:
            return axis.points
        inside = self.bounds.contains(axis.points * [1, 1, 0])
        first = int(np.argmax(inside)) if inside.any() else 0
        return axis.points[min(first, len(axis.points) - 2) :]

    def _add_child(self, number: int, at: float, line: Floats, others: cKDTree) -> None:
        """Add a branch as far as it stays inside and apart from others."""
        good = np.logical_and.accumulate(self.bounds.contains(line[1:]))
        line = line[: 1 + int(good.sum())]
        if len(line) < 3:
            return
        length = float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
        apart = np.asarray(others.query(line[len(line) // 2 :])[0])
        if apart.min() < self.settings.nearest * 0.5 * length:
            return
        support = self._support(number)
        offset = len(self.axes[number].points) - len(support)
        vertex = self._vertex(number, at, offset)
        line = line + (self.axes[number].points[vertex] - line[0]) * np.linspace(1, 0, len(line))[:, None]
        line[0] = self.axes[number].points[vertex]  # to the last bit
        self.add(line, number, vertex)

    def _vertex(self, number: int, at: float, offset: int) -> int:
        """The vertex of a branch that is nearest to a share of its way, past an offset; never its first."""
        points = self.axes[number].points[offset:]
        arc = arc_lengths(points)
        return max(1, offset + int(np.argmin(np.abs(arc - at * arc[-1]))))

    def add(self, line: Floats, parent: int, vertex: int) -> None:
        """Add a branch."""
        self.axes.append(
            Axis(
                points=line,
                half=np.full(len(line), np.nan),
                parent=parent,
                parent_point=vertex,
                order=self.axes[parent].order + 1,
                inferred=True,
            )
        )
        self.samples.append(sample_axis(line, self.step))
        self.replaced.append(0)

    def add_shoots(self, targets: Floats, spacing: float) -> None:
        """A shoot to each target that no branch comes near, from the nearest branch, the nearest targets first.

        Args:
            targets: (N, 2), in the picture, or (N, 3), in space.
            spacing: How far a target may be from a branch without a shoot.
        """
        settings = self.settings
        flat = targets.shape[1]
        left = self._in_space(targets) if flat == 2 else targets
        added = 0
        while len(left) and added < settings.max_shoots:
            owners, vertices, places = self._carriers()
            every = np.concatenate(self.samples)
            away = np.asarray(cKDTree(every[:, :flat]).query(left[:, :flat])[0])
            left = left[away > 0.7 * spacing]
            if not len(left):
                break
            gap, nearest = self._straightest_carriers(left, owners, vertices, places)
            order = np.argsort(gap, kind="stable")
            reach = max(float(gap[order[len(order) // 4]]), 1.5 * spacing)
            chosen = order[gap[order] <= reach][: settings.max_shoots - added]
            for target in chosen:
                owner, vertex = int(owners[nearest[target]]), int(vertices[nearest[target]])
                self.add(_bent(self.axes[owner], vertex, left[target], settings.gravity), owner, vertex)
                added += 1
            left = np.delete(left, chosen, axis=0)

    def _carriers(self) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats]:
        """Branches and their vertices that shoots may leave from, and where these are."""
        first = 1 if self.keeps_trunk else 0
        able = [n for n, axis in enumerate(self.axes) if axis.order >= first]
        owners = np.concatenate([np.full(len(self.axes[n].points) - 1, n) for n in able])
        vertices = np.concatenate([np.arange(1, len(self.axes[n].points)) for n in able])
        return owners, vertices, np.concatenate([self.axes[n].points[1:] for n in able])

    def _straightest_carriers(
        self, targets: Floats, owners: NDArray[np.int64], vertices: NDArray[np.int64], places: Floats
    ) -> tuple[Floats, NDArray[np.int64]]:
        """How far each target is from the carrier that a shoot to it leaves from, and which: near, and bent little."""
        count = min(_CARRIERS, len(places))
        gaps, near = (np.asarray(each).reshape(len(targets), count) for each in cKDTree(places).query(targets, count))
        along = unit_vectors(
            places
            - np.stack([self.axes[n].points[v - 1] for n, v in zip(owners.tolist(), vertices.tolist(), strict=True)])
        )
        straight = unit_vectors(targets[:, None] - places[near])
        cosine = (along[near] * straight).sum(axis=2)
        best = (gaps * (1 + _BENDING * (1 - cosine))).argmin(axis=1)
        row = np.arange(len(targets))
        return gaps[row, best], near[row, best]

    def _in_space(self, targets: Floats) -> Floats:
        """(N, 3) targets of the picture, as deep as the branch that is nearest in the picture, or somewhat more."""
        _, _, places = self._carriers()
        nearest = np.asarray(cKDTree(places[:, :2]).query(targets)[1])
        row, column, _ = self.bounds.rows_and_columns(targets)
        deep = self.bounds.half_depth[row, column].astype(np.float64)
        # Leaves are rather near the surface of a crown, where light is.
        outwards = np.sqrt(self.rng.random(len(targets))) * np.where(self.rng.random(len(targets)) < 0.5, -1, 1)
        z = 0.25 * places[nearest, 2] + 0.85 * deep * outwards
        return np.column_stack([targets, np.clip(z, -deep, deep)])


def crown_size(bounds: CrownBounds) -> float:
    """The square root of the area of a crown in its picture, in pixels."""
    return float(np.sqrt(bounds.inside.sum()))


def thin_out(places: Floats, spacing: float, rng: np.random.Generator) -> Floats:
    """Some of the places, of which no two are closer than the spacing, in cells of a grid: evenly, and not in rows."""
    if not len(places):
        return places
    order = rng.permutation(len(places))
    cells = np.floor(places[order] / spacing).astype(np.int64)
    _, first = np.unique(cells, axis=0, return_index=True)
    chosen = places[order[np.sort(first)]]
    pairs = cKDTree(chosen).query_pairs(0.6 * spacing, output_type="ndarray")
    stays = np.ones(len(chosen), bool)
    for one, two in pairs:
        if stays[one]:
            stays[two] = False
    return chosen[stays]


def _leaf_places(bounds: CrownBounds) -> Floats:
    """(N, 2) the middles of the pixels of leaves, in the frame of the picture."""
    row, column = np.nonzero(bounds.leaves)
    return np.column_stack([column + 0.5, -(row + 0.5)])


def _places_in_space(bounds: CrownBounds, spacing: float, rng: np.random.Generator) -> Floats:
    """(N, 3) places in the crown, evenly, behind or before leaves of the picture."""
    row, column = np.nonzero(bounds.leaves)
    deep = bounds.half_depth[row, column].astype(np.float64)
    if not len(row) or deep.sum() <= 0:
        return np.zeros((0, 3))
    wanted = int(min(8 * 2 * deep.sum() / spacing**3, 200_000)) + 1
    drawn = rng.choice(len(row), wanted, p=deep / deep.sum())
    places = np.column_stack(
        [
            column[drawn] + rng.random(wanted),
            -(row[drawn] + rng.random(wanted)),
            deep[drawn] * np.cbrt(rng.uniform(-1, 1, wanted)),
        ]
    )
    return thin_out(places, spacing, rng)


def _weighed_down(lines: Floats, gravity: float) -> Floats:
    """Lines (..., K, 3) whose steps keep their lengths and turn down the more, the farther out they are."""
    if gravity == 0:
        return lines
    steps = np.diff(lines, axis=-2)
    size = np.linalg.norm(steps, axis=-1, keepdims=True)
    out = np.linspace(0, 1, steps.shape[-2] + 1)[1:, None]
    turned = steps + _HANGING * gravity * size * out * [0.0, -1.0, 0.0]
    turned *= size / np.maximum(np.linalg.norm(turned, axis=-1, keepdims=True), 1e-9)
    return np.concatenate([lines[..., :1, :], lines[..., :1, :] + np.cumsum(turned, axis=-2)], axis=-2)


def _bent(parent: Axis, vertex: int, end: Floats, gravity: float) -> Floats:
    """(4, 3) a shoot from a vertex of its parent to an end, that begins along its parent's direction.

    With gravity it rises at first, to come down to its end.
    """
    start = parent.points[vertex]
    along = parent.points[vertex] - parent.points[vertex - 1]
    straight = end - start
    size = float(np.linalg.norm(straight))
    control = start + 0.35 * size * (
        0.6 * along / max(float(np.linalg.norm(along)), 1e-9) + 0.6 * straight / max(size, 1e-9)
    )
    if gravity:
        control[1] += _ARCHED * size * gravity
    t = np.linspace(0, 1, 4)[:, None]
    return np.asarray((1 - t) ** 2 * start + 2 * t * (1 - t) * control + t**2 * end)
