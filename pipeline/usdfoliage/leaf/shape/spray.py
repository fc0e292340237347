"""A random spray of leaves on twigs, for tests and demonstrations.

Our own sketch of a plant, not a growth model: orders of arching shoots, of which the last two carry leaves.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from usdfoliage.geometry.directions import unit_vectors, vectors_across
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.jitter import spread_phases
from usdfoliage.leaf.shape.variation import LIMIT, VariationSettings, vary_leaves

GOLDEN_ANGLE_RAD = np.pi * (3 - 5**0.5)  # 137.5°, from a leaf to the next on a spiral
SHOOTS_PER_SHOOT = 10.0  # at most, but for rounding
LEADER = 0.85  # how long a shoot is that carries others, to one that fills its room alone
CHUNK = 1 << 16  # leaves placed at a time, so that a million need little memory besides their own
BARE = 0.12  # share of a shoot, from its base, that carries no shoots but twigs
UP = np.array([0.0, 1.0, 0.0])

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class SpraySettings:
    """How leaves stand on twigs; the spray grows with their number and with their length.

    Attributes:
        length_m: The mean length of a leaf, metres, above 0.
        length_variation: The standard deviation of the logarithm of that length, 0 or more.
        leaves_per_twig: About how many, above 0.
        internode: The distance from a leaf to the next along the twig, in leaf lengths, above 0.
        divergence_rad: The angle from a leaf to the next around the twig. π makes two rows, GOLDEN_ANGLE_RAD a spiral.
        light: The direction that blades turn to, in any length above 0.
        variation: How much the shapes of leaves differ.

    Raises:
        ValueError: A number is out of its range.
    """

    length_m: float = 0.08
    length_variation: float = 0.15
    leaves_per_twig: int = 12
    internode: float = 0.42
    divergence_rad: float = np.pi
    light: tuple[float, float, float] = (0.0, 0.9, 0.45)
    variation: VariationSettings = field(default_factory=VariationSettings)

    def __post_init__(self) -> None:
        for name in ("length_m", "leaves_per_twig", "internode"):
            number = getattr(self, name)
            if not (np.isfinite(number) and number > 0):
                raise ValueError(f"{name} must be above 0, not {number}")
        if not (np.isfinite(self.length_variation) and self.length_variation >= 0):
            raise ValueError(f"length_variation must be 0 or more, not {self.length_variation}")
        if not np.isfinite(self.divergence_rad):
            raise ValueError(f"divergence_rad must be finite, not {self.divergence_rad}")
        if not (np.isfinite(self.light).all() and np.linalg.norm(self.light) > 0):
            raise ValueError(f"light must be a direction, not {self.light}")


@dataclass(frozen=True, kw_only=True, eq=False)
class _Shoots:
    """Quadratic arcs."""

    base_m: Array  # (S, 3)
    start: Array  # (S, 3), unit direction at the base
    end: Array  # (S, 3), unit direction at the tip
    length_m: Array  # (S,), of the arc were it straight

    def __len__(self) -> int:
        return len(self.base_m)

    def at(self, shoot: NDArray[np.int64], t: Array) -> tuple[Array, Array]:
        """Points and unit tangents (K, 3) at t (K,) in [0, 1] of shoots (K,)."""
        start, end, along = self.start[shoot], self.end[shoot], t[:, None]
        reach = start * (along - along * along / 2) + end * (along * along / 2)
        return self.base_m[shoot] + self.length_m[shoot, None] * reach, unit_vectors(start + (end - start) * along)


def scatter_spray(count: int, rng: np.random.Generator, settings: SpraySettings = SpraySettings()) -> Leaves:
    """A spray of leaves on twigs that arch from a root at the origin, Y up, the blades turned up and towards +Z.

    A few leaves are one twig, some hundreds a bough, more of them a plant as large as they fill. Leaves of one twig
    follow each other from its base to its tip.

    Raises:
        ValueError: count is below 0.
    """
    parameters = vary_leaves(count, rng, settings.variation)
    base_m, orientation, length_m = np.empty((count, 3)), np.empty((count, 4)), np.empty(count)
    if count:
        twigs = _grow_twigs(count, rng, settings)
        share = np.cumsum(twigs.length_m) / np.sum(twigs.length_m)
        first = np.round(count * np.concatenate([[0.0], share])).astype(np.int64)
        for begin in range(0, count, CHUNK):
            number = np.arange(begin, min(begin + CHUNK, count))
            twig = np.searchsorted(first, number, side="right") - 1
            rank, total = number - first[twig], first[twig + 1] - first[twig]
            base_m[number], orientation[number], length_m[number] = _place_leaves(
                twigs, twig, rank, total, rng, settings
            )
    return Leaves(
        parameters=parameters,
        base_m=base_m,
        orientation=orientation,
        length_m=length_m,
        phase=spread_phases(count),
    )


def _grow_twigs(count: int, rng: np.random.Generator, settings: SpraySettings) -> _Shoots:
    """The twigs for this many leaves: the last two orders of shoots, as long as the leaves need."""
    wanted = -(-count // settings.leaves_per_twig)
    orders = int(np.ceil(np.log(wanted) / np.log(SHOOTS_PER_SHOOT) - 1e-9))
    ratio = wanted ** (1 / max(orders, 1))
    shoots = _Shoots(
        base_m=np.zeros((1, 3)),
        start=unit_vectors(UP + rng.normal(0, 0.05, (1, 3))),
        end=unit_vectors(np.array([0.25, 1.0, 0.25]) + rng.normal(0, 0.1, (1, 3))),
        # In units of a twig, and as many more twigs need as much more room: lengths grow with the third root.
        length_m=np.array([LEADER * ratio ** (orders / 3) if orders else 1.0]),
    )
    for order in range(1, orders):
        number = int(np.ceil(ratio**order))
        shoots = _branch_shoots(shoots, number, LEADER * ratio ** ((orders - order) / 3), rng, leading=True)
    if orders:
        side = _branch_shoots(shoots, wanted, 1.0, rng, leading=False)
        shoots = _Shoots(
            base_m=np.concatenate([shoots.base_m, side.base_m]),
            start=np.concatenate([shoots.start, side.start]),
            end=np.concatenate([shoots.end, side.end]),
            length_m=np.concatenate([shoots.length_m, side.length_m]),
        )
    scale = count * settings.internode * settings.length_m / np.sum(shoots.length_m)
    return replace(shoots, base_m=scale * shoots.base_m, length_m=scale * shoots.length_m)


def _branch_shoots(
    parents: _Shoots, count: int, length_m: float, rng: np.random.Generator, *, leading: bool
) -> _Shoots:
    """The next order, on a spiral around its parents; if leading, one of each parent goes on from its tip."""
    first = np.arange(len(parents) + 1) * count // len(parents)
    number = np.arange(count)
    parent = np.searchsorted(first, number, side="right") - 1
    rank, total = number - first[parent], first[parent + 1] - first[parent]
    leads = leading & (rank == total - 1)
    bare = BARE if leading else 0.0
    t = np.where(leads, 1.0, bare + (1 - bare) * (rank + rng.uniform(0.5, 0.9, count)) / total)
    base_m, tangent = parents.at(parent, t)
    level = 1 - tangent[:, 1] ** 2  # 0 for an upright parent; around others shoots lie flatter
    across = vectors_across(tangent, UP)
    turn = rank * GOLDEN_ANGLE_RAD + rng.uniform(0, 2 * np.pi, len(parents))[parent] + rng.normal(0, 0.2, count)
    flat = (1 - 0.4 * level) * np.sin(turn)
    side = np.cos(turn)[:, None] * across + flat[:, None] * np.cross(across, tangent)
    angle = np.where(leads, 0.2, 1.0 + rng.normal(0, 0.12, count))[:, None]
    start = unit_vectors(np.cos(angle) * tangent + np.sin(angle) * side + 0.2 * UP)
    sag = 0.35 * (1 - start[:, 1:2] ** 2) - 0.05
    end = unit_vectors(start - sag * UP + rng.normal(0, 0.15, (count, 3)))
    length = length_m * (1.2 - 0.4 * t) * np.exp(0.12 * np.clip(rng.standard_normal(count), -LIMIT, LIMIT))
    return _Shoots(base_m=base_m, start=start, end=end, length_m=length)


def _place_leaves(
    shoots: _Shoots,
    shoot: NDArray[np.int64],
    rank: NDArray[np.int64],
    total: NDArray[np.int64],
    rng: np.random.Generator,
    settings: SpraySettings,
) -> tuple[Array, Array, Array]:
    """Base points (K, 3), orientations (K, 4) and lengths (K,) of leaves on shoots (K,), the rank-th of total (K,)."""
    count = len(shoot)
    t = (rank + 1.0) / total
    base_m, tangent = shoots.at(shoot, t)
    light = unit_vectors(np.asarray(settings.light, np.float64))
    across = vectors_across(tangent, light)
    turn = rank * settings.divergence_rad + rng.normal(0, 0.2, count)
    side = np.cos(turn)[:, None] * across + 0.6 * np.sin(turn)[:, None] * np.cross(across, tangent)
    angle = np.where(rank == total - 1, 0.15, 1.1 - 0.4 * t)[:, None] + rng.normal(0, 0.12, (count, 1))
    droop = np.clip(rng.normal(0.25, 0.15, (count, 1)), 0, 0.5)
    y = unit_vectors(np.cos(angle) * tangent + np.sin(angle) * side - droop * UP)
    towards = light + 0.4 * tangent + rng.normal(0, 0.22, (count, 3))
    x = vectors_across(y, towards)
    orientation = Rotation.from_matrix(np.stack([x, y, np.cross(x, y)], axis=-1)).as_quat(canonical=True)
    size = 0.84 + 0.25 * np.sin(np.pi * t)  # a twig's largest leaves are in its middle; 1 on average
    spread = np.exp(settings.length_variation * np.clip(rng.standard_normal(count), -LIMIT, LIMIT))
    return base_m, orientation, settings.length_m * size * spread
