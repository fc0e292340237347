"""Moving a cage so that its Catmull–Clark limit passes where the branches are.

Each vertex is moved by what its limit is off, again and again: after few rounds the limit is there wherever it is
smooth, and short waves, which a solution in one step would overshoot with, are left out. Along the tubes vertices are
not moved, so that uneven rows stay in order; what is asked there is only that the surface be at the right distance.

Source:
    Limit positions: M. Halstead et al., Efficient, fair interpolation using Catmull-Clark surfaces, 1993, section 4.
    The rounds: H. Lin et al., Survey on geometric iterative methods, 2018, section 3.
"""

import numpy as np

from usdfoliage import _native
from usdfoliage.branch.cage.tubes import Floats, Ints

FARTHEST = 0.5  # radii: no vertex is moved by more


def pull_limit(
    faces: Ints, aims: Floats, tangents: Floats, swell: Floats, center: Floats, rounds: int, gain: Floats
) -> Floats:
    """Vertices whose limits are at their aims, nearly.

    Args:
        faces: (F, 4) a closed mesh.
        aims: (V, 3) where the limits are to be.
        tangents: (V, 3) unit vector along which a vertex is not moved; 0 for none.
        swell: (V, 2) by how much a tube's radius grows per length along the tangent, ahead and behind.
        center: (V, 3) the place of the axis that an aim belongs to.
        rounds: How often.
        gain: (V,) share of what is missing that a vertex is moved by.
    """
    return _native.pull_limit(
        faces,
        _native.LimitAims(
            aims_m=aims,
            tangents=tangents,
            swell=np.ascontiguousarray(swell),
            center_m=np.ascontiguousarray(center),
            gain=gain,
        ),
        rounds=rounds,
        farthest=FARTHEST,
        threads=0,
    )
