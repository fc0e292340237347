"""From a number of leaves to an asset of a random spray."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from usdfoliage import __version__
from usdfoliage.asset.asset_record import AssetOrigin
from usdfoliage.asset.leaf_representations import MAX_LEAVES_OF_ALL, needed_memory, note_bezier_alone
from usdfoliage.asset.packages.leaf_package import write_leaf_asset
from usdfoliage.asset.parts.leaf_part import LeafAppearance, LeafAssetSettings
from usdfoliage.asset.provenance import Provenance
from usdfoliage.asset.publish import plan_folder, publish_folder
from usdfoliage.errors import FoliageError
from usdfoliage.files.hashing import digest_files
from usdfoliage.leaf.shape.spray import SpraySettings, scatter_spray
from usdfoliage.leaf.shape.variation import VariationSettings, vary_colors
from usdfoliage.progress import StepProgress
from usdfoliage.remarks import Remark, RenderSetting, as_plan_setting, label_remarks, remark

MAX_LEAVES = 10_000_000
MAX_PATCHES = 100_000  # one prim a leaf: beyond it no application opens the representation nurbs
LENGTHS_M = (1e-6, 1e3)
MAX_VARIATION = 10.0  # there leaves are a dozen times as wide as others


@dataclass(frozen=True, kw_only=True)
class ScatterRequest:
    """What the user asked for, checked."""

    count: int
    output: Path
    name: str
    seed: int
    spray: SpraySettings
    settings: LeafAssetSettings
    appearance: LeafAppearance
    chosen: bool  # whether the user named the representations
    force: bool = False
    keep_old: bool = False  # what is replaced stays in a folder beside the new asset

    @property
    def origin(self) -> AssetOrigin:
        """Of the asset."""
        return AssetOrigin(name=self.name, command="scatter")


@dataclass(frozen=True, kw_only=True)
class MadeSpray:
    """What was written, and what the user should know of it."""

    asset: Path
    count: int
    representations: Sequence[str]
    remarks: tuple[Remark, ...]


def scatter_asset(request: ScatterRequest, progress: StepProgress | None = None) -> MadeSpray:
    """Grow the spray and publish its asset; what was there stays until the new one is whole.

    Raises:
        FoliageError: A picture is unusable, or the output cannot be written; nothing was changed.
    """
    with publish_folder(
        request.output, force=request.force, origin=request.origin, keep_old=request.keep_old
    ) as folder:
        if progress:
            progress("leaves", 0.0)
        rng = np.random.default_rng(request.seed)
        leaves = scatter_spray(request.count, rng, request.spray)
        if request.spray.variation.amount:
            colors = vary_colors(request.appearance.color, request.count, rng, request.spray.variation.amount)
            leaves = replace(leaves, color=colors)
        if progress:
            progress("asset", 0.3)
        provenance = Provenance(
            capture="",  # nothing was captured
            generator=f"usdfoliage {__version__}",
            seed=request.seed,
            settings=describe_settings(request),
            input_sha256=digest_files([request.appearance.texture, request.appearance.jitter_map]),
        )
        interface = write_leaf_asset(
            folder, request.name, leaves, provenance, request.settings, appearance=request.appearance
        )
    return MadeSpray(
        asset=request.output / interface.name,
        count=request.count,
        representations=request.settings.representations,
        remarks=tuple(_remarks(request)),
    )


def plan_spray(request: ScatterRequest, render: RenderSetting = as_plan_setting) -> str:
    """What scatter_asset would do, in lines; writes nothing. render writes the settings of remarks."""
    lines = [
        f"leaves: {request.count:,}",
        f"representations: {', '.join(request.settings.representations)}",
        *label_remarks(_remarks(request), render),
        f"settings: {', '.join(f'{name} {value}' for name, value in describe_settings(request).items())}",
        plan_folder(
            request.output, f"{request.name}.usda", request.force, origin=request.origin, keep_old=request.keep_old
        ),
    ]
    return "\n".join(lines)


def describe_settings(request: ScatterRequest) -> dict[str, str]:
    """Every setting that decides the result, by the name of its option."""
    mesh = request.settings.mesh
    return {
        "count": str(request.count),
        "length": f"{request.spray.length_m:g}",
        "variation": f"{request.spray.variation.amount:g}",
        "representation": " ".join(request.settings.representations),
        "resolution": f"{mesh.across} {mesh.along}",
        "color": " ".join(f"{channel:g}" for channel in request.appearance.color),
        "texture": request.appearance.texture.name if request.appearance.texture else "none",
        "jitter-map": request.appearance.jitter_map.name if request.appearance.jitter_map else "none",
        "seed": str(request.seed),
    }


def check_count(count: int) -> None:
    """Raises FoliageError for a number of leaves that cannot be."""
    if count < 0:
        raise FoliageError(f"the number of leaves must be 0 or more, not {count}")
    if count > MAX_LEAVES:
        gib = needed_memory(count, LeafAssetSettings(representations=("bezier",))) / 2**30
        raise FoliageError(
            f"{count:,} leaves would need about {gib:,.0f} GiB of memory; "
            f"an asset takes at most {MAX_LEAVES:,}, so make several"
        )


def read_color(numbers: Sequence[float], name: str = "color") -> tuple[float, float, float]:
    """A colour of three numbers; FoliageError, which begins with name, for one that no plant has."""
    red, green, blue = numbers
    if not all(0 <= channel <= 1 for channel in numbers):  # false for NaN too
        raise FoliageError(f"{name} must be three numbers from 0 to 1, linear, not {red:g} {green:g} {blue:g}")
    return red, green, blue


def read_spray(length_m: float, variation: float) -> SpraySettings:
    """Leaves of this length that differ by this share of what they do on a plant."""
    shortest_m, longest_m = LENGTHS_M
    if not shortest_m <= length_m <= longest_m:  # true for NaN too
        raise FoliageError(f"length must be {shortest_m:g} to {longest_m:g} metres, not {length_m:g}")
    if not 0 <= variation <= MAX_VARIATION:
        raise FoliageError(f"variation must be 0 to {MAX_VARIATION:g}, not {variation:g}")
    return SpraySettings(
        length_m=length_m,
        length_variation=SpraySettings().length_variation * variation,
        variation=VariationSettings(amount=variation),
    )


def _remarks(request: ScatterRequest) -> list[Remark]:
    remarks = []
    if not request.chosen and request.count > MAX_LEAVES_OF_ALL:
        remarks.append(note_bezier_alone())
    if "nurbs" in request.settings.representations and request.count > MAX_PATCHES:
        text = f"nurbs has one prim a leaf: few applications open {request.count:,} of them"
        remarks.append(remark("many-patches", text))
    return remarks
