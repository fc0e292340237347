"""The main job on one photograph: a mask and colours in, a crown model and its measures out."""

from dataclasses import dataclass, field
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.crown.color_map import ColorMapSettings, build_color_map
from usdfoliage.crown.model import CrownModel
from usdfoliage.crown.projection import make_exemplar, project_photo
from usdfoliage.crown.radius import RadiusSettings, front_outline, render_radius, within_outline
from usdfoliage.crown.relief import ReliefSettings, displace_radius, fit_relief
from usdfoliage.crown.silhouette import SilhouetteSettings, StarSilhouette, fit_star_silhouette
from usdfoliage.crown.surface import SurfaceSettings, inflate_silhouette
from usdfoliage.crown.texture import TextureSettings
from usdfoliage.crown.tone import measure_color_statistics
from usdfoliage.geometry.cubemap import FACES, face_directions, sample_cubemap, share_borders
from usdfoliage.geometry.picture_agreement import silhouette_iou
from usdfoliage.progress import StepProgress, follow_step

STEPS = ("silhouette", "base surface", "radius", "photograph", "texture", "relief", "composition")


MIN_SIZE = 32  # texels a side; in fewer, patches of foliage cannot be distinguished
MAX_SIZE = 4096  # a map of it has 100 million texels
EXPECTED_RELIEF_SIZE = 96  # texels a side are enough to know where the photograph will come to lie


@dataclass(frozen=True, kw_only=True)
class CrownSettings:
    """Everything that decides what a crown becomes."""

    size: int = 256  # texels a side of a cubemap face
    height_m: float = 5.0  # of the finished crown's front silhouette
    tangent: float | None = None  # k; None: fitted
    relief: float = 0.12  # ρ
    band_pass: bool = False  # Laplacian pyramid for the relief
    copies: int = 1
    seed: int = 0
    threads: int = 0

    def __post_init__(self) -> None:
        if not MIN_SIZE <= self.size <= MAX_SIZE:
            raise ValueError(f"the size must be from {MIN_SIZE} to {MAX_SIZE} texels, not {self.size}")
        if self.threads < 0:
            raise ValueError(f"threads must be 0, for all cores, or more, not {self.threads}")
        if not (np.isfinite(self.height_m) and self.height_m > 0):
            raise ValueError(f"the height must be a positive number of metres, not {self.height_m}")
        if not 0 <= self.seed < 2**63:  # an asset records it as int64
            raise ValueError(f"the seed must be 0 or positive and below 2^63, not {self.seed}")
        for checked in (self.radius_settings, self.surface_settings, self.color_map_settings, self.relief_settings):
            assert checked is not None  # each checks its own values when it is made

    @property
    def radius_settings(self) -> RadiusSettings:
        return RadiusSettings(size=self.size, copies=self.copies, threads=self.threads)

    @property
    def surface_settings(self) -> SurfaceSettings:
        # Finer than the cubemap the surface is not seen, and the thin plate is smooth: its detail is its silhouette.
        return SurfaceSettings(grid=min(max(self.size, 128), 320), tangent=self.tangent)

    @property
    def color_map_settings(self) -> ColorMapSettings:
        return ColorMapSettings(texture=TextureSettings(threads=self.threads))

    @property
    def relief_settings(self) -> ReliefSettings:
        return ReliefSettings(weight=self.relief, band_pass=self.band_pass)


@dataclass(frozen=True, kw_only=True, eq=False)
class CrownMeasures:
    """How well the crown repeats its photograph, and what it took."""

    silhouette: StarSilhouette
    outline_px: NDArray[np.float64]  # (A, 2), the finished crown's front silhouette in the photograph
    iou: float  # of that silhouette and the mask, where they lie in the photograph
    iou_aligned: float  # the same with both cut to their bounds and brought to one height
    seconds: dict[str, float] = field(default_factory=dict)  # by step

    @property
    def star_bound(self) -> float:
        """The best IoU that a star-shaped crown about the centre can have."""
        return self.silhouette.iou


def reconstruct_crown(
    color: NDArray[np.floating],
    mask: NDArray[np.bool_],
    settings: CrownSettings = CrownSettings(),
    tangent_map: NDArray[np.floating] | None = None,
    progress: StepProgress | None = None,
    foliage: NDArray[np.bool_] | None = None,
) -> tuple[CrownModel, CrownMeasures]:
    """Reconstruct a crown from one photograph.

    Args:
        color: (H, W, 3), linear Rec.709.
        mask: (H, W), True inside the crown; one component without holes.
        settings: What to make.
        tangent_map: see inflate_silhouette.
        progress: Called at each step.
        foliage: (H, W), where the picture shows foliage and not sky through a gap; None: wherever mask is.

    Raises:
        FitError: The mask does not determine a crown, or its foliage is too small a sample for the texture.

    Source:
        Argudo, chapter 4.
    """
    if color.shape[:2] != mask.shape:
        raise ValueError(f"photograph {color.shape[:2]} and mask {mask.shape} differ in size")
    rng = np.random.default_rng(settings.seed)
    seconds: dict[str, float] = {}
    step = partial(follow_step, seconds=seconds, progress=progress)

    with step("silhouette"):
        silhouette = fit_star_silhouette(mask, SilhouetteSettings())
    with step("base surface"):
        surface = inflate_silhouette(silhouette, settings.surface_settings, tangent_map)
    with step("radius"):
        base_px = render_radius(surface, settings.radius_settings) * surface.cell_px
        outline = front_outline(base_px)
    with step("photograph"):
        # A texel in the middle of a face is 2/(N − 1) of the radius wide.
        texel_px = float(np.median(base_px[FACES.index("+Z")])) * 2 / (settings.size - 1)
        exemplar = make_exemplar(color, mask, texel_px, foliage)
        seen, weight = project_photo(exemplar, base_px, silhouette.center_px)
        # Relief moves what a texel shows: find the relief of the front first and project onto that.
        reduced = sample_cubemap(seen, face_directions(min(settings.size, EXPECTED_RELIEF_SIZE)))
        expected_height = sample_cubemap(fit_relief(reduced, settings.relief_settings), face_directions(settings.size))
        expected = displace_radius(base_px, expected_height, settings.relief)
        seen, _ = project_photo(exemplar, within_outline(expected, outline), silhouette.center_px)
    with step("texture") as report:
        target = measure_color_statistics(color, mask if foliage is None else foliage)
        cubemap = build_color_map(
            exemplar.color, exemplar.mask, seen, weight, target, rng, settings.color_map_settings, progress=report
        )
    with step("relief"):
        height = fit_relief(cubemap, settings.relief_settings)
    with step("composition"):
        radius_px = share_borders(within_outline(displace_radius(base_px, height, settings.relief), outline))
        model = _place(radius_px, cubemap, silhouette, settings)
        measures = _measure(radius_px, mask, silhouette, seconds)
    return model, measures


def _place(
    radius_px: NDArray[np.floating], cubemap: NDArray[np.float32], silhouette: StarSilhouette, settings: CrownSettings
) -> CrownModel:
    """Scale to metres and stand the crown's lowest point on the ground below its centre."""
    y_px = face_directions(settings.size)[..., 1] * radius_px
    lowest, highest = float(y_px.min()), float(y_px.max())
    metres = settings.height_m / (highest - lowest)
    center_m = np.array([0.0, -lowest * metres, 0.0])
    x_px, row_px = silhouette.center_px
    asset_from_photo = np.array(
        [
            [metres, 0, 0, -x_px * metres],
            [0, -metres, 0, center_m[1] + row_px * metres],
            [0, 0, metres, 0],
            [0, 0, 0, 1],
        ]
    )
    return CrownModel(
        radius_m=(radius_px * metres).astype(np.float32),
        color=cubemap,
        center_m=center_m,
        relief_weight=settings.relief,
        asset_from_photo=asset_from_photo,
    )


def _measure(
    radius_px: NDArray[np.floating], mask: NDArray[np.bool_], silhouette: StarSilhouette, seconds: dict[str, float]
) -> CrownMeasures:
    outline = front_outline(radius_px)
    angle = 2 * np.pi * np.arange(len(outline)) / len(outline)
    outline_px = silhouette.center_px + outline[:, None] * np.column_stack([np.cos(angle), -np.sin(angle)])
    # Room around the photograph: the outline of a crown that is cut by the border may leave it.
    beyond = np.concatenate([-outline_px.min(axis=0), outline_px.max(axis=0) - mask.shape[::-1], [0.0]])
    margin = int(np.ceil(beyond.max())) + 1
    drawn = np.zeros((mask.shape[0] + 2 * margin, mask.shape[1] + 2 * margin), np.uint8)
    bits = 6
    cv2.fillPoly(drawn, [np.rint((outline_px + margin - 0.5) * (1 << bits)).astype(np.int32)], 1, shift=bits)
    crown, given = drawn > 0, np.pad(mask, margin)
    return CrownMeasures(
        silhouette=silhouette,
        outline_px=outline_px,
        iou=silhouette_iou(crown, given),
        iou_aligned=silhouette_iou(*_align(crown, given)),
        seconds=seconds,
    )


def _align(*masks: NDArray[np.bool_], height_px: int = 512) -> list[NDArray[np.bool_]]:
    """Masks cut to their bounds, brought to one height and centred in one width."""
    cut = []
    for mask in masks:
        left, top, wide, high = cv2.boundingRect(mask.astype(np.uint8))
        part = mask[top : top + high, left : left + wide].astype(np.uint8)
        width = max(1, round(part.shape[1] * height_px / part.shape[0]))
        cut.append(cv2.resize(part, (width, height_px), interpolation=cv2.INTER_NEAREST) > 0)
    widest = max(part.shape[1] for part in cut)
    gaps = [widest - part.shape[1] for part in cut]
    return [np.pad(part, ((0, 0), (gap // 2, gap - gap // 2))) for part, gap in zip(cut, gaps, strict=True)]
