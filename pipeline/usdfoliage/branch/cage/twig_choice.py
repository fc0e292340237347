"""Which branches of a plant are joined, which are twigs, and which are left out of its surface."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.cage.twigs import TwigSettings


@dataclass(frozen=True, kw_only=True, eq=False)
class TwigChoice:
    """Which branches are twigs, which are left out, and how coarse twigs are."""

    is_twig: NDArray[np.bool_]  # (B,)
    gone: NDArray[np.bool_]  # (B,)
    twig_settings: TwigSettings
    afloat: NDArray[np.bool_] | None = None  # (B,), those of what is left out that were beside the surface
    apart: NDArray[np.bool_] | None = (
        None  # (B,), those of the others that are pieces of their own, with what they carry
    )
    tried: NDArray[np.int64] | None = None  # (B,), how often forks were tried in a surface of much the same branches
