"""Stems that were found otherwise than in the cloud, and what the user should know of them."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.photographs.joining import StemPiece
from usdfoliage.remarks import Remark, remark

_DESCRIBED = 8  # pieces that are described one by one
_MANY_TURNED = 0.15  # share of the leaves, above which so many wrong bases are no chance


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownStems:
    """Stems that were found otherwise than in the cloud."""

    skeleton: Skeleton
    own_from_cloud: NDArray[np.float64]  # (4, 4) for column vectors: from the cloud's coordinates to the skeleton's
    leaves: int = 0  # that were found before
    # Numbers of leaves that it leads to by what was taken for their apex.
    turned: NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, np.int32))
    # Numbers of leaves that it does not lead to.
    unjoined: NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, np.int32))
    apart: tuple[StemPiece, ...] = ()  # that look like stems and are not joined to it, the longest first


def describe_known_stems(stems: KnownStems, asset_from_own: NDArray[np.float64]) -> tuple[Remark, ...]:
    """What the user should know of stems that photographs showed.

    Args:
        stems: Of the photographs.
        asset_from_own: (4, 4) for column vectors, from the skeleton's coordinates: places are in the asset's frame.
    """
    skeleton, leaves = stems.skeleton, stems.leaves
    roots = int((skeleton.parent_curve < 0).sum())
    led_to = f", which lead to {leaves - len(stems.unjoined)} of {leaves} leaves that were found" if leaves else ""
    text = f"stems are lines in the photographs: {len(skeleton)} branches, from the soil at {roots} places{led_to}"
    remarks = [remark("stems-of-photographs", text)]
    turned = len(stems.turned)
    if turned:
        text = f"{turned} of {leaves} leaves are turned end for end: a stem leads to their other end"
        if turned > _MANY_TURNED * leaves:
            text = f"{text}; these are {turned / leaves:.0%}, and the stems may be wrong, or the leaves' bases were"
            remarks.append(remark("many-leaves-turned-to-stems", text, remedy="look at the stems and leaves"))
        else:
            remarks.append(remark("leaves-turned-to-stems", text))
    if stems.apart:
        scale = float(np.cbrt(np.linalg.det(asset_from_own[:3, :3])))
        described = "; ".join(
            f"{1000 * scale * part.length_m:.0f} mm long at ({', '.join(f'{c:.3f}' for c in middle_m)})"
            for part in stems.apart[:_DESCRIBED]
            for middle_m in [asset_from_own[:3, :3] @ part.middle_m + asset_from_own[:3, 3]]
        )
        more = f" and {len(stems.apart) - _DESCRIBED} more" if len(stems.apart) > _DESCRIBED else ""
        count = len(stems.apart)
        text = f"{count} pieces that look like stems are not joined to the plant and left out: {described}{more}"
        remarks.append(remark("stems-apart-left-out", text))
    return tuple(remarks)
