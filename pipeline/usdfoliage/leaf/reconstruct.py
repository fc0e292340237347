"""The main job on posed photographs with depth: views in, leaves with colours and an average texture out."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.view import View
from usdfoliage.leaf.fit.alternating import AlternatingFitSettings, fit_leaves_alternating
from usdfoliage.leaf.fit.flip import flip_leaves
from usdfoliage.leaf.fit.model import FittedLeaves
from usdfoliage.leaf.fit.silhouette_order import order_silhouettes
from usdfoliage.leaf.fit.surface import SurfaceFitSettings, fit_leaves_to_surface, rate_form
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.photographs.average_texture import AverageTexture, AverageTextureSettings, average_leaf_texture
from usdfoliage.leaf.photographs.base_and_apex import DirectionSettings, distinguish_base_from_apex
from usdfoliage.leaf.photographs.colors import PhotoColorSettings, sample_leaf_colors
from usdfoliage.leaf.photographs.lost_surroundings import lower_confidence
from usdfoliage.leaf.segmentation.dense.segment import segment_dense
from usdfoliage.leaf.segmentation.dense.settings import DenseSegmentationSettings
from usdfoliage.leaf.segmentation.model import Segmentation, Step, find_nothing, nonzero
from usdfoliage.leaf.segmentation.paper.segment import PaperSegmentationSettings, segment_paper
from usdfoliage.leaf.shape.measures import leaf_width
from usdfoliage.progress import StepProgress, follow_step
from usdfoliage.remarks import Remark, Setting, remark

METHODS = ("dense", "paper")
STEPS = ("segmentation", "fit", "direction", "colours", "texture")

FEW_RIGHT = 0.5  # share of the leaves that are right, below which most of them are guessed
SMALL_PX = 40.0  # median leaf length, below which estimated depth loses many leaves: of a tree's of 28 px 84 of 100
ROUND = 0.75  # width by length from which the longest extent of a leaf is no sure sign of its axis
# Shares of its edge on the silhouette: below the second most leaves of a set are not of one lobe, at the first surely.
# Depth of photographs is coarse where leaves end: the medians of leaves of one lobe are then 0.55 to 0.75.
LOBED = (0.3, 0.5)
EXPOSED = 1.6  # times as bright a photograph is as another one, from which depth is lost
SINGLE_LOBED = (0.1, 1.4)  # width by length of leaves that one axis and one silhouette describe


@dataclass(frozen=True, kw_only=True)
class ReconstructionSettings:
    """Everything that decides which leaves are found and what they become."""

    # dense finds leaves with the project's method; paper runs the published one for comparison.
    method: Literal["dense", "paper"] = "dense"
    # The asset has the fitted leaves of at least this confidence. Range: 0 to 1.
    min_confidence: float = 0.0
    # The method dense leaves out leaves that are not green where at most this share of the leaves is not, as pieces of
    # soil and dead leaves; where more are not green, the plant has such leaves. 0 keeps all. Range: 0 to 1.
    max_not_green: float = 0.1
    threads: int = 0  # At most this many threads work; 0 is one per core. The result is the same. Range: 0 or more.
    dense: DenseSegmentationSettings = field(default_factory=DenseSegmentationSettings)
    dense_fit: SurfaceFitSettings = field(default_factory=SurfaceFitSettings)
    paper: PaperSegmentationSettings = field(default_factory=PaperSegmentationSettings)
    paper_fit: AlternatingFitSettings = field(default_factory=AlternatingFitSettings)
    direction: DirectionSettings = field(default_factory=DirectionSettings)
    colors: PhotoColorSettings = field(default_factory=PhotoColorSettings)
    texture: AverageTextureSettings = field(default_factory=AverageTextureSettings)

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise ValueError(f"method must be one of {', '.join(METHODS)}, not {self.method}")
        for name in ("min_confidence", "max_not_green"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} must be from 0 to 1, not {getattr(self, name)}")
        if self.threads < 0:
            raise ValueError(f"threads must be 0, for all cores, or more, not {self.threads}")


@dataclass(frozen=True, kw_only=True, eq=False)
class Reconstruction:
    """The leaves of a scene, and how they were found."""

    leaves: Leaves  # N, in the world of the views, with color, confidence, residual_m and view
    source: NDArray[np.int64]  # (N,), the number of each in segmentation.leaves
    certainty: NDArray[np.float64]  # (N,), that its base is not its apex: 0.5 nothing is known to 1
    segmentation: Segmentation
    texture: AverageTexture | None  # None without leaves
    steps: Sequence[Step]
    remarks: Sequence[Remark]  # what whoever uses the leaves should know
    seconds: Mapping[str, float]  # by step


def reconstruct_leaves(
    views: Sequence[View],
    settings: ReconstructionSettings = ReconstructionSettings(),
    progress: StepProgress | None = None,
) -> Reconstruction:
    """Find single leaves in posed photographs with depth and fit the 21 parameters of each.

    That there are none is a result: a reconstruction of no leaves.

    Args:
        views: Of one world; those without depth add colours only.
        settings: How.
        progress: Called at each step.

    Raises:
        ValueError: There are no views.

    Source:
        Chaurasia and Beardsley, Editable Parametric Dense Foliage from 3D Capture, sections 4 and 5, for the method
        paper; the method dense is our own.
    """
    if not views:
        raise ValueError("there are no views to find leaves in")
    seconds: dict[str, float] = {}
    step = partial(follow_step, seconds=seconds, progress=progress)

    with step("segmentation") as report:
        if not any(view.has_depth for view in views):
            segmentation = find_nothing(views)
        elif settings.method == "paper":
            segmentation = segment_paper(views, settings.paper, report)
        else:
            segmentation = segment_dense(views, settings.dense, report, threads=settings.threads)
    with step("fit") as report:
        if settings.method == "paper":
            fitted = fit_leaves_alternating(segmentation.leaves, settings.paper_fit, threads=settings.threads)
        else:
            fitted = fit_leaves_to_surface(
                segmentation.leaves, settings.dense_fit, threads=settings.threads, progress=report
            )
    with step("direction"):
        direction = distinguish_base_from_apex(fitted.leaves, views, settings.direction, threads=settings.threads)
        leaves = order_silhouettes(flip_leaves(fitted.leaves, direction.flip))
        moved = np.zeros(len(leaves), bool)
        if settings.method == "dense" and len(leaves):
            # Of the proposal that was chosen: measures of the fit alone distinguish right leaves from wrong ones less.
            proposed = segmentation.leaves.confidence[fitted.source]
            probability = lower_confidence(leaves, proposed, views, threads=settings.threads)
            moved = (probability < proposed) & (probability < settings.dense.min_confidence)
            leaves = replace(
                leaves, confidence=probability * rate_forms(leaves.parameters, fitted.outlined, settings.dense_fit)
            )
    sound, dropped = choose_sound(leaves, settings.min_confidence)
    dropped |= nonzero({"rough amid lost depth, as of a leaf that moved": int(np.count_nonzero(sound & moved))})
    sound &= ~moved
    kept = np.flatnonzero(sound)
    leaves = leaves.take(kept)
    with step("colours"):
        colors = sample_leaf_colors(leaves, views, settings.colors)
        leaves = replace(leaves, color=colors.color)
    not_green = 0
    if settings.method == "dense" and leaves.color is not None:
        green = find_green_leaves(leaves.color, settings.max_not_green)
        not_green = int(np.count_nonzero(~green))
        if not_green:
            dropped = {**dropped, "of another colour than all others": not_green}
            leaves, kept = leaves.take(green), kept[green]
    with step("texture"):
        texture = (
            average_leaf_texture(leaves, views, settings.texture, threads=settings.threads) if len(leaves) else None
        )
    return Reconstruction(
        leaves=leaves,
        source=fitted.source[kept],
        certainty=direction.certainty[kept],
        segmentation=segmentation,
        texture=texture,
        steps=_count_steps(segmentation, fitted, leaves, dropped),
        remarks=describe_leaves(
            leaves,
            views,
            segmentation,
            outlined=None if fitted.outlined is None else fitted.outlined[kept],
            gain=colors.gain,
            not_green=not_green,
        ),
        seconds=seconds,
    )


def find_green_leaves(color: NDArray[np.float64], max_not_green: float) -> NDArray[np.bool_]:
    """(N,) leaves to be kept by their colours (N, 3), linear: all but a few that are not green among green ones.

    Bits of soil and dead leaves on it are as wide and as flat as leaves are. Where more than the share max_not_green is
    not green, the plant has such leaves.
    """
    green = 2 * color[:, 1] > color[:, 0] + color[:, 2]
    return green if np.count_nonzero(~green) <= max_not_green * len(green) else np.ones(len(green), bool)


def rate_forms(
    parameters: NDArray[np.float64], outlined: NDArray[np.float64] | None, settings: SurfaceFitSettings
) -> NDArray[np.float64]:
    """(N,), 0 to 1: whether leaves (N, 7, 3) of one set are of one lobe, and no blades of grass.

    Args:
        outlined: (N,), the share of each leaf's edge that lies on its silhouette; None where that is not known.
        settings: From which width on a leaf is no blade.
    """
    if outlined is not None and len(outlined):
        outlined = np.full(len(outlined), np.median(outlined))
    return rate_form(parameters, outlined, replace(settings, lobed=LOBED))


def choose_sound(leaves: Leaves, min_confidence: float) -> tuple[NDArray[np.bool_], dict[str, int]]:
    """Which leaves (N,) an asset takes, and how many it does not, by reason: the first that holds of a leaf."""
    finite = np.isfinite(leaves.parameters).all(axis=(1, 2)) & np.isfinite(leaves.length_m) & (leaves.length_m > 0)
    feet = np.asarray(leaves.parameters[:, 2:5, 0], np.float32)  # as they are stored
    feet = np.concatenate([np.zeros((len(leaves), 1)), feet, np.ones((len(leaves), 1))], axis=1)
    sound, dropped = np.ones(len(leaves), np.bool_), {}
    checks = {
        "with numbers that are none": finite,
        "whose silhouette's points are not in order": (np.diff(feet, axis=1) > 0).all(axis=1),
    }
    if leaves.confidence is not None:
        checks[f"of less confidence than {min_confidence:g}"] = leaves.confidence >= min_confidence
    for reason, good in checks.items():
        dropped[reason] = int(np.count_nonzero(sound & ~good))
        sound &= good
    return sound, nonzero(dropped)


def _count_steps(
    segmentation: Segmentation, fitted: FittedLeaves, leaves: Leaves, dropped: Mapping[str, int]
) -> list[Step]:
    superpixels = [
        len(np.unique(view.superpixels[view.superpixels >= 0]))
        for view in segmentation.candidates
        if view.superpixels is not None
    ]
    steps = [Step(name="superpixels", count=sum(superpixels))] if superpixels else []
    candidates = sum(len(view.confidence) for view in segmentation.candidates)
    return [
        *steps,
        Step(name="candidates in single views", count=candidates),
        *segmentation.passes,
        Step(name="leaves of the scene", count=len(segmentation.leaves), dropped=nonzero(segmentation.dropped)),
        Step(name="fitted leaves", count=len(fitted.leaves), dropped=nonzero(fitted.dropped)),
        Step(name="kept leaves", count=len(leaves), dropped=dropped),
    ]


def describe_low_confidence(leaves: Leaves) -> str:
    """A sentence where fewer than half of the leaves are right, by the sum of their confidences; else empty."""
    if leaves.confidence is None or not len(leaves):
        return ""
    right = float(leaves.confidence.sum())
    if right >= FEW_RIGHT * len(leaves):
        return ""
    return (
        f"some {right:.0f} of {len(leaves)} leaves that were found are right, by their confidence, and the others are "
        "guessed; they may be lobed or grass-like, or depth does not show them"
    )


def median_length_px(leaves: Leaves, views: Sequence[View]) -> float | None:
    """How long the median leaf is in the photograph that shows it best, in its pixels; None where that is unknown.

    Args:
        leaves: In the world of the views.
        views: That leaf.view counts.
    """
    if leaves.view is None:
        return None
    middle_m = leaves.asset_from_leaf() @ (0.0, 0.5, 0.0, 1.0)
    lengths_px = []
    for number in np.unique(leaves.view[leaves.view >= 0]).tolist():
        camera, own = views[number].camera, leaves.view == number
        away_m = np.linalg.norm(middle_m[own] - camera.position_m, axis=1)
        lengths_px.append(camera.focal_px[0] * leaves.length_m[own] / np.maximum(away_m, 1e-9))
    return float(np.median(np.concatenate(lengths_px))) if lengths_px else None


def describe_leaves(
    leaves: Leaves,
    views: Sequence[View],
    segmentation: Segmentation,
    *,
    outlined: NDArray[np.float64] | None = None,
    gain: NDArray[np.float64] | None = None,
    not_green: int = 0,
) -> list[Remark]:
    """What whoever uses the leaves should know.

    Args:
        outlined: (N,), the share of each leaf's edge that lies on its silhouette, if that was measured.
        gain: (V,), by which each view is brighter than the median one, if that was measured.
        not_green: How many leaves are left out as they are not green.
    """
    remarks = []
    if gain is not None and gain.max() > EXPOSED * gain.min():
        darkest, brightest = views[int(gain.argmin())].name, views[int(gain.argmax())].name
        text = (
            f"exposures differ: the same leaves are {gain.max() / gain.min():.1f} times as bright in {brightest} as in "
            f"{darkest}"
        )
        remarks.append(remark("exposures-differ", text, subject=f"{darkest}, {brightest}"))
    without = sum(not view.has_depth for view in views)
    if without == len(views):
        remarks.append(remark("no-view-with-depth", "no view has depth, and leaves are found in depth"))
    elif without:
        text = f"{without} of {len(views)} views have no depth; no leaf was looked for in them"
        remarks.append(remark("views-without-depth", text))
    if len(views) == 1:
        text = (
            "there is one view only; what it does not show is unknown, leaves that are hidden in part come out shorter "
            "or guessed, and no other view confirms a leaf"
        )
        remarks.append(remark("one-view", text))
    if not len(leaves):
        found = sum(len(view.confidence) for view in segmentation.candidates)
        text = f"no leaf was found, of {found:,} candidates" if found else "no leaf was found, not even a candidate"
        remedy = "the table of the report shows where they were lost" if found else "see where photographs have depth"
        remarks.append(remark("no-leaf-found", text, remedy=remedy))
        return remarks
    low = describe_low_confidence(leaves)
    if low:
        remarks.append(remark("leaves-guessed", low))
    if not_green:
        text = f"{not_green} of {len(leaves) + not_green} leaves are left out: they are not green, and all others are"
        every = Setting(name="leaves.max_not_green", value="0")
        remarks.append(remark("leaves-not-green-left-out", text, remedy=("if they are leaves, keep them by ", every)))
    long_px = median_length_px(leaves, views)
    if long_px is not None and long_px < SMALL_PX:
        text = (
            f"the median leaf that was found is {long_px:.0f} pixels long in its photograph; below {SMALL_PX:g} most "
            "may be lost where depth is estimated"
        )
        remarks.append(remark("leaves-small", text, remedy="take nearer photographs"))
    lobed = outlined is not None and float(np.median(outlined)) < LOBED[1]
    if lobed:
        text = (
            "the edges of most leaves lie off every single silhouette; leaves seem to be lobed, toothed or of several "
            "leaflets, of which this model gives the outer shape, and their confidence is low"
        )
        remarks.append(remark("leaves-lobed", text))
    shape = float(np.median(leaf_width(leaves.parameters)))
    narrow, wide = SINGLE_LOBED
    if not narrow <= shape <= wide:
        kind = "grass-like" if shape < narrow else "lobed, or of several leaflets"
        text = (
            f"leaves are {shape:.2f} times as wide as long, which is not what leaves of one lobe are "
            f"({narrow:g} to {wide:g}); they may be {kind}, and one axis and one silhouette do not describe them well"
        )
        remarks.append(remark("leaf-shape-improbable", text))
    elif not lobed and np.mean(leaf_width(leaves.parameters) > ROUND) > 0.5:
        text = "most leaves are about as wide as long; their axes follow from the fit alone"
        remedy = "look at the fitted leaves over the photographs"
        remarks.append(remark("leaf-axes-uncertain", text, remedy=remedy))
    return remarks
