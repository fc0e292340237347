"""Leaves: what all the rest of the system knows of them."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

_UNIT = 1e-6  # a quaternion this near to length 1 is kept as it is
# Rows of the parameters of a leaf, three numbers each. silhouette_i is (v, x, z): the parameter on the axis, the
# distance from it, the height above the leaf's plane.
PARAMETERS = ("axis1", "axis2", "silhouette1", "silhouette2", "silhouette3", "inner", "outer")


class LeafOrigin(IntEnum):
    """Where a leaf comes from."""

    FOUND = 0  # the input shows most of it
    COMPLETED = 1  # the input shows a part of it; the rest is as other leaves of the plant have it
    FILLED_IN = 2  # nothing shows it: it was put where the plant has leaves, drawn from those that were found
    OF_SPECIES = 3  # nothing shows it: it was drawn from what leaves of the species are like


@dataclass(frozen=True, kw_only=True, eq=False)
class Leaves:
    """Leaves of a plant: 21 parameters each, and where each one is.

    Leaf space: base (0, 0, 0), apex (0, 1, 0), width along x, height along z; its unit is the length of the leaf, the
    distance from base to apex.

    Attributes:
        parameters: (N, 7, 3), leaf lengths, rows in the order of PARAMETERS: axis1, axis2, silhouette1, silhouette2,
            silhouette3, inner, outer. A row silhouette_i is (v, x, z), the other rows are (x, y, z) or three heights.
        base_m: (N, 3), metres, in the asset's frame.
        orientation: (N, 4), quaternions (x, y, z, w), asset from leaf.
        length_m: (N,), metres, above 0.
        phase: (N,), where on the jitter's wave each leaf begins, in cycles (leaf.shape.jitter.spread_phases).
        color: (N, 3), linear Rec.709. None where all leaves share one colour.
        confidence: (N,), 0 to 1, the probability that it is right. None where it is unknown.
        residual_m: (N,), metres, root mean square distance of the captured points from it. None where it is unknown.
        view: (N,), number of the photograph, -1 for none. None where it is unknown.
        origin: (N,), where each leaf comes from, by the numbers of LeafOrigin. None where it is unknown.

    Raises:
        ValueError: The arrays are not of these shapes.

    Source:
        Chaurasia and Beardsley, Editable Parametric Dense Foliage from 3D Capture, section 3.
    """

    parameters: NDArray[np.float64]
    base_m: NDArray[np.float64]
    orientation: NDArray[np.float64]
    length_m: NDArray[np.float64]
    phase: NDArray[np.float64]
    color: NDArray[np.float64] | None = None
    confidence: NDArray[np.float64] | None = None
    residual_m: NDArray[np.float64] | None = None
    view: NDArray[np.int32] | None = None
    origin: NDArray[np.int32] | None = None

    def __post_init__(self) -> None:
        count = len(self.parameters)
        shapes: tuple[tuple[str, NDArray[np.generic] | None, tuple[int, ...]], ...] = (
            ("parameters", self.parameters, (count, 7, 3)),
            ("base_m", self.base_m, (count, 3)),
            ("orientation", self.orientation, (count, 4)),
            ("length_m", self.length_m, (count,)),
            ("phase", self.phase, (count,)),
            ("color", self.color, (count, 3)),
            ("confidence", self.confidence, (count,)),
            ("residual_m", self.residual_m, (count,)),
            ("view", self.view, (count,)),
            ("origin", self.origin, (count,)),
        )
        for name, array, shape in shapes:
            if array is not None and array.shape != shape:
                raise ValueError(f"{name} must be {shape}, not {array.shape}")

    def __len__(self) -> int:
        return len(self.parameters)

    def asset_from_leaf(self) -> NDArray[np.float64]:
        """(N, 3, 4) float64: turn, scale by the length and move, for column vectors."""
        x, y, z, w = np.moveaxis(np.asarray(self.orientation, np.float64), -1, 0)
        norm = x * x + y * y + z * z + w * w
        scale = np.asarray(self.length_m, np.float64) / np.where(norm > 0, norm, 1.0)
        rows = np.array(
            [
                [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
            ]
        )
        matrix = np.empty((len(self), 3, 4))
        matrix[:, :, :3] = np.moveaxis(rows, -1, 0) * scale[:, None, None]
        matrix[:, :, 3] = self.base_m
        return matrix

    def take(self, chosen: ArrayLike) -> "Leaves":
        """The leaves of these numbers, or of this mask, in this order."""
        index = np.asarray(chosen)
        fields = {name: getattr(self, name) for name in self.__dataclass_fields__}
        return replace(self, **{name: array[index] for name, array in fields.items() if array is not None})


def mean_leaf(parameters: NDArray[np.floating], weights: NDArray[np.floating] | None = None) -> NDArray[np.float64]:
    """The average leaf of a set: (7, 3) float64 from (N, 7, 3) and weights (N,), equal by default.

    Raises:
        ValueError: There is no leaf, or the weights do not sum to more than 0.
    """
    if len(parameters) == 0:
        raise ValueError("no leaves to average")
    total = float(np.sum(weights)) if weights is not None else float(len(parameters))
    if not total > 0:
        raise ValueError(f"the weights must sum to more than 0, not {total}")
    return np.asarray(np.average(np.asarray(parameters, np.float64), axis=0, weights=weights))


def count_origins(leaves: Leaves) -> dict[str, int]:
    """How many leaves are of each LeafOrigin, by its name in lower case; empty where origins are unknown."""
    if leaves.origin is None:
        return {}
    return {origin.name.lower(): int(np.count_nonzero(leaves.origin == origin)) for origin in LeafOrigin}


def describe_origins(counts: Mapping[str, int]) -> str:
    """The counts of count_origins as text, such as "93 found, 12 completed"; empty where there are none."""
    return ", ".join(f"{count:,} {name.replace('_', ' ')}" for name, count in counts.items() if count)


def unit_quaternions(turns: NDArray[np.floating]) -> NDArray[np.floating]:
    """Quaternions (N, 4) made unit where they are not; the others keep their bits."""
    length = np.linalg.norm(turns, axis=1, keepdims=True)
    return np.where(np.abs(length - 1) <= _UNIT, turns, turns / length)
