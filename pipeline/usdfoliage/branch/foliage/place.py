"""Where leaves stand on the twigs of a skeleton.

J. Guo et al., Realistic procedural plant modeling from multiple view images, 2020, section 5.3, attaches leaves to tip
nodes by the number of leaves at a node, their size, the angle to the stem and the direction of the normal. Here nodes
follow each other at the species' internode from the tip of every shoot downwards, whatever points the skeleton has.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from usdfoliage.branch.cage.tubes import carry_references
from usdfoliage.branch.foliage.species import Species
from usdfoliage.branch.model import Skeleton
from usdfoliage.geometry.directions import unit_vectors, vectors_across

UP = np.array([0.0, 1.0, 0.0])
YOUNG = 0.2  # of its length, that the last leaf of a shoot still has to grow
GROWING = 1.0  # nodes from the tip, after which that falls to the e-th part
LIMIT = 2.5  # standard deviations that are drawn at most
_WHOLE = 1e-9  # internodes, by which a shoot may be short of a whole number of them

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class FoliageSettings:
    """Which twigs carry leaves, and how far leaves differ."""

    max_leaves: int = 60_000  # more are thinned, evenly over the plant
    of_root: float = 0.08  # of the root's radius, below which twigs carry leaves: a scan of a large tree has no finer
    min_shoot: float = 0.5  # internodes beyond its parent's surface; what is shorter is a bud
    variation: float = 1.0  # how far leaves differ: 0 not at all, 1 as on a plant
    length: float = 0.15  # standard deviation of the logarithm of a leaf's length
    turn_rad: float = 0.2  # standard deviation about the shoot
    petiole_rad: float = 0.12  # standard deviation of the angle to the shoot
    droop: float = 0.3  # standard deviation, of the droop
    light: tuple[float, float, float] = (0.0, 1.0, 0.0)  # where blades turn to, in any length
    light_spread: float = 0.22  # standard deviation, of that direction's length

    def __post_init__(self) -> None:
        if self.max_leaves < 1:
            raise ValueError(f"max_leaves must be 1 or more, not {self.max_leaves}")
        for name in ("of_root", "min_shoot", "variation", "length", "turn_rad", "petiole_rad", "droop"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) >= 0):
                raise ValueError(f"{name} must be 0 or more, not {getattr(self, name)}")
        if not (np.isfinite(self.light).all() and np.linalg.norm(self.light) > 0):
            raise ValueError(f"light must be a direction, not {self.light}")


@dataclass(frozen=True, kw_only=True, eq=False)
class LeafPlaces:
    """Where leaves are, shoot by shoot, on each from its tip downwards."""

    base_m: Array  # (N, 3), on the bark
    orientation: Array  # (N, 4), unit quaternions (x, y, z, w), asset from leaf
    length_m: Array  # (N,)
    branch: NDArray[np.int32]  # (N,), of the skeleton
    node: NDArray[np.int32]  # (N,), counted from the tip of the branch, which is 0
    arc_m: Array  # (N,), along the branch from its first point
    shoots: int  # that carry leaves
    grown: int  # leaves before they were thinned

    def __len__(self) -> int:
        return len(self.base_m)


def place_leaves(
    skeleton: Skeleton,
    species: Species,
    rng: np.random.Generator,
    settings: FoliageSettings = FoliageSettings(),
) -> LeafPlaces:
    """Leaves on the shoots of a plant: the last stretch of every branch, where it is thin.

    Args:
        skeleton: Of the plant, Y up.
        species: How its leaves stand.
        rng: Of what makes them differ.
        settings: Which twigs carry leaves.
    """
    axes = _measure_axes(skeleton)
    nodes = _count_nodes(skeleton, axes, species, settings)
    end = np.cumsum(nodes)
    total = int(end[-1]) if len(end) else 0
    kept = min(total, max(1, settings.max_leaves // species.leaves_per_node))
    number = np.arange(kept) * total // max(kept, 1)
    branch = np.searchsorted(end, number, side="right")
    node = number - (end[branch] - nodes[branch]) if kept else number
    turn = np.arange(species.leaves_per_node) * 2 * np.pi / species.leaves_per_node
    branch, node = (np.repeat(each, species.leaves_per_node) for each in (branch, node))
    turn_rad = np.tile(turn, kept) + node * species.divergence_rad
    arc_m = np.maximum(axes.length_m[branch] - node * species.internode_m, 0)
    base_m, orientation, length_m = _stand(axes, branch, node, arc_m, turn_rad, species, rng, settings)
    return LeafPlaces(
        base_m=base_m,
        orientation=orientation,
        length_m=length_m,
        branch=branch.astype(np.int32),
        node=node.astype(np.int32),
        arc_m=arc_m,
        shoots=int(np.count_nonzero(nodes)),
        grown=total * species.leaves_per_node,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Axes:
    """Arcs and frames along the branches of a skeleton."""

    skeleton: Skeleton
    last: NDArray[np.int64]  # (B,), last point of each branch
    arc_m: Array  # (V,), from the branch's first point
    direction: Array  # (V, 3), unit, of the segment that begins there
    reference: Array  # (V, 3), unit, at right angles to it, carried along the branch
    level_rad: Array  # (B,), at the tip, from the reference to the level direction

    @cached_property
    def length_m(self) -> Array:
        """(B,)."""
        return self.arc_m[self.last]

    @cached_property
    def stride_m(self) -> float:
        """More than any length: branch * stride + arc puts all branches on one line."""
        return 2 * float(self.length_m.max(initial=1e-300))

    @cached_property
    def key_m(self) -> Array:
        """(V,) places of the points on that line."""
        return np.asarray(self.skeleton.curve * self.stride_m + self.arc_m)

    def segment(self, branch: NDArray[np.int64], arc_m: Array) -> NDArray[np.int64]:
        """(N,) first point of the segment at these places."""
        at = np.searchsorted(self.key_m, branch * self.stride_m + arc_m, side="right") - 1
        return np.clip(at, self.skeleton.first[branch], self.last[branch] - 1)


def _measure_axes(skeleton: Skeleton) -> _Axes:
    first, counts = skeleton.first.astype(np.int64), skeleton.counts.astype(np.int64)
    last = first + counts - 1
    step_m = np.zeros_like(skeleton.points_m)
    step_m[:-1] = np.diff(skeleton.points_m, axis=0)
    step_m[last] = 0
    size_m = np.linalg.norm(step_m, axis=1)
    before_m = np.cumsum(size_m) - size_m
    # A point that is repeated, and the last of a branch, go on in the direction before it.
    known = np.maximum.accumulate(np.where(size_m > 0, np.arange(len(size_m)), -1))
    direction = unit_vectors(np.where(known[:, None] >= 0, step_m[known], UP))
    reference = carry_references(direction, first, counts)
    level = vectors_across(direction[last], np.tile(UP, (len(last), 1)))
    other = np.cross(direction[last], reference[last])
    return _Axes(
        skeleton=skeleton,
        last=last,
        arc_m=before_m - np.repeat(before_m[first], counts),
        direction=direction,
        reference=reference,
        level_rad=np.arctan2(np.sum(level * other, axis=1), np.sum(level * reference[last], axis=1)),
    )


def _count_nodes(skeleton: Skeleton, axes: _Axes, species: Species, settings: FoliageSettings) -> NDArray[np.int64]:
    """(B,) nodes with leaves of each branch."""
    parent = skeleton.parent_vertex
    inside_m = np.where(parent >= 0, skeleton.radius_m[np.maximum(parent, 0)], 0.0)
    free_m = axes.length_m - inside_m
    thin_m = max(species.twig_radius_m, settings.of_root * float(skeleton.radius_m[0]))
    thick = np.where(skeleton.radius_m > thin_m, axes.arc_m, 0.0)
    begin_m = np.maximum(np.maximum.reduceat(thick, skeleton.first), axes.length_m - species.shoot_m)
    begin_m = np.maximum(begin_m, inside_m + species.bare_internodes * species.internode_m)
    nodes = np.floor((axes.length_m - begin_m) / species.internode_m + _WHOLE).astype(np.int64) + 1
    shoot = (skeleton.radius_m[axes.last] <= thin_m) & (free_m >= settings.min_shoot * species.internode_m)
    # However short a shoot is, its tip has leaves.
    return np.where(shoot, np.maximum(nodes, 1), 0)


def _stand(
    axes: _Axes,
    branch: NDArray[np.int64],
    node: NDArray[np.int64],
    arc_m: Array,
    turn_rad: Array,
    species: Species,
    rng: np.random.Generator,
    settings: FoliageSettings,
) -> tuple[Array, Array, Array]:
    """Base points (N, 3), orientations (N, 4) and lengths (N,) of leaves at nodes (N,), at arcs (N,), of branches."""
    skeleton = axes.skeleton
    size, around, angle, hang = np.clip(rng.standard_normal((4, len(branch))), -LIMIT, LIMIT) * settings.variation
    scatter = rng.normal(0, settings.light_spread, (len(branch), 3)) * settings.variation
    at = axes.segment(branch, arc_m)
    step_m = np.maximum(axes.arc_m[at + 1] - axes.arc_m[at], 1e-300)
    share = np.clip((arc_m - axes.arc_m[at]) / step_m, 0, 1)[:, None]
    tangent, reference = axes.direction[at], axes.reference[at]
    turn = (axes.level_rad[branch] + turn_rad + settings.turn_rad * around)[:, None]
    side = np.cos(turn) * reference + np.sin(turn) * np.cross(tangent, reference)
    radius_m = skeleton.radius_m[at, None] + share * (skeleton.radius_m[at + 1] - skeleton.radius_m[at])[:, None]
    base_m = skeleton.points_m[at] + share * (skeleton.points_m[at + 1] - skeleton.points_m[at]) + radius_m * side
    angle_rad = np.clip(species.petiole_rad + settings.petiole_rad * angle, 0, np.pi)[:, None]
    along = np.cos(angle_rad) * tangent + np.sin(angle_rad) * side
    y = _hang(along, np.maximum(species.droop_rad * (1 + settings.droop * hang), 0))
    x = vectors_across(y, unit_vectors(np.asarray(settings.light, np.float64)) + scatter)
    orientation = Rotation.from_matrix(np.stack([x, y, np.cross(x, y)], axis=-1)).as_quat(canonical=True)
    grown = 1 - YOUNG * np.exp(-node / GROWING)
    return base_m, orientation.reshape(-1, 4), species.leaf_length_m * grown * np.exp(settings.length * size)


def _hang(along: Array, droop_rad: Array) -> Array:
    """Unit vectors (N, 3) turned down by angles (N,), at most until they point straight down."""
    down = -UP
    cosine = np.sum(along * down, axis=1, keepdims=True)
    lower = down - cosine * along
    size = np.linalg.norm(lower, axis=1, keepdims=True)
    turn = np.minimum(droop_rad[:, None], np.arccos(np.clip(cosine, -1, 1)))
    # Straight up or down there is no direction to hang in.
    lower = np.divide(lower, size, out=np.zeros_like(lower), where=size > 1e-9)
    return np.where(size > 1e-9, np.cos(turn) * along + np.sin(turn) * lower, along)
