"""What instancers of leaves, clusters and plants have in common."""

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom, Vt


def author_turns(
    instancer: UsdGeom.PointInstancer, turns: NDArray[np.floating], time: Usd.TimeCode = Usd.TimeCode.Default()
) -> None:
    """Author how instances are turned, exactly and, for older applications, in half precision.

    Args:
        instancer: Of N instances.
        turns: (N, 4) unit quaternions, their real part last, as USD's arrays have them.
        time: At which they are so.
    """
    exact = np.ascontiguousarray(turns, np.float32)
    instancer.CreateOrientationsfAttr().Set(Vt.QuatfArray.FromNumpy(exact), time)  # takes precedence
    instancer.CreateOrientationsAttr().Set(Vt.QuathArray.FromNumpy(exact.astype(np.float16)), time)
