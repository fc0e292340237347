"""Planes of a photograph in half the bytes, as they are kept from one round of matching to the next."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.mvs.patch_match import MatchedPlanes
from usdfoliage.geometry.pinhole import Pinhole


@dataclass(frozen=True, kw_only=True, eq=False)
class PackedPlanes:
    """Planes whose slopes and costs have the few digits that count."""

    inverse: NDArray[np.float32]  # (h, w), inverse depth, 0 for none
    slopes: NDArray[np.float16]  # (h, w, 2), its change to the next pixel right and down, by the inverse depth
    cost: NDArray[np.float16]  # (h, w)


def pack_planes(matched: MatchedPlanes) -> PackedPlanes:
    """Half the size: changes relative to the inverse depth are small numbers whose first digits are enough."""
    inverse = matched.planes[..., :1]
    slopes = np.divide(matched.planes[..., 1:], inverse, out=np.zeros_like(matched.planes[..., 1:]), where=inverse > 0)
    return PackedPlanes(
        inverse=matched.planes[..., 0].copy(),
        slopes=slopes.astype(np.float16),
        cost=matched.cost.astype(np.float16),
    )


def unpack_planes(packed: PackedPlanes, camera: Pinhole) -> MatchedPlanes:
    """The planes again.

    Args:
        packed: Of a photograph.
        camera: Of that photograph, of any size.
    """
    planes = np.empty((*packed.inverse.shape, 3), np.float32)
    planes[..., 0] = packed.inverse
    planes[..., 1:] = packed.slopes.astype(np.float32) * packed.inverse[..., None]
    height, width = packed.inverse.shape
    return MatchedPlanes(camera=camera.resized(width, height), planes=planes, cost=packed.cost.astype(np.float32))


def reader_of_planes(
    packed: Sequence[PackedPlanes | None], cameras: Sequence[Pinhole]
) -> Callable[[int], MatchedPlanes | None]:
    """What gives the planes of a view by its number; None for a view that has none.

    Args:
        packed: Of each view.
        cameras: Likewise, of any size.
    """

    def read(index: int) -> MatchedPlanes | None:
        of_view = packed[index]
        return None if of_view is None else unpack_planes(of_view, cameras[index])

    return read
