"""A natural leaf, and leaves that differ from it as those of one plant do."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

LIMIT = 2.5  # standard deviations: what lies beyond is drawn in to it, so that no leaf is out of the ordinary
# The share of a silhouette's height at the inner curve, at the outer curve and at the silhouette itself.
EVENLY = np.array([1 / 3, 2 / 3, 1.0])


@dataclass(frozen=True, kw_only=True)
class VariationSettings:
    """How much leaves differ: standard deviations, in leaf lengths where no other unit is named."""

    amount: float = 1.0  # factor on all of them: 0 all alike, 1 as on a plant
    width: float = 0.10  # of the logarithm of the width
    outline: float = 0.025  # how far the widest place lies nearer to the base or to the apex
    asymmetry: float = 0.030  # sideways, of the axis points
    arch: float = 0.045  # upwards, of the axis points
    curl: float = 0.030  # upwards, of the silhouette

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            number = getattr(self, name)
            if not (np.isfinite(number) and number >= 0):
                raise ValueError(f"{name} must be 0 or more, not {number}")


def default_leaf() -> NDArray[np.float64]:
    """A leaf (7, 3) as of a beech or a cherry: half as wide as long, a flat V, arched, with a drawn-out tip."""
    return np.array(
        [
            [0.0, 0.33, 0.07],
            [0.0, 0.68, 0.08],
            [0.08, 0.245, 0.045],
            [0.40, 0.345, 0.055],
            [0.80, 0.055, 0.005],
            [0.022, 0.025, 0.003],
            [0.040, 0.046, 0.005],
        ]
    )


def vary_leaves(
    count: int,
    rng: np.random.Generator,
    settings: VariationSettings = VariationSettings(),
    mean: NDArray[np.floating] | None = None,
) -> NDArray[np.float64]:
    """Leaves (count, 7, 3) around a mean leaf (7, 3), that of default_leaf without one."""
    leaf = default_leaf() if mean is None else np.asarray(mean, np.float64)
    draw = np.clip(rng.standard_normal((count, 9)), -LIMIT, LIMIT) * settings.amount
    leaves = np.empty((count, 7, 3))
    leaves[:] = leaf
    bend = settings.asymmetry * draw[:, 0]
    sway = 0.5 * settings.asymmetry * draw[:, 1]
    arch = settings.arch * draw[:, 2]
    wave = 0.4 * settings.arch * draw[:, 3]
    leaves[:, 0, 0] += bend + sway
    leaves[:, 1, 0] += bend - sway
    leaves[:, 0, 2] += arch + wave
    leaves[:, 1, 2] += arch - wave
    leaves[:, 2:5, 1] *= np.exp(settings.width * draw[:, 4])[:, None]
    leaves[:, 2:5, 0] += settings.outline * draw[:, 5, None] * np.array([0.6, 1.0, 0.6])
    height = settings.curl * draw[:, 6, None] * np.array([0.8, 1.0, 0.4])
    roll = 0.4 * settings.curl * draw[:, 7, None] * np.array([0.8, 1.0, 0.4])
    leaves[:, 5] += EVENLY[0] * height
    leaves[:, 6] += EVENLY[1] * height + roll / 3
    leaves[:, 2:5, 2] += EVENLY[2] * height + roll
    return leaves
