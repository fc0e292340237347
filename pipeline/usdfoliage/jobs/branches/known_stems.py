"""Stems that were found otherwise than in the cloud, and what the user should know of them."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.photographs.joined import StemPiece
from usdfoliage.remarks import Remark, remark

_DESCRIBED = 8  # pieces that are described one by one
_MANY_TURNED = 0.15  # share of the leaves, up to which turned ones are no cause to look
_SPREADS = 2.0  # standard deviations, by which more leaves are turned than bases were likely to be wrong


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownStems:
    """Stems that were found otherwise than in the cloud."""

    skeleton: Skeleton
    own_from_cloud: NDArray[np.float64]  # (4, 4) for column vectors: from the cloud's coordinates to the skeleton's
    leaves: int = 0  # that were found before
    # (leaves,), 0.5 to 1, the probability that the base is the base; None where bases were taken for certain.
    certainty: NDArray[np.float64] | None = None
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
    if len(stems.turned):
        remarks.append(_describe_turned(stems))
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


def _describe_turned(stems: KnownStems) -> Remark:
    """Leaves that are turned to stems; a warning where these contradict what was known of the bases.

    The shape of a leaf often leaves open which end is its base. Of leaves of certainty c about 1 - c have the wrong end
    for it, and it is right that stems turn these. Only where more are turned than that explains, something is wrong.
    """
    turned, leaves = len(stems.turned), stems.leaves
    certainty = np.ones(leaves) if stems.certainty is None else stems.certainty
    wrong = float(np.sum(1 - certainty))
    spread = float(np.sqrt(np.sum(certainty * (1 - certainty))))
    text = f"{turned} of {leaves} leaves are turned end for end: a stem leads to their other end"
    if turned > max(_MANY_TURNED * leaves, wrong + _SPREADS * spread):
        text = (
            f"{text}; these are {turned / leaves:.0%}, and {wrong / leaves:.0%} were likely to have the wrong end as "
            "their base: the stems may be wrong, or the leaves' bases were"
        )
        return remark("many-leaves-turned-to-stems", text, remedy="look at the stems and leaves")
    if wrong >= 1:
        text = f"{text}; without stems, some {wrong:.0f} of the {leaves} are likely to have the wrong end as their base"
    return remark("leaves-turned-to-stems", text)
