"""Native kernels of usdfoliage; arrays in, arrays out, the interpreter lock released. Arguments are trusted."""

import enum
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

class RefinedMesh:
    """A refined mesh of quads."""

    @property
    def points(self) -> NDArray[np.float64]:
        """(V, 3)."""
    @property
    def normals(self) -> NDArray[np.float64]:
        """(V, 3) at the limit, else (0, 3)."""
    @property
    def faces(self) -> NDArray[np.int32]:
        """(F, 4)."""

def refine_catmull_clark(
    points: NDArray[np.float64],
    face_counts: NDArray[np.int32],
    face_indices: NDArray[np.int32],
    *,
    crease_edges: NDArray[np.int32],
    crease_sharpness: NDArray[np.float32],
    corner_vertices: NDArray[np.int32],
    corner_sharpness: NDArray[np.float32],
    levels: int,
    limit: bool,
) -> RefinedMesh:
    """A mesh refined by OpenSubdiv, at its limit or not; levels may be 0 for a mesh of quads alone.

    Raises:
        ValueError: counts and indices do not fit, or OpenSubdiv refuses the topology.
    """

def radius_map(
    points: NDArray[np.float64], triangles: NDArray[np.int32], size: int, threads: int
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Farthest hit of each texel's ray from the origin: radius (6, N, N), 0 for none, and triangle, -1 for none."""

def cut_grid(down: NDArray[np.int32], right: NDArray[np.int32], terminal: NDArray[np.int32]) -> NDArray[np.uint8]:
    """Minimum cut of a grid: 0 for the first end, 1 for the second, which gets what either could have.

    Args:
        down: (H, W) capacity between a pixel and the next one below; from the last row to the first one.
        right: (H, W) the same to the right.
        terminal: (H, W) capacity to the first end where positive, to the second end where negative.
    """

class Exemplar:
    """What may be copied."""

    def __init__(
        self, *, color: NDArray[np.int16], valid: NDArray[np.uint8], guide: NDArray[np.int16] | None = None
    ) -> None:
        """Its arrays.

        Args:
            color: (h, w, 4), integers 0 to 1023, the last channel 0.
            valid: (h, w), 1 where a pixel may be copied.
            guide: (h, w, 4), the same colours as the next coarser level has them; refine_sources needs it.
        """

class Synthesis:
    """What is made of it, changed in place."""

    def __init__(
        self,
        *,
        source: NDArray[np.int32],
        color: NDArray[np.int16],
        known: NDArray[np.uint8],
        guide: NDArray[np.int16] | None = None,
    ) -> None:
        """Its arrays.

        Args:
            source: (H, W, 2), row and column in the exemplar, -1 where there is none yet; filled in place.
            color: (H, W, 4), as that of the exemplar; filled in place.
            known: (H, W), 0 free, 1 colour given and source to be found, 2 both given.
            guide: (H, W, 4), the coarser level's result; refine_sources needs it.
        """

class PlaceSettings:
    """Which patches are laid."""

    patch_px: int  # side of a patch
    overlap_px: int  # with its neighbours
    usage_weight: float  # how much dearer a place gets by every use
    near_weight: float  # and by every use within two patches
    candidate_share: float  # of all places, how many are tried for a patch, in [0, 1]
    max_places: int  # so many are tried on a grid at most, then all around the best of them
    cuts: int  # of the places that match best, how many are compared by their seam
    seed: int  # of the choice, 32 bits

    def __init__(
        self,
        *,
        patch_px: int,
        overlap_px: int,
        usage_weight: float,
        near_weight: float,
        candidate_share: float,
        max_places: int,
        cuts: int,
        seed: int,
    ) -> None: ...

def place_patches(exemplar: Exemplar, synthesis: Synthesis, *, settings: PlaceSettings, threads: int) -> int:
    """Fill what is free, in place, with patches of the exemplar; their number, 0 where none fits into it."""

class RefineSettings:
    """How neighbourhoods are compared."""

    radius: int  # of the neighbourhoods, in pixels
    guide_weight: int  # of the guide's colour, in pixels
    random_tries: int  # random places a pixel
    seed: int  # of the random places, 32 bits

    def __init__(self, *, radius: int, guide_weight: int, random_tries: int, seed: int) -> None: ...

def refine_sources(exemplar: Exemplar, synthesis: Synthesis, *, settings: RefineSettings, threads: int) -> None:
    """One pass over a synthesis, in place, towards neighbourhoods of the exemplar; both have a guide."""

def leaf_nets(leaves: NDArray[np.float64], *, nets: NDArray[np.float64], threads: int) -> None:
    """Fill control nets (N, 5, 7, 3) of leaves (N, 7, 3)."""

def leaf_axes(
    leaves: NDArray[np.float64],
    v: NDArray[np.float64],
    *,
    shared: bool,
    points: NDArray[np.float64] | None = None,
    normals: NDArray[np.float64] | None = None,
    threads: int,
) -> None:
    """Fill points and normals (N, P, 3) of the axes at v (N, P), or (1, P) shared by all."""

class LeafJitter:
    """A wave along the silhouettes, the same for all leaves but for the phase."""

    def __init__(
        self,
        *,
        amplitude: float,
        frequency: float,
        waves: NDArray[np.float64],
        map: NDArray[np.float64] | None = None,
        phases: NDArray[np.float64] | None = None,
    ) -> None:
        """The wave.

        Args:
            amplitude: In leaf lengths.
            frequency: Cycles from base to apex.
            waves: (K, 2), cycles a unit and weight of the procedural jitter, used without a map.
            map: (M,), numbers from -1 to 1, one cycle.
            phases: (N,), in cycles; 0 without.
        """

def leaf_samples(
    leaves: NDArray[np.float64],
    uv: NDArray[np.float64],
    *,
    shared: bool,
    jitter: LeafJitter,
    placements: NDArray[np.float64] | None,
    points: NDArray[np.float32] | NDArray[np.float64] | None,
    tangents_u: NDArray[np.float32] | NDArray[np.float64] | None,
    tangents_v: NDArray[np.float32] | NDArray[np.float64] | None,
    normals: NDArray[np.float32] | NDArray[np.float64] | None,
    areas: NDArray[np.float32] | NDArray[np.float64] | None,
    threads: int,
) -> None:
    """Fill the outputs that are not None, of one type: leaves (N, 7, 3) at uv (N, P, 2) or (1, P, 2), shared by all.

    Args:
        jitter: Of the silhouettes.
        placements: (N, 3, 4); leaf space without.
        points: (N, P, 3), as tangents and normals.
        areas: (N, P) lengths of the cross product of the tangents.
    """

def leaf_jacobians(
    leaves: NDArray[np.float64],
    uv: NDArray[np.float64],
    *,
    shared: bool,
    points: NDArray[np.float64],
    jacobians: NDArray[np.float64],
    threads: int,
) -> None:
    """Fill points (N, P, 3) and their derivatives (N, P, 3, 21) by the parameters."""

def leaf_bounds(
    leaves: NDArray[np.float64],
    *,
    placements: NDArray[np.float64] | None,
    reach: float,
    group: int,
    bounds: NDArray[np.float64],
    threads: int,
) -> None:
    """Fill boxes (ceil(N / group), 2, 3), least and greatest, around leaves (N, 7, 3).

    Args:
        placements: (N, 3, 4); leaf space without.
        reach: How far jitter may move a silhouette, in leaf lengths.
        group: Leaves that follow each other and share a box.
    """

class DrawnLeaves:
    """A picture of leaves."""

    @property
    def ids(self) -> NDArray[np.int32]:
        """(H, W), -1 for none."""
    @property
    def depth(self) -> NDArray[np.float32]:
        """(H, W), 0 for none."""

def draw_leaf_grids(places: NDArray[np.float64], *, height: int, width: int, threads: int) -> DrawnLeaves:
    """Draw grids (N, V, U, 3), x, y and depth, with a z-buffer."""

def enclosing_ellipses(
    points: NDArray[np.float64],
    offsets: NDArray[np.int64],
    *,
    tolerance: float,
    centers: NDArray[np.float64],
    half_axes: NDArray[np.float64],
    angles: NDArray[np.float64],
    threads: int,
) -> None:
    """Fill the smallest ellipses around the sets of points (P, 2) that begin at offsets (M + 1,).

    Args:
        centers: (M, 2), NaN for no point.
        half_axes: (M, 2), the longer one first.
        angles: (M,), of the longer one from +x, in radians.
    """

class Robustness(enum.Enum):
    """What points off the surface count."""

    NONE = 0  # as much as all others; none is left out
    HUBER = 1
    TUKEY = 2

class LeafFitSettings:
    """How leaves are fitted, and which are not."""

    min_points: int  # leaves of fewer are not fitted
    isolation: float  # points whose neighbours are this many times farther than the median are left out, but for NONE
    scanlines: int  # at most; a leaf of few points has fewer
    max_iterations: int  # of mapping and fitting in turns
    tolerance: float  # root mean square change, in leaf lengths, that ends the iterations
    robustness: Robustness
    prior: float  # pull towards the enclosing ellipse, a share of what all points pull

    def __init__(
        self,
        *,
        min_points: int,
        isolation: float,
        scanlines: int,
        max_iterations: int,
        tolerance: float,
        robustness: Robustness,
        prior: float,
    ) -> None: ...

class LeafFits:
    """What is fitted to M leaves; zeros where the outcome is not 0."""

    @property
    def parameters(self) -> NDArray[np.float64]:
        """(M, 7, 3)."""
    @property
    def ellipses(self) -> NDArray[np.float64]:
        """(M, 7, 3), the leaves that the fits began with."""
    @property
    def base_m(self) -> NDArray[np.float64]:
        """(M, 3)."""
    @property
    def axes(self) -> NDArray[np.float64]:
        """(M, 3, 3), rows x, y and z of leaf space."""
    @property
    def length_m(self) -> NDArray[np.float64]:
        """(M,)."""
    @property
    def residual_m(self) -> NDArray[np.float64]:
        """(M,), root mean square distance of all points from the surface."""
    @property
    def coverages(self) -> NDArray[np.float64]:
        """(M,), share of the leaf's width that points reach."""
    @property
    def iterations(self) -> NDArray[np.int32]:
        """(M,)."""
    @property
    def outcomes(self) -> NDArray[np.int32]:
        """(M,), 0 fitted, 1 too few points, 2 not finite, 3 on a line."""

def fit_leaves(
    points_m: NDArray[np.float64],
    normals: NDArray[np.float64],
    offsets: NDArray[np.int64],
    *,
    settings: LeafFitSettings,
    threads: int,
) -> LeafFits:
    """Fit a leaf to each set of points (P, 3) that begins at offsets (M + 1,); normals (P, 3) towards the cameras."""

def map_leaf_points(
    leaf: NDArray[np.float64],
    points: NDArray[np.float64],
    *,
    half_width: float,
    uv: NDArray[np.float64],
    line: NDArray[np.int32],
    weights: NDArray[np.float64],
) -> None:
    """Fill the (u, v) of points (P, 3) in the space of one leaf (7, 3), and eq. 10's weights of its scanlines.

    Args:
        half_width: Of the enclosing ellipse, in leaf lengths.
        uv: (P, 2).
        line: (P,), number of the scanline of each point, -1 for none.
        weights: (scanlines, 2), right half and left half.
    """

class SurfacePoints:
    """Points of N leaves, leaf after leaf."""

    def __init__(
        self,
        *,
        points_m: NDArray[np.float64],
        edge: NDArray[np.uint8],
        weights: NDArray[np.float64],
        offsets: NDArray[np.int64],
        noise_m: NDArray[np.float64],
    ) -> None:
        """Their arrays.

        Args:
            points_m: (P, 3).
            edge: (P,), 1 where the leaf ends.
            weights: (P,).
            offsets: (N + 1,), where the points of each leaf begin.
            noise_m: (N,), standard deviation of the points.
        """

class SurfacePriors:
    """Normal distributions of what a leaf looks like: parameters and the logarithm of the length."""

    def __init__(self, *, means: NDArray[np.float64], precisions: NDArray[np.float64]) -> None:
        """K of them: means (K, 22), precisions (K, 22, 22)."""

class SurfaceFits:
    """Where S fits begin, and what they become: written in place, but for leaf and version."""

    def __init__(
        self,
        *,
        leaf: NDArray[np.int64],
        version: NDArray[np.int64],
        parameters: NDArray[np.float64],
        axes: NDArray[np.float64],
        base_m: NDArray[np.float64],
        length_m: NDArray[np.float64],
        costs: NDArray[np.float64],
    ) -> None:
        """Their arrays.

        Args:
            leaf: (S,), whose points.
            version: (S,), which of the priors.
            parameters: (S, 7, 3).
            axes: (S, 3, 3) with the leaf's x, y and z in the columns.
            base_m: (S, 3).
            length_m: (S,).
            costs: (S, 3), only written: of the points, of the prior, of folds.
        """

class SurfaceFitSettings:
    """How fits go on."""

    iterations: int  # of each fit
    first_cutoff: float  # noises beyond which points count less, at first
    cutoff: float  # the same in the last third of the iterations
    edge_noise: float  # noise of points of the edge, in that of the interior
    fold_weight: float  # of leaves that fold over themselves

    def __init__(
        self, *, iterations: int, first_cutoff: float, cutoff: float, edge_noise: float, fold_weight: float
    ) -> None: ...

def fit_leaf_surfaces(
    points: SurfacePoints,
    priors: SurfacePriors,
    fits: SurfaceFits,
    *,
    settings: SurfaceFitSettings,
    threads: int,
) -> None:
    """Improve S fits in place, each of a leaf's points under one of the priors."""

class PosedLeaves:
    """N leaves and their places."""

    def __init__(
        self,
        *,
        parameters: NDArray[np.float64],
        axes: NDArray[np.float64],
        base_m: NDArray[np.float64],
        length_m: NDArray[np.float64],
    ) -> None:
        """Their arrays: (N, 7, 3); (N, 3, 3) with the leaf's x, y and z in the columns; (N, 3); (N,)."""

class ClosestPlaces:
    """The places of leaves that are closest to P points."""

    @property
    def uv(self) -> NDArray[np.float64]:
        """(P, 2)."""
    @property
    def distance_m(self) -> NDArray[np.float64]:
        """(P,)."""

def project_to_leaves(
    points_m: NDArray[np.float64],
    leaves: PosedLeaves,
    *,
    edge: NDArray[np.uint8],
    offsets: NDArray[np.int64],
    threads: int,
) -> ClosestPlaces:
    """The places of leaves that are closest to their points (P, 3), leaf after leaf as offsets (N + 1,) name them.

    Args:
        edge: (P,), 1 for points whose places are on the silhouette.
    """

class DepthView:
    """A depth map and the pinhole camera that saw it."""

    def __init__(
        self, depth_m: NDArray[np.float32], intrinsics: NDArray[np.float64], cam_from_world: NDArray[np.float64]
    ) -> None: ...
    @property
    def depth_m(self) -> NDArray[np.float32]:
        """(H, W), along the optical axis, 0 where there is none."""
    @property
    def intrinsics(self) -> NDArray[np.float64]:
        """(4,), focal lengths and centre, x and y each, in pixels."""
    @property
    def cam_from_world(self) -> NDArray[np.float64]:
        """(3, 4)."""

class LocalPlanes:
    """Planes around P pixels."""

    @property
    def slopes(self) -> NDArray[np.float32]:
        """(P, 3), inverse depth: its change a pixel to the right and down, its value, in 1 / m."""
    @property
    def support(self) -> NDArray[np.float32]:
        """(P,), about how many neighbours lie on it."""

def fit_local_planes(
    view: DepthView,
    pixels: NDArray[np.int64] | None = None,
    *,
    radius_px: int,
    steepest: float,
    noise_m: float,
    threads: int,
) -> LocalPlanes:
    """Planes around pixels (P,), all without.

    Args:
        radius_px: Of the window.
        steepest: The steepest surface, in footprints of depth a pixel.
        noise_m: Standard deviation of the depth.
    """

def plane_normals(
    view: DepthView, slopes: NDArray[np.float32], pixels: NDArray[np.int64] | None = None, *, threads: int
) -> NDArray[np.float32]:
    """Unit normals (P, 3) in the world, towards the camera, of planes (P, 3) around pixels; 0 where there is none."""

class PlaneGaps:
    """Gaps between the planes of neighbours, in footprints of a pixel; 1e30 without a neighbour."""

    @property
    def right(self) -> NDArray[np.float32]:
        """(H, W), to the next pixel to the right."""
    @property
    def down(self) -> NDArray[np.float32]:
        """(H, W), to the next pixel below."""

def measure_gaps(view: DepthView, slopes: NDArray[np.float32], *, threads: int) -> PlaneGaps:
    """Gaps between planes (H * W, 3)."""

class JoinedPixels:
    """Connected pieces."""

    @property
    def labels(self) -> NDArray[np.int32]:
        """(H, W), 0 for none."""
    @property
    def count(self) -> int:
        """Number of pieces."""

def join_pixels(
    view: DepthView,
    *,
    right: NDArray[np.float32],
    down: NDArray[np.float32],
    valid: NDArray[np.uint8],
    max_gap: float,
    noise_m: float,
    min_px: int,
) -> JoinedPixels:
    """Pieces of at least min_px pixels whose gaps are below max_gap + noise_m / footprint.

    Args:
        right: (H, W), as measure_gaps gives it, as is down.
        valid: (H, W), 0 for pixels that are of no piece.
    """

def classify_edges(
    view: DepthView,
    labels: NDArray[np.int32],
    pixels: NDArray[np.int64] | None = None,
    *,
    footprints: float,
    noise_m: float,
    threads: int,
) -> NDArray[np.uint8]:
    """Kinds (P,) of pixels, all by default, by labels (H, W): 0 interior, 1 free, 2 hidden edge, 3 no depth beside.

    Args:
        footprints: And noise_m more: by how much what is beside an edge lies farther or nearer.
    """

class EdgePlaces:
    """Where what P pixels show ends."""

    @property
    def places_px(self) -> NDArray[np.float64]:
        """(P, 2)."""
    @property
    def depth_m(self) -> NDArray[np.float64]:
        """(P,)."""

def place_edges(
    view: DepthView,
    labels: NDArray[np.int32],
    slopes: NDArray[np.float32],
    *,
    pixels: NDArray[np.int64],
    kinds: NDArray[np.uint8],
    beside_px: int,
    threads: int,
) -> EdgePlaces:
    """Places for free edges half way to what is behind, within beside_px pixels; for others the pixels' centres."""

class PointSums:
    """Sums over the points of K labels, in camera axes."""

    @property
    def pixels(self) -> NDArray[np.float64]:
        """(K,), number of points."""
    @property
    def sums(self) -> NDArray[np.float64]:
        """(K, 3), of x, y and z, from the first point."""
    @property
    def products(self) -> NDArray[np.float64]:
        """(K, 6), of xx, xy, xz, yy, yz and zz, from the first point."""
    @property
    def first_m(self) -> NDArray[np.float64]:
        """(K, 3), the first point."""

def sum_points(view: DepthView, labels: NDArray[np.int32], *, count: int) -> PointSums:
    """Sums over the points of each of count labels (H, W), 0 for none."""

class Extents:
    """Sizes of K labels."""

    @property
    def length_m(self) -> NDArray[np.float64]:
        """(K,), along the first axis."""
    @property
    def width_m(self) -> NDArray[np.float64]:
        """(K,), along the second."""
    @property
    def area_m2(self) -> NDArray[np.float64]:
        """(K,), with the third axis as normal."""

def measure_extents(
    view: DepthView, labels: NDArray[np.int32], *, axes: NDArray[np.float64], min_cosine: float
) -> Extents:
    """Extents along the first two rows of axes (K, 3, 3), and areas; a smaller cosine counts as min_cosine."""

class FuseSettings:
    """When depths of several views are of one surface."""

    footprints: float  # of a pixel, that depths may differ by
    noise_m: float  # and so much more
    min_own: int  # depths, its own with them, that confirm a pixel's own
    min_others: int  # depths that stand in for one that is not confirmed, or for none

    def __init__(self, *, footprints: float, noise_m: float, min_own: int, min_others: int) -> None: ...

class FusedDepth:
    """A view's depth from its own and others'."""

    @property
    def depth_m(self) -> NDArray[np.float32]:
        """(H, W), 0 for none."""
    @property
    def kinds(self) -> NDArray[np.uint8]:
        """(H, W): 0 no depth, 1 alone, 2 confirmed, 3 replaced, 4 filled, 5 removed."""

def fuse_depth(view: DepthView, others: list[DepthView], *, settings: FuseSettings, threads: int) -> FusedDepth:
    """Depth from a view's own and others'; what became of each pixel."""

def claim_pixels(
    view: DepthView,
    grids: NDArray[np.float64],
    *,
    penalty: NDArray[np.float32],
    footprints: float,
    noise_m: float,
    min_cosine: float,
    threads: int,
) -> NDArray[np.int32]:
    """Labels (H, W) of the leaf, drawn as a grid (N, V, U, 3), nearest to the depth: 0 for none, k for the leaf k - 1.

    Args:
        penalty: (V, U), in tolerances, added to the distance.
        footprints: And noise_m more: the distance allowed.
        min_cosine: Distances along the ray count as often as the cosine to the normal, but not less than this.
    """

def classify_points(
    points_m: NDArray[np.float64], view: DepthView, *, footprints: float, noise_m: float, threads: int
) -> NDArray[np.uint8]:
    """States (P,) of points (P, 3): 0 unseen, 1 on the surface that is seen, 2 before it, 3 behind it."""

def count_labels(view: DepthView, labels: NDArray[np.int32], *, count: int) -> NDArray[np.int64]:
    """How many pixels with depth each label (H, W) from 1 to count has: (N,). No label may be above count."""

class PickedPixels:
    """Pixels picked evenly."""

    @property
    def pixels(self) -> NDArray[np.int64]:
        """(P,)."""
    @property
    def places(self) -> NDArray[np.int64]:
        """(P,), among the points of all leaves."""

def pick_pixels(
    view: DepthView,
    labels: NDArray[np.int32],
    *,
    total: NDArray[np.int64],
    kept: NDArray[np.int64],
    offsets: NDArray[np.int64],
    seen: NDArray[np.int64],
) -> PickedPixels:
    """Pixels with depth that are kept[k] of total[k] of a leaf over all views; seen (N,) is brought up to date."""

class SampleSettings:
    """How many points of a leaf are taken."""

    interior: int  # points of the interior, at most
    edge: int  # points of the edge, at most
    before_spread: int  # times as many are looked at as are wanted
    apart: float  # median distances to the fourth neighbour, beyond which a point lies apart

    def __init__(self, *, interior: int, edge: int, before_spread: int, apart: float) -> None: ...

class SampledPoints:
    """Points spread evenly over their leaves."""

    @property
    def index(self) -> NDArray[np.int64]:
        """(S,), among all points."""
    @property
    def apart(self) -> NDArray[np.uint8]:
        """(S,), 1 for those that lie apart."""
    @property
    def offsets(self) -> NDArray[np.int64]:
        """(N + 1,)."""

def sample_leaf_points(
    points_m: NDArray[np.float64],
    edge: NDArray[np.uint8],
    offsets: NDArray[np.int64],
    *,
    settings: SampleSettings,
    threads: int,
) -> SampledPoints:
    """Some of the points (P, 3) of leaves that begin at offsets (N + 1,); edge (P,) is 1 where a leaf ends."""

def project_points(
    points: NDArray[np.float64], intrinsics: NDArray[np.float64], cam_from_world: NDArray[np.float64], threads: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Places (N, 2) in pixels, NaN behind the camera, and depths (N,) of points (N, 3)."""

def unproject_places(
    places: NDArray[np.float64],
    depths: NDArray[np.float64],
    intrinsics: NDArray[np.float64],
    cam_from_world: NDArray[np.float64],
    threads: int,
) -> NDArray[np.float64]:
    """Points (N, 3) of the world from places (N, 2) in pixels and depths (N,)."""

class PatchMatchSettings:
    """How windows are compared, and how planes spread."""

    iterations: int  # each visits every pixel once
    best_sources: int  # photographs with the lowest cost that count at each pixel
    nearest_inverse: float  # largest inverse depth, in 1 / m
    farthest_inverse: float  # smallest inverse depth, in 1 / m, above 0
    color_scale: float  # of 765: sum of the differences of three channels that weighs 1 / e
    distance_scale_px: float  # distance from the window's middle that weighs 1 / e
    noise: float  # of 255: standard deviation of brightness below which a window has no texture
    brightness_weight: float  # cost of mean brightness that differs by brightness_scale or more
    brightness_scale: float  # of 255
    tint_weight: float  # cost of tint that differs by tint_scale or more
    tint_scale: float  # of 765
    geometric_weight: float  # cost of a pixel of disagreement with a depth map
    geometric_limit_px: float  # disagreement beyond it costs no more
    open_weight: float  # cost of every photograph that sees nothing where the plane is
    segment_weight: float  # cost of depth away from the plane of the pixel's segment, where the window has no texture
    segment_limit_px: float  # by so much movement in the photograph that moves most, or more
    segment_texture: float  # of 255: standard deviation of brightness that halves this cost
    step: float  # first change of inverse depth, as a share of its range
    max_slant: float  # tangent of the angle between line of sight and normal
    seed: int  # of the random planes

    def __init__(
        self,
        *,
        iterations: int,
        best_sources: int,
        nearest_inverse: float,
        farthest_inverse: float,
        color_scale: float,
        distance_scale_px: float,
        noise: float,
        brightness_weight: float,
        brightness_scale: float,
        tint_weight: float,
        tint_scale: float,
        geometric_weight: float,
        geometric_limit_px: float,
        open_weight: float,
        segment_weight: float,
        segment_limit_px: float,
        segment_texture: float,
        step: float,
        max_slant: float,
        seed: int,
    ) -> None: ...

class MatchReference:
    """The photograph that gets planes."""

    def __init__(
        self,
        *,
        srgb: NDArray[np.uint8],
        tint: NDArray[np.uint8],
        pixel_from_ray: NDArray[np.float64],
        mask: NDArray[np.uint8] | None = None,
        segment_planes: NDArray[np.float32] | None = None,
        proposals: NDArray[np.float32] | None = None,
    ) -> None:
        """Its arrays.

        Args:
            srgb: (H, W, 3).
            tint: (H, W, 3), its colours without noise.
            pixel_from_ray: (3, 3), of pixel indices.
            mask: (H, W), 0 where no plane is wanted.
            segment_planes: (H, W, 3), the plane of each pixel's segment, 0 for none.
            proposals: (layers, H, W, 3), planes that other photographs suggest.
        """

class MatchSource:
    """A photograph that it is matched with, of any size."""

    def __init__(
        self,
        *,
        gray: NDArray[np.uint8],
        tint: NDArray[np.uint8],
        warps: NDArray[np.float64],
        open: NDArray[np.uint8] | None = None,
        depth_m: NDArray[np.float32] | None = None,
    ) -> None:
        """Its arrays.

        Args:
            gray: (h, w), brightness.
            tint: (h, w, 3), its colours without noise.
            warps: (2, 3, 4), homography of the plane at infinity and epipole, to its pixel indices and back.
            open: (h, w), 1 where it sees nothing at all.
            depth_m: (h, w), 0 for none; of all sources or of none of them.
        """

class MatchedPlanes:
    """The plane of each pixel: the inverse depth there, and the change of it to the next pixel right and down."""

    @property
    def planes(self) -> NDArray[np.float32]:
        """(H, W, 3)."""
    @property
    def cost(self) -> NDArray[np.float32]:
        """(H, W)."""

def match_planes(
    reference: MatchReference,
    sources: list[MatchSource],
    start: NDArray[np.float32],
    *,
    offsets: NDArray[np.int32],
    settings: PatchMatchSettings,
    threads: int,
) -> MatchedPlanes:
    """Planes of a photograph by PatchMatch stereo.

    Args:
        reference: The photograph.
        sources: 1 to 16 that it is matched with.
        start: (H, W, 3), planes to start with; those of inverse depth 0 start at random.
        offsets: (at most 64, 2), right and down, of the window's pixels.
        settings: How windows are compared.
        threads: At most so many, 0 for one per core.
    """

class AgreementSettings:
    """When two depths agree."""

    agree_px: float  # between a pixel and where it comes back to
    agree_share: float  # between the two depths, of the depth

    def __init__(self, *, agree_px: float, agree_share: float) -> None: ...

class DepthSource:
    """Another depth map, of any size."""

    def __init__(
        self, *, depth_m: NDArray[np.float32], warps: NDArray[np.float64], open: NDArray[np.uint8] | None = None
    ) -> None:
        """Its arrays: depth (h, w), 0 for none; warps and open as those of a MatchSource."""

class AgreementCounts:
    """Other depth maps, by what they show where a pixel's depth is."""

    @property
    def agreeing(self) -> NDArray[np.uint8]:
        """(H, W), those whose depth agrees."""
    @property
    def through(self) -> NDArray[np.uint8]:
        """(H, W), those that see something behind, or nothing."""

def count_agreeing(
    depth_m: NDArray[np.float32], sources: list[DepthSource], *, settings: AgreementSettings, threads: int
) -> AgreementCounts:
    """Other depth maps that agree with each pixel's depth (H, W), and those that see through it."""

class FringeSettings:
    """When a pixel's colour is that of what lies behind."""

    fringe_px: int  # radius of the square in which colours are compared
    gap: float  # share of the depth by which other surfaces lie farther
    fringe_contrast: float  # of 765: difference of the mean colours, below which they are no evidence
    # share of the distance to the own surface's mean colour, within which a colour is the background's
    fringe_nearer: float

    def __init__(self, *, fringe_px: int, gap: float, fringe_contrast: float, fringe_nearer: float) -> None: ...

def find_fringe(
    depth_m: NDArray[np.float32], srgb: NDArray[np.uint8], *, settings: FringeSettings, threads: int
) -> NDArray[np.uint8]:
    """(H, W): 1 for pixels whose colour is that of what lies farther around them, or has no depth, else 0.

    Args:
        depth_m: (H, W), 0 where there is none.
        srgb: (H, W, 3).
        settings: When it is.
        threads: At most so many, 0 for one per core.
    """

class PlaneSource:
    """The planes of a photograph, of any size."""

    def __init__(
        self,
        *,
        planes: NDArray[np.float32],
        cost: NDArray[np.float32],
        warps: NDArray[np.float64],
        pixel_from_ray: NDArray[np.float64],
        turn: NDArray[np.float64],
    ) -> None:
        """Its arrays.

        Args:
            planes: (h, w, 3).
            cost: (h, w).
            warps: (2, 3, 4), to the other photograph's pixel indices and back.
            pixel_from_ray: (3, 3), of its pixel indices.
            turn: (3, 4), the other's camera axes from its own: rotation, and for planes n X = 1 the vector s with
                n' = R n / (1 + (R n) · s).
        """

def show_planes(
    sources: list[PlaneSource], *, pixel_from_ray: NDArray[np.float64], width: int, height: int, max_cost: float
) -> MatchedPlanes:
    """Planes (H, W, 3) of photographs as another one sees them, the best of those that meet; their cost (H, W).

    Args:
        sources: The photographs.
        pixel_from_ray: (3, 3), of the other one's pixel indices.
        width: Of the other one, in pixels.
        height: Of the other one, in pixels.
        max_cost: Planes that cost more are left out.
    """

def find_fork_crossings(
    points_m: NDArray[np.float64],
    faces: NDArray[np.int64],
    *,
    fork_faces: NDArray[np.int64],
    fork_first: NDArray[np.int64],
    threads: int,
) -> NDArray[np.int64]:
    """Places (N, 2) in fork_faces whose quads cross, each pair of faces once, the lower place first.

    Args:
        points_m: (P, 3).
        faces: (F, 4).
        fork_faces: (K,) faces near each fork, one fork after another.
        fork_first: (J + 1,) where each fork's begin.
        threads: At most so many, 0 for one per core.
    """

class LimitAims:
    """Where the limits of V vertices are to be."""

    def __init__(
        self,
        *,
        aims_m: NDArray[np.float64],
        tangents: NDArray[np.float64],
        swell: NDArray[np.float64],
        center_m: NDArray[np.float64],
        gain: NDArray[np.float64],
    ) -> None:
        """Their arrays.

        Args:
            aims_m: (V, 3).
            tangents: (V, 3), unit vector along which a vertex is not moved; 0 for none.
            swell: (V, 2), growth of the radius per length along the tangent, ahead and behind.
            center_m: (V, 3), the place of the axis that an aim belongs to.
            gain: (V,), share of what is missing that a vertex is moved by.
        """

def pull_limit(
    faces: NDArray[np.int64], aims: LimitAims, *, rounds: int, farthest: float, threads: int
) -> NDArray[np.float64]:
    """Vertices (V, 3) of a closed mesh of quads (F, 4) whose Catmull-Clark limits are at their aims, nearly.

    Args:
        rounds: How often the vertices are moved.
        farthest: Of an aim's distance from its center: no vertex is moved by more.
    """

class HoleTubes:
    """T tubes, parents before children."""

    def __init__(
        self,
        *,
        start_m: NDArray[np.float64],
        end_m: NDArray[np.float64],
        length_m: NDArray[np.float64],
        phase_rad: NDArray[np.float64],
        steep_m: NDArray[np.float64],
        steep_first: NDArray[np.int64],
        gone: NDArray[np.uint8],
    ) -> None:
        """Their arrays.

        Args:
            start_m: (T,), arc from where a tube has rings.
            end_m: (T,), arc up to which it may have holes.
            length_m: (T,).
            phase_rad: (T,), where the first column is to begin; NaN for anywhere.
            steep_m: (S, 2), arcs from and to: stretches without room, in order and apart.
            steep_first: (T + 1,), where those of each tube begin.
            gone: (T,), 1 for tubes without a surface.
        """

class HoleWants:
    """W holes that look for a place, by parent; the first of a parent move least."""

    def __init__(
        self,
        *,
        tube: NDArray[np.int64],
        first: NDArray[np.int64],
        arc_m: NDArray[np.float64],
        azimuth_rad: NDArray[np.float64],
        half_rad: NDArray[np.float64],
        tight_rad: NDArray[np.float64],
        end_half_rad: NDArray[np.float64],
        half_block_m: NDArray[np.float64],
        half_along_m: NDArray[np.float64],
        half_across_m: NDArray[np.float64],
        parent_radius_m: NDArray[np.float64],
    ) -> None:
        """Their arrays.

        Args:
            tube: (W,), the tube of each.
            first: (T + 1,), where those of each parent begin.
            arc_m: (W,), on the parent.
            azimuth_rad: (W,), about the parent.
            half_rad: (W,), half of its sector, at the middle ring of its block.
            tight_rad: (W,), the same where neighbours are close.
            end_half_rad: (W,), the same at the two other rings.
            half_block_m: (W,), half of its block, along the parent.
            half_along_m: (W,), half of the hole, along the parent.
            half_across_m: (W,), half of the hole, across.
            parent_radius_m: (W,).
        """

class HoleSettings:
    """How close holes may be."""

    tightest: float  # share of its length that a hole may be pressed to
    relaxed: float  # parent radii behind a block, in which columns go back to even ones
    min_column_rad: float  # between neighbouring columns

    def __init__(self, *, tightest: float, relaxed: float, min_column_rad: float) -> None: ...

class HolePlaces:
    """K blocks of rows, H holes in them, A angles of columns."""

    @property
    def block_tube(self) -> NDArray[np.int64]:
        """(K,)."""
    @property
    def block_arcs_m(self) -> NDArray[np.float64]:
        """(K, 3), of the three rings."""
    @property
    def want(self) -> NDArray[np.int64]:
        """(H,), whose place each is."""
    @property
    def block(self) -> NDArray[np.int64]:
        """(H,)."""
    @property
    def sector(self) -> NDArray[np.int64]:
        """(H,)."""
    @property
    def arc_m(self) -> NDArray[np.float64]:
        """(H,), middle on the parent."""
    @property
    def azimuth_rad(self) -> NDArray[np.float64]:
        """(H,), on the same turn as the columns of its block."""
    @property
    def half_along_m(self) -> NDArray[np.float64]:
        """(H,)."""
    @property
    def half_across_m(self) -> NDArray[np.float64]:
        """(H,)."""
    @property
    def turn_tube(self) -> NDArray[np.int64]:
        """(A,)."""
    @property
    def turn_arc_m(self) -> NDArray[np.float64]:
        """(A,)."""
    @property
    def turn_angles_rad(self) -> NDArray[np.float64]:
        """(A, 6)."""
    @property
    def homeless(self) -> NDArray[np.int64]:
        """(D,), wants without a place."""

def place_holes(tubes: HoleTubes, wants: HoleWants, *, settings: HoleSettings) -> HolePlaces:
    """Find a place for every want."""

class TubeAxes:
    """The axes of T tubes, one after another."""

    def __init__(
        self,
        *,
        points_m: NDArray[np.float64],
        radius_m: NDArray[np.float64],
        arc_m: NDArray[np.float64],
        direction: NDArray[np.float64],
        first: NDArray[np.int64],
        counts: NDArray[np.int64],
    ) -> None:
        """Their arrays.

        Args:
            points_m: (V, 3).
            radius_m: (V,).
            arc_m: (V,), from the start of the tube.
            direction: (V, 3), unit, of the segment that starts there.
            first: (T,), first point of each tube.
            counts: (T,), points of each tube, at least 2.
        """

class ExitWalks:
    """C tubes that walk on until they are outside their parents."""

    def __init__(
        self,
        *,
        tube: NDArray[np.int64],
        parent: NDArray[np.int64],
        clearance: NDArray[np.float64],
        at: NDArray[np.int64],
        start_m: NDArray[np.float64],
    ) -> None:
        """Their arrays.

        Args:
            tube: (C,).
            parent: (C,).
            clearance: (C,), of its radius, by how much a disc is to be clear.
            at: (C,), the parent's segment next to the walk.
            start_m: (C,), arc to walk on from.
        """

class ExitWalkSettings:
    """When a tube is outside its parent."""

    whole_disc: bool  # whether the whole disc is to be outside, or the axis alone
    cage_factor: float  # how much farther from its axis a cage is than its limit
    thickest: float  # of its parent's radius, a branch where it leaves
    skin: float  # radii that do not matter
    max_steps: int  # of a walk

    def __init__(
        self, *, whole_disc: bool, cage_factor: float, thickest: float, skin: float, max_steps: int
    ) -> None: ...

class TubeExits:
    """Where tubes are outside their parents."""

    @property
    def arc_m(self) -> NDArray[np.float64]:
        """(C,), at most at the tip."""
    @property
    def done(self) -> NDArray[np.uint8]:
        """(C,), 1 where they are outside."""
    @property
    def at(self) -> NDArray[np.int64]:
        """(C,), segments of the parents there."""

def walk_out(axes: TubeAxes, walks: ExitWalks, *, settings: ExitWalkSettings, threads: int) -> TubeExits:
    """Arcs at which tubes are outside their parents."""

class TubePlaces:
    """N places on axes."""

    @property
    def points_m(self) -> NDArray[np.float64]:
        """(N, 3)."""
    @property
    def radius_m(self) -> NDArray[np.float64]:
        """(N,)."""

def tube_axis(axes: TubeAxes, tube: NDArray[np.int64], arc_m: NDArray[np.float64], *, threads: int) -> TubePlaces:
    """Points and radii at arcs (N,) of tubes (N,), those of the ends beyond them."""

def tube_tangents(
    axes: TubeAxes,
    tube: NDArray[np.int64],
    arc_m: NDArray[np.float64],
    *,
    reach_m: NDArray[np.float64],
    threads: int,
) -> NDArray[np.float64]:
    """Unit chords (N, 3) over the axes from reach (N,) before arcs (N,) of tubes (N,) to reach after them."""

class TubeFrames:
    """Two unit vectors, right-handed with a tangent."""

    @property
    def first(self) -> NDArray[np.float64]:
        """(N, 3)."""
    @property
    def second(self) -> NDArray[np.float64]:
        """(N, 3)."""

def tube_frames(
    axes: TubeAxes,
    tube: NDArray[np.int64],
    arc_m: NDArray[np.float64],
    *,
    tangents: NDArray[np.float64],
    reference: NDArray[np.float64],
    threads: int,
) -> TubeFrames:
    """Two unit vectors each, right-handed with the tangents (N, 3) at arcs (N,) of tubes (N,).

    Args:
        reference: (V, 3), unit normals that are carried along the tubes.
    """

class NearestPlaces:
    """N places of tubes next to points."""

    @property
    def points_m(self) -> NDArray[np.float64]:
        """(N, 3)."""
    @property
    def arc_m(self) -> NDArray[np.float64]:
        """(N,)."""
    @property
    def radius_m(self) -> NDArray[np.float64]:
        """(N,)."""
    @property
    def at(self) -> NDArray[np.int64]:
        """(N,), the segments."""

def tube_nearest(
    axes: TubeAxes,
    tube: NDArray[np.int64],
    at: NDArray[np.int64],
    *,
    places_m: NDArray[np.float64],
    max_steps: int,
    threads: int,
) -> NearestPlaces:
    """Places of tubes (N,) next to places (N, 3), from the segments (N,) where they were."""

class RingGaps:
    """G stretches between two rings that are given."""

    def __init__(
        self,
        *,
        tube: NDArray[np.int64],
        low_m: NDArray[np.float64],
        length_m: NDArray[np.float64],
        below_m: NDArray[np.float64],
        above_m: NDArray[np.float64],
    ) -> None:
        """Their arrays.

        Args:
            tube: (G,).
            low_m: (G,), arc at which it begins.
            length_m: (G,).
            below_m: (G,), spacing that is asked for at its beginning.
            above_m: (G,), and at its end.
        """

class RingSpacingSettings:
    """How far rings are apart."""

    tolerance: float  # of its radius, by how much a tube may leave its axis
    longest: float  # spacing, in radii
    growth: float  # of the spacing, per length away from the ends of a gap
    steady: float  # spacing in radii on segments that are long
    long_segment: float  # radii: its corners have rings of their own
    max_reach_m: float  # over which bends are measured
    min_samples: int  # of the spacing in a gap
    max_samples: int  # of the spacing in a gap

    def __init__(
        self,
        *,
        tolerance: float,
        longest: float,
        growth: float,
        steady: float,
        long_segment: float,
        max_reach_m: float,
        min_samples: int,
        max_samples: int,
    ) -> None: ...

class AddedRings:
    """R rings in gaps."""

    @property
    def gap(self) -> NDArray[np.int64]:
        """(R,)."""
    @property
    def arc_m(self) -> NDArray[np.float64]:
        """(R,)."""

def fill_gaps(
    axes: TubeAxes,
    gaps: RingGaps,
    *,
    turned_rad: NDArray[np.float64],
    settings: RingSpacingSettings,
    threads: int,
) -> AddedRings:
    """Rings in gaps, so many as bends ask for.

    Args:
        turned_rad: (V,), by how much a tube has turned up to each point.
    """

class RingCircles:
    """N rings of six; those of one tube follow one another."""

    def __init__(
        self,
        *,
        tube: NDArray[np.int64],
        center_m: NDArray[np.float64],
        tangent: NDArray[np.float64],
        first: NDArray[np.float64],
        second: NDArray[np.float64],
        angles_rad: NDArray[np.float64],
        radius_m: NDArray[np.float64],
    ) -> None:
        """Their arrays.

        Args:
            tube: (N,).
            center_m: (N, 3).
            tangent: (N, 3), unit.
            first: (N, 3), unit, with the second right-handed with the tangent.
            second: (N, 3), unit.
            angles_rad: (N, 6).
            radius_m: (N,).
        """

class RoundRings:
    """N rings of six points."""

    @property
    def points_m(self) -> NDArray[np.float64]:
        """(N, 6, 3)."""
    @property
    def radius_m(self) -> NDArray[np.float64]:
        """(N,), less where neighbouring rings would cross."""

def round_rings(rings: RingCircles, *, at_vertices: float, threads: int) -> RoundRings:
    """The points of rings, at_vertices times as far out as the radius."""

class StartBendSettings:
    """How the start of an axis is moved."""

    kept_m: float  # arc up to which all is moved by the same step
    fade_m: float  # length over which that fades
    samples: int  # stretches that the fading is cut into
    min_apart: float  # of fade_m, between added points and those that are there

    def __init__(self, *, kept_m: float, fade_m: float, samples: int, min_apart: float) -> None: ...

class BentAxis:
    """An axis of N points whose start is moved."""

    @property
    def old_arc_m(self) -> NDArray[np.float64]:
        """(N,), before."""
    @property
    def points_m(self) -> NDArray[np.float64]:
        """(N, 3), now."""
    @property
    def radius_m(self) -> NDArray[np.float64]:
        """(N,)."""
    @property
    def moved_m(self) -> NDArray[np.float64]:
        """(N, 3), by how much."""
    @property
    def new_arc_m(self) -> NDArray[np.float64]:
        """(N,), now."""

def bend_start(
    points_m: NDArray[np.float64],
    radius_m: NDArray[np.float64],
    *,
    step_m: NDArray[np.float64],
    settings: StartBendSettings,
) -> BentAxis:
    """An axis of points (n, 3) and radii (n,) whose start is moved by a step (3,)."""

def carry_references(
    direction: NDArray[np.float64],
    first: NDArray[np.int64],
    counts: NDArray[np.int64],
    *,
    reference: NDArray[np.float64],
    threads: int,
) -> None:
    """Fill reference (V, 3): unit normals carried along tubes, given at the first point of each."""

def bridge_pieces(points: NDArray[np.float64], piece_of: NDArray[np.int32], pieces: int) -> NDArray[np.int64]:
    """Ends (pieces - 1, 2) of the shortest links that join all pieces; points (N, 3), piece_of (N,)."""

def piece_gaps(
    points: NDArray[np.float64],
    corners: NDArray[np.int32],
    piece: NDArray[np.int32],
    *,
    asked_edges: NDArray[np.int32],
    asked_first: NDArray[np.int64],
    asked_pieces: NDArray[np.int32],
    near_enough: float,
    through: bool,
    threads: int,
) -> NDArray[np.float64]:
    """Distance (Q,) of each asked piece of a mesh of triangles to all others, 0 where it runs into one."""

def nearest_on_lines(
    points: NDArray[np.float64],
    first: NDArray[np.int32],
    counts: NDArray[np.int32],
    *,
    places: NDArray[np.float64],
    line: NDArray[np.int32],
    threads: int,
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Segments (N,) and shares of them (N,) where polylines (N,) are nearest to places (N, 3)."""

def beyond_lines(
    points: NDArray[np.float64],
    first: NDArray[np.int32],
    counts: NDArray[np.int32],
    *,
    places: NDArray[np.float64],
    line: NDArray[np.int32],
    radius: NDArray[np.float64],
    threads: int,
) -> NDArray[np.float64]:
    """How far places (N, 3) are outside polylines (N,) with radii at their points."""

def merge_regions(
    count: int,
    first: NDArray[np.int64],
    second: NDArray[np.int64],
    weight: NDArray[np.float64],
    divisor: NDArray[np.float64],
    weakest: float,
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]:
    """Joins of points to regions: children (J, 2), linkage, across and size (J,), where rounds begin (R + 1,).

    Links (E,) are in the order of their lower and higher points; divisor (count + 1,) is of the smaller region's size.
    """

def deform_lobed_leaves(
    nodes: NDArray[np.float64],
    *,
    parents: NDArray[np.int32],
    branches: NDArray[np.int32],
    spans: NDArray[np.float64],
    tie_nodes: NDArray[np.int32],
    feet: NDArray[np.float64],
    key_first: NDArray[np.int64],
    key_counts: NDArray[np.int32],
    keys: NDArray[np.float64],
    points: NDArray[np.float64],
    threads: int,
) -> None:
    """Leaves of one flat shape of N nodes and T ties, each deformed by its functions, into points (M, N + T, 3).

    Keys of turn, bend and twist: key_first and key_counts are (M, 3, B), for leaves, functions and branches.
    """

def crown_facts(
    channels: NDArray[np.float32], places: NDArray[np.int32], offsets: NDArray[np.int32], *, threads: int
) -> NDArray[np.float32]:
    """What is known (N, K) of places in a picture from above.

    Args:
        channels: (C, H, W) of an orthophoto light, red, blue and how rough it is; or of a canopy metres.
        places: (N,) pixels of a channel, row by row.
        offsets: (7, 12) from a place to those of the rings around it, which must lie in the picture.
    """

def crown_answers(
    channels: NDArray[np.float32],
    places: NDArray[np.int32],
    offsets: NDArray[np.int32],
    *,
    middle: NDArray[np.float32],
    spread: NDArray[np.float32],
    layers: Sequence[tuple[NDArray[np.float32], NDArray[np.float32]]],
    threads: int,
) -> NDArray[np.float32]:
    """A network's answers (N,) to the facts of places, 0 to 1; the first arguments are those of crown_facts.

    Args:
        middle: (K,) of each fact.
        spread: (K,) likewise, above 0.
        layers: Matrix (inputs, outputs) and offset (outputs,) of each, at most 128 wide; the last one has one output.
    """

def choose_crowns(
    places: NDArray[np.float64], radii: NDArray[np.float64], order: NDArray[np.int32], *, apart: float
) -> NDArray[np.int32]:
    """Numbers of crowns that are taken one after another, but none within another one that was taken.

    Args:
        places: (N, 2).
        radii: (N,) above 0.
        order: (N,) the best first.
        apart: Of the sum of two radii, within which only one is taken.
    """
