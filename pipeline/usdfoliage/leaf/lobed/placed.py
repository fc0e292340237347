"""A lobed leaf in metres, its base at the origin, in the plane that its picture becomes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.leaf.lobed.branches import LobedShape, build_branches
from usdfoliage.leaf.lobed.deformation import FLAT, BranchFunctions, deform_leaves
from usdfoliage.leaf.lobed.model import FlatLobedLeaf

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class LobedLeaf:
    """A leaf of several lobes: x to the right and y up as in its picture, z towards who looks at that; metres.

    Attributes:
        silhouette_m: (C, 2), control points of the closed cubic B-spline, counter-clockwise from the base on.
        shape: Skeleton, ties and faces of the flat leaf, the base at the origin.
        st: (N + T, 2), of the nodes and then the ends of the ties: s = x / W, t = 1 - y / H in the picture.
        asset_from_picture: (4, 4) for column vectors, from pixels (x to the right, y down, 0).
        functions: That deform it.
    """

    silhouette_m: Floats
    shape: LobedShape
    st: Floats
    asset_from_picture: Floats
    functions: BranchFunctions = FLAT

    def points_m(self) -> Floats:
        """(N + T, 3) the nodes and the ends of the ties, deformed."""
        return deform_leaves(self.shape, [self.functions])[0]


def measure_leaf(flat: FlatLobedLeaf) -> tuple[float, float]:
    """Width and height of a leaf as it lay in its picture, in pixels."""
    width, height = np.ptp(flat.ties.places(), axis=0).tolist()
    return width, height


def place_leaf(flat: FlatLobedLeaf, picture_px: tuple[int, int], metres_per_px: float) -> LobedLeaf:
    """A leaf of a picture in metres.

    Args:
        flat: In pixels.
        picture_px: Width and height of the whole picture.
        metres_per_px: Above 0.

    Raises:
        ValueError: The skeleton is no tree, or a size is not above 0.
    """
    if not (np.isfinite(metres_per_px) and metres_per_px > 0 and min(picture_px) > 0):
        raise ValueError(f"pixels of {metres_per_px} m in a picture of {picture_px} cannot be")
    in_px = build_branches(flat.ties)
    base = in_px.nodes[0]
    control = flat.silhouette.control_px
    first = int(np.argmin(((control - base) ** 2).sum(axis=1)))
    places = in_px.places
    matrix = np.diag([metres_per_px, -metres_per_px, metres_per_px, 1.0])
    matrix[:2, 3] = -base * metres_per_px
    return LobedLeaf(
        silhouette_m=(np.roll(control, -first, axis=0) - base) * metres_per_px,
        shape=LobedShape(
            nodes=(in_px.nodes - base) * metres_per_px,
            parents=in_px.parents,
            branches=in_px.branches,
            tie_nodes=in_px.tie_nodes,
            feet=(in_px.feet - base) * metres_per_px,
            faces=in_px.faces,
        ),
        st=np.column_stack([places[:, 0] / picture_px[0], 1 + places[:, 1] / picture_px[1]]),
        asset_from_picture=matrix,
    )
