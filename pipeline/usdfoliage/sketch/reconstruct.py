"""From a photograph and the strokes over one tree to its skeleton in metres: the one page of this package."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.foliage.species import Species
from usdfoliage.branch.model import Skeleton
from usdfoliage.errors import FitError
from usdfoliage.progress import Progress
from usdfoliage.remarks import Setting
from usdfoliage.sketch.axes import skeleton_of
from usdfoliage.sketch.bounds import CrownBounds, bound_crown
from usdfoliage.sketch.foliage import Foliage, FoliageCutSettings, find_foliage
from usdfoliage.sketch.foliage_evidence import FoliageEvidence, measure_evidence
from usdfoliage.sketch.growth import GrownAxes, SketchGrowthSettings, Watch, grow_axes
from usdfoliage.sketch.into_space import TurningSettings, turn_into_space
from usdfoliage.sketch.strokes import TreeStrokes
from usdfoliage.sketch.subtrees import build_library
from usdfoliage.sketch.thickness import find_radii
from usdfoliage.sketch.tracing import TracedTree, TraceSettings, branch_odds, trace_tree

Floats = NDArray[np.float64]

_TIP = 0.0004  # of the tree's height: radius of a shoot at its tip
_STEM = 0.011  # of the tree's height: radius of a stem that the picture does not show
_STEM_ABOVE = 0.05  # of the crown's height from below, into which a stem goes that nobody drew


@dataclass(frozen=True, kw_only=True)
class SketchSettings:
    """How a tree is made of a photograph."""

    height_m: float = 5.0  # from the root to the top
    metres_per_px: float | None = None  # in place of the height
    depth: float = 1.0  # times as deep as the silhouette has it
    seed: int = 0
    require_foliage: bool = True  # refuse what is foliage by no measure
    foliage: FoliageCutSettings = field(default_factory=FoliageCutSettings)
    trace: TraceSettings = field(default_factory=TraceSettings)
    turning: TurningSettings = field(default_factory=TurningSettings)
    growth: SketchGrowthSettings = field(default_factory=SketchGrowthSettings)

    def __post_init__(self) -> None:
        if not (np.isfinite(self.height_m) and self.height_m > 0):
            raise ValueError(f"height must be above 0, not {self.height_m:g}")
        scale = self.metres_per_px
        if scale is not None and not (np.isfinite(scale) and scale > 0):
            raise ValueError(f"a pixel must be above 0 metres, not {scale:g}")
        if not 0.1 <= self.depth <= 5:
            raise ValueError(f"depth must be 0.1 to 5, not {self.depth:g}")
        if not 0 <= self.seed < 2**31:
            raise ValueError(f"the seed must be 0 to below 2^31, not {self.seed}")


@dataclass(frozen=True, kw_only=True, eq=False)
class SketchedTree:
    """A tree of a photograph."""

    skeleton: Skeleton
    foliage: Foliage
    evidence: FoliageEvidence  # that it is foliage
    traced: TracedTree
    bounds: CrownBounds
    grown: GrownAxes
    height_m: float  # from the root to the top
    asset_from_photo: Floats  # (4, 4) for column vectors: from (x, y, z) in pixels to metres


def sketch_tree(
    srgb: NDArray[np.uint8],
    strokes: TreeStrokes,
    species: Species,
    settings: SketchSettings = SketchSettings(),
    report: Progress | None = None,
    watch: Watch | None = None,
    leaf_pixels: Foliage | None = None,
) -> SketchedTree:
    """Make a tree of a photograph.

    Args:
        srgb: (H, W, 3), the photograph, display-encoded.
        strokes: Over one tree.
        species: How it branches.
        settings: How.
        report: Called while the tree grows, as grow_axes does.
        watch: Likewise.
        leaf_pixels: What foliage_of_strokes finds with the first of mixture_seeds, where it is known already.

    Raises:
        FitError: The strokes hold no leaves, or what is foliage by no measure.
    """
    rng = np.random.default_rng(settings.seed)
    seeds = [int(each) for each in rng.integers(2**31 - 2, size=2)]
    foliage = leaf_pixels or foliage_of_strokes(srgb, strokes, seeds[0], settings.foliage)
    bounds = bound_crown(foliage.mask, settings.depth, foliage.inside if foliage.is_bare else None)
    evidence = measure_evidence(srgb, foliage.mask, foliage.before_sky, is_thin=foliage.is_thin)
    if settings.require_foliage and evidence.is_none:
        raise FitError(
            f"the crown's stroke holds no foliage: what is in it is like a wall, a road or water ({evidence})",
            (
                "draw it around the leaves of the tree; if they are leaves, give ",
                Setting(name="sketch.leaves", value='"on"'),
            ),
        )
    if not strokes.branches_px:
        strokes = TreeStrokes(crown_px=strokes.crown_px, branches_px=(_stem_below(bounds),))
    traced = trace_tree(branch_odds(srgb, strokes, foliage, seeds[1], settings.trace), strokes, settings.trace)
    axes = turn_into_space(traced, bounds, settings.turning)
    grown = grow_axes(axes, build_library(axes, species), bounds, rng, settings.growth, report, watch)
    root = grown.axes[0].points[0]
    lowest = min(root[1], min(float(axis.points[0, 1]) for axis in grown.axes if axis.parent < 0))
    top = max(float(np.max(-np.nonzero(bounds.inside.any(axis=1))[0])), lowest + 1.0)
    scale_m = settings.metres_per_px or settings.height_m / (top - lowest)
    radius = find_radii(grown.axes, species.exponent, _TIP * (top - lowest), _STEM * (top - lowest))
    return SketchedTree(
        skeleton=skeleton_of(grown.axes, radius, scale_m, root),
        foliage=foliage,
        evidence=evidence,
        traced=traced,
        bounds=bounds,
        grown=grown,
        height_m=scale_m * (top - lowest),
        asset_from_photo=_frame(root, scale_m),
    )


def trace_strokes(
    srgb: NDArray[np.uint8], strokes: TreeStrokes, foliage: Foliage, settings: SketchSettings = SketchSettings()
) -> TracedTree:
    """The branches that sketch_tree traces, from what foliage_of_strokes found; at least one stroke is of a branch."""
    odds = branch_odds(srgb, strokes, foliage, mixture_seeds(settings)[1], settings.trace)
    return trace_tree(odds, strokes, settings.trace)


def foliage_of_strokes(
    srgb: NDArray[np.uint8],
    strokes: TreeStrokes,
    seed: int,
    settings: FoliageCutSettings = FoliageCutSettings(),
) -> Foliage:
    """The leaves inside of the crown's stroke; FitError where there is nothing."""
    try:
        return find_foliage(srgb, strokes.crown_px, seed, settings, strokes.branches_px)
    except ValueError as error:
        raise FitError("the crown's stroke holds nothing of the picture", "draw it around the leaves") from error


def mixture_seeds(settings: SketchSettings) -> tuple[int, int]:
    """Of the mixtures of colours, of leaves and of branches, as sketch_tree draws them first."""
    first, second = np.random.default_rng(settings.seed).integers(2**31 - 2, size=2)
    return int(first), int(second)


def _stem_below(bounds: CrownBounds) -> Floats:
    """A stem that nobody drew: from the crown's lowest place up through its middle."""
    rows, columns = np.nonzero(bounds.inside)
    low, high = float(rows.max() + 1), float(rows.min())
    near = columns[rows > low - _STEM_ABOVE * (low - high) - 1]
    foot = float(np.median(near)) + 0.5
    return np.array([[foot, low], [float(np.median(columns)) + 0.5, 0.5 * (low + high)]])


def _frame(root: Floats, scale_m: float) -> Floats:
    """(4, 4) from (x, y, z) in pixels, y down, z to the viewer, to metres about the root."""
    frame = np.diag([scale_m, -scale_m, scale_m, 1.0])
    frame[:3, 3] = -scale_m * root
    return frame
