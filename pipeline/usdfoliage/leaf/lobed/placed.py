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


@dataclass(frozen=True, kw_only=True)
class PictureCrop:
    """The part of a picture in which a leaf was modelled."""

    left_px: float = 0.0  # of the picture
    top_px: float = 0.0
    pixel: float = 1.0  # pixels of the picture across one of the part


def place_leaf(
    flat: FlatLobedLeaf, picture_px: tuple[int, int], metres_per_px: float, crop: PictureCrop = PictureCrop()
) -> LobedLeaf:
    """A leaf of a picture in metres.

    Args:
        flat: In pixels of the crop.
        picture_px: Width and height of the whole picture.
        metres_per_px: Of the picture, above 0.
        crop: Where the leaf was modelled; the whole picture by default.

    Raises:
        ValueError: The skeleton is no tree, or a size is not above 0.
    """
    if not (np.isfinite(metres_per_px) and metres_per_px > 0 and min(picture_px) > 0):
        raise ValueError(f"pixels of {metres_per_px} m in a picture of {picture_px} cannot be")
    shape = build_branches(flat.ties)
    corner = np.array([crop.left_px, -crop.top_px])  # y goes up
    nodes, feet = corner + crop.pixel * shape.nodes, corner + crop.pixel * shape.feet
    base = nodes[0]
    control = corner + crop.pixel * flat.silhouette.control_px
    first = int(np.argmin(((control - base) ** 2).sum(axis=1)))
    places = np.concatenate([nodes, feet])
    matrix = np.diag([metres_per_px, -metres_per_px, metres_per_px, 1.0])
    matrix[:2, 3] = -base * metres_per_px
    return LobedLeaf(
        silhouette_m=(np.roll(control, -first, axis=0) - base) * metres_per_px,
        shape=LobedShape(
            nodes=_stored((nodes - base) * metres_per_px),
            parents=shape.parents,
            branches=shape.branches,
            tie_nodes=shape.tie_nodes,
            feet=_stored((feet - base) * metres_per_px),
            faces=shape.faces,
        ),
        st=np.column_stack([places[:, 0] / picture_px[0], 1 + places[:, 1] / picture_px[1]]),
        asset_from_picture=matrix,
    )


def _stored(places: Floats) -> Floats:
    """Places as a file has them: a reader then finds the headings that turns are counted from, to the last digit."""
    return places.astype(np.float32).astype(np.float64)
