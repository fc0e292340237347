"""A random spray of leaves on twigs, for tests and demonstrations."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from usdfoliage.leaf.jitter import spread_phases
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.variation import VariationSettings, vary_leaves

GOLDEN_ANGLE_RAD = np.pi * (3 - 5**0.5)  # 137.5°, from a leaf to the next on a spiral
UP = np.array([0.0, 1.0, 0.0])
CHUNK = 1 << 16  # leaves at a time, so that a million fit into little memory

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class SpraySettings:
    """How leaves stand on twigs, and twigs in the spray."""

    length_m: float = 0.08  # of a leaf, on average
    length_variation: float = 0.15  # standard deviation of its logarithm
    leaves_per_twig: int = 12
    internode_m: float = 0.035  # from a leaf to the next
    divergence_rad: float = np.pi  # from a leaf to the next around the twig: half a turn, or GOLDEN_ANGLE_RAD
    light: tuple[float, float, float] = (0.0, 0.9, 0.45)  # where blades turn to
    variation: VariationSettings = field(default_factory=VariationSettings)

    def __post_init__(self) -> None:
        for name in ("length_m", "leaves_per_twig", "internode_m"):
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
    """Quadratic arcs: begin, direction there, direction at the tip, length."""

    base_m: Array  # (S, 3)
    start: Array  # (S, 3), unit
    end: Array  # (S, 3), unit
    length_m: Array  # (S,)

    def at(self, shoot: NDArray[np.int64], t: Array) -> tuple[Array, Array]:
        """Points and unit tangents (K, 3) at t (K,) in [0, 1] of shoots (K,)."""
        start, end, t = self.start[shoot], self.end[shoot], t[:, None]
        point = self.base_m[shoot] + self.length_m[shoot, None] * (start * (t - t * t / 2) + end * (t * t / 2))
        return point, _unit(start * (1 - t) + end * t)


def scatter_spray(count: int, rng: np.random.Generator, settings: SpraySettings = SpraySettings()) -> Leaves:
    """A spray of count leaves with its root at the origin, Y up, its leaves turned up and towards +Z."""
    if count < 0:
        raise ValueError(f"the number of leaves must be 0 or more, not {count}")
    parameters = vary_leaves(count, rng, settings.variation)
    base_m, orientation, length_m = np.empty((count, 3)), np.empty((count, 4)), np.empty(count)
    if count:
        shoots = _grow_shoots(count, rng, settings)
        share = np.cumsum(shoots.length_m) / shoots.length_m.sum()
        first = np.concatenate([[0], np.round(share * count)]).astype(np.int64)
        for begin in range(0, count, CHUNK):
            number = np.arange(begin, min(begin + CHUNK, count))
            chunk = slice(number[0], number[-1] + 1)
            shoot = np.searchsorted(first, number, side="right") - 1
            rank, total = number - first[shoot], (first[shoot + 1] - first[shoot])
            base_m[chunk], orientation[chunk], length_m[chunk] = _place_leaves(
                shoots, shoot, rank, (rank + 1.0) / total, rng, settings
            )
    return Leaves(
        parameters=parameters,
        base_m=base_m,
        orientation=orientation,
        length_m=length_m,
        phase=spread_phases(count),
    )


def _grow_shoots(count: int, rng: np.random.Generator, settings: SpraySettings) -> _Shoots:
    """The twigs that carry the leaves: the last order of a branching system of which each order is like the last."""
    twigs = -(-count // settings.leaves_per_twig)
    orders = int(np.ceil(np.log(max(twigs, 1)) / np.log(12.0))) if twigs > 1 else 0
    ratio = twigs ** (1 / max(orders, 1))
    twig_m = settings.leaves_per_twig * settings.internode_m
    shoots = _Shoots(
        base_m=np.zeros((1, 3)),
        start=np.array([[0.0, 1.0, 0.0]]),
        end=_unit(np.array([[0.25, 1.0, 0.15]])),
        length_m=np.array([twig_m * 1.15 * ratio ** (orders / 3)]),
    )
    for order in range(1, orders + 1):
        wanted = twigs if order == orders else int(np.ceil(ratio**order))
        shoots = _branch(shoots, wanted, twig_m * 1.15 * ratio ** ((orders - order) / 3), rng)
    return shoots


def _branch(parents: _Shoots, count: int, length_m: float, rng: np.random.Generator) -> _Shoots:
    edges = np.round(np.linspace(0, count, len(parents.length_m) + 1)).astype(np.int64)
    number = np.arange(count)
    parent = np.searchsorted(edges, number, side="right") - 1
    rank, total = number - edges[parent], edges[parent + 1] - edges[parent]
    t = 0.15 + 0.85 * (rank + rng.uniform(0.2, 0.8, count)) / total
    last = rank == total - 1
    t[last] = 1.0
    base, tangent = parents.at(parent, t)
    across, above = _frame(tangent)
    turn = rank * GOLDEN_ANGLE_RAD + parent * 2.4 + rng.normal(0, 0.25, count)
    angle = np.where(last, 0.15, 0.95 + rng.normal(0, 0.12, count))[:, None]
    side = np.cos(turn)[:, None] * across + np.sin(turn)[:, None] * above
    start = _unit(np.cos(angle) * tangent + np.sin(angle) * side + 0.1 * UP)
    end = _unit(start + 0.15 * UP + rng.normal(0, 0.12, (count, 3)))
    length = length_m * (1.15 - 0.5 * t) * np.exp(rng.normal(0, 0.12, count))
    return _Shoots(base_m=base, start=start, end=end, length_m=length)


def _place_leaves(
    shoots: _Shoots,
    shoot: NDArray[np.int64],
    rank: NDArray[np.int64],
    t: Array,
    rng: np.random.Generator,
    settings: SpraySettings,
) -> tuple[Array, Array, Array]:
    count = len(shoot)
    base, tangent = shoots.at(shoot, 0.1 + 0.9 * t)
    light = _unit(np.asarray(settings.light, np.float64))
    across = _unit(np.cross(tangent, light) + 1e-9)
    above = np.cross(across, tangent)
    turn = rank * settings.divergence_rad + rng.normal(0, 0.15, count)
    side = np.cos(turn)[:, None] * across + 0.5 * np.sin(turn)[:, None] * above
    angle = (1.05 - 0.35 * t + rng.normal(0, 0.1, count))[:, None]
    droop = np.abs(rng.normal(0.25, 0.12, count))[:, None]
    y = _unit(np.cos(angle) * tangent + np.sin(angle) * side - droop * UP)
    z = light + 0.35 * tangent + rng.normal(0, 0.2, (count, 3))
    x = _unit(np.cross(y, z) + 1e-9)
    z = np.cross(x, y)
    length = (
        settings.length_m
        * (0.8 + 0.25 * np.sin(np.pi * t))
        * np.exp(settings.length_variation * np.clip(rng.standard_normal(count), -2.5, 2.5))
    )
    return base, _quaternions(x, y, z), length


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12))


def _frame(tangent: Array) -> tuple[Array, Array]:
    helper = np.where(np.abs(tangent[:, 1:2]) < 0.9, [[0.0, 1.0, 0.0]], [[0.0, 0.0, 1.0]])
    across = _unit(np.cross(tangent, helper))
    return across, np.cross(across, tangent)


def _quaternions(x: Array, y: Array, z: Array) -> Array:
    """Unit quaternions (N, 4) as x, y, z, w of the rotations whose columns are x, y and z, w not below 0."""
    xx, yy, zz = x[:, 0], y[:, 1], z[:, 2]
    squares = np.stack([1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz, 1 + xx + yy + zz], axis=-1)
    a, b, c = y[:, 2] - z[:, 1], z[:, 0] - x[:, 2], x[:, 1] - y[:, 0]
    d, e, f = y[:, 0] + x[:, 1], z[:, 0] + x[:, 2], z[:, 1] + y[:, 2]
    # Four times the outer product of the quaternion with itself: each row is the quaternion, the longest the safest.
    outer = np.stack(
        [
            np.stack([squares[:, 0], d, e, a], axis=-1),
            np.stack([d, squares[:, 1], f, b], axis=-1),
            np.stack([e, f, squares[:, 2], c], axis=-1),
            np.stack([a, b, c, squares[:, 3]], axis=-1),
        ],
        axis=1,
    )
    best = outer[np.arange(len(x)), np.argmax(squares, axis=-1)]
    best *= np.where(best[:, 3:] < 0, -1.0, 1.0)
    return _unit(best)
