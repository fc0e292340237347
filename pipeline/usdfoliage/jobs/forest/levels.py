"""From plants that stand somewhere to instancers: prototypes, sizes and turns."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage.asset.packages.planted_assets import PlantedAsset, PlantedForm, measure_planted_asset, reference_path
from usdfoliage.asset.parts import crown as crown_part
from usdfoliage.asset.parts.crown_leaves import OtherLeaves
from usdfoliage.asset.parts.planted import ForestPrototype, PlantedLevel
from usdfoliage.asset.plant import asset_name
from usdfoliage.errors import AssetError, CaptureError
from usdfoliage.forest.kinds import PlantKind
from usdfoliage.forest.planting import Planting
from usdfoliage.forest.plants_file import PlantRow, PlantsFile

CROWN, RELIEF, LEAVES, FULL = "crown", "relief", "leaves", "full"  # levels
# The form of a crown in each level; where an asset has more than its crown in the level FULL, it shows that.
_FORMS: Mapping[str, str] = {
    CROWN: crown_part.MESH,
    RELIEF: crown_part.RELIEF,
    LEAVES: crown_part.LEAVES,
    FULL: crown_part.LEAVES,
}
TRUNK_SHARE = 0.3  # of a tree's height, that is under a crown that has no trunk of its own
TRUNK_INTO = 0.35  # of the crown's height, that its trunk goes on inside
TRUNK_RADIUS = 0.018  # of a tree's height
WIDEST = 2.5  # times as wide, for its height, as its asset is, or as slim


def measure_plants(plants: PlantsFile, output: Path) -> tuple[PlantedAsset, ...]:
    """The asset of each row, each file measured once; none may lie in the folder that is written.

    Raises:
        CaptureError: An asset cannot be used; the text names the row.
    """
    measured: dict[Path, PlantedAsset] = {}
    for number, row in enumerate(plants.rows):
        if row.asset in measured:
            continue
        if row.asset.resolve().is_relative_to(output.resolve()):
            raise CaptureError(
                f"row {number + 1} ({row.species}) of {plants.path}: {row.asset} lies in the output {output}",
                "write the forest to another folder",
            )
        try:
            measured[row.asset] = measure_planted_asset(row.asset)
        except AssetError as error:
            raise CaptureError(
                f"row {number + 1} ({row.species}) of {plants.path}: {error.text}", error.remedy
            ) from error
    return tuple(measured[row.asset] for row in plants.rows)


def make_level(
    name: str,
    planting: Planting,
    plants: PlantsFile,
    assets: Sequence[PlantedAsset],
    payload: Path,
    asset_from_ground: NDArray[np.float64],
    seed: int,
    lod_distance_m: tuple[float, float],
    leaves: Sequence[OtherLeaves | None] = (),
) -> PlantedLevel:
    """All plants in the form of one level.

    Args:
        name: CROWN, RELIEF, LEAVES or FULL.
        planting: What stands where.
        plants: The rows.
        assets: Of each row.
        payload: The folder of the layer that is written, where it will be at last.
        asset_from_ground: (4, 4), column vectors, from easting, northing and height in metres.
        seed: Of the planting.
        lod_distance_m: Between which forms change.
        leaves: Of the crown of each row, where these are not its own; none by default.
    """
    prototypes, sizes = [], []
    for number, (row, asset) in enumerate(zip(plants.rows, assets, strict=True)):
        form = asset.full if name == FULL and asset.full is not None else asset.crown
        crown_form = _FORMS[name]
        crown_form = crown_form if crown_form in asset.crown_forms and form is asset.crown else ""
        other = leaves[number] if leaves and crown_form == crown_part.LEAVES else None
        prototype, height_m, radius_m = _prototype(number, row, asset, form, crown_form, payload, other)
        prototypes.append(prototype)
        sizes.append((height_m, radius_m))
    size_m = np.array(sizes).reshape(-1, 2)
    own_m = size_m[planting.row]
    up = planting.height_m / own_m[:, 0]
    across = np.clip(planting.radius_m / own_m[:, 1], up / WIDEST, up * WIDEST)
    ground_m = np.column_stack([planting.ground_m, planting.elevation_m, np.ones(len(planting))])
    return PlantedLevel(
        name=name,
        prototypes=prototypes,
        prototype=planting.row.astype(np.int32),
        ids=np.arange(len(planting)),
        position_m=(ground_m @ asset_from_ground.T)[:, :3],
        orientation=turn_and_lean(planting.turn_deg, planting.lean_deg),
        scale=np.column_stack([across, up, across]),
        tint=planting.tint,
        jitter=planting.jitter,
        seed=seed,
        lod_distance_m=lod_distance_m,
    )


def levels_of(assets: Sequence[PlantedAsset]) -> tuple[str, ...]:
    """The levels in which at least one asset differs from others; the first is the default."""
    forms = {form for asset in assets for form in asset.crown_forms}
    full = any(asset.full is not None for asset in assets)
    return (CROWN, *(level for level in (RELIEF, LEAVES) if _FORMS[level] in forms), *([FULL] if full else []))


def turn_and_lean(turn_deg: NDArray[np.float64], lean_deg: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 4) unit quaternions, real part first: a turn (N,) about Y, then a lean (N, 2) to +X and to -Z."""
    half = np.radians(turn_deg) / 2
    lean = np.radians(np.linalg.norm(lean_deg, axis=1)) / 2
    size = np.maximum(2 * np.degrees(lean), 1e-300)
    # To lean to +X is a turn about -Z, to lean to -Z a turn about -X.
    axis = np.stack([-lean_deg[:, 1] / size, np.zeros(len(lean)), -lean_deg[:, 0] / size], axis=-1)
    w, xyz = np.cos(lean), np.sin(lean)[:, None] * axis
    c, s = np.cos(half), np.sin(half)
    # The product of the lean and the turn (c, 0, s, 0).
    return np.stack(
        [
            w * c - xyz[:, 1] * s,
            xyz[:, 0] * c - xyz[:, 2] * s,
            w * s + xyz[:, 1] * c,
            xyz[:, 2] * c + xyz[:, 0] * s,
        ],
        axis=-1,
    )


def _prototype(
    number: int,
    row: PlantRow,
    asset: PlantedAsset,
    form: PlantedForm,
    crown_form: str,
    payload: Path,
    leaves: OtherLeaves | None,
) -> tuple[ForestPrototype, float, float]:
    """A prototype, with the height and the crown's radius that it has."""
    low, high = form.extent_m
    drawn_m = asset.crown_forms.get(crown_form, form.extent_m)
    if leaves is not None and asset.clusters is not None:
        wider_m = asset.meters_per_unit * float((leaves.extent - asset.clusters.extent)[1].max())
        drawn_m = drawn_m + np.array([[-wider_m], [wider_m]])
    raised_m, trunk_m = 0.0, None
    extent_m = drawn_m
    height_m = form.height_m
    if asset.only_crown and row.kind == PlantKind.TREE:
        crown_m = float(high[1] - low[1])
        height_m = crown_m / (1 - TRUNK_SHARE)
        raised_m = TRUNK_SHARE * height_m - float(low[1])
        trunk_m = (TRUNK_SHARE * height_m + TRUNK_INTO * crown_m, TRUNK_RADIUS * height_m)
        raised = drawn_m + np.array([0.0, raised_m, 0.0])
        extent_m = np.stack([np.minimum(raised[0], [0.0, 0.0, 0.0]), raised[1]])
    prototype = ForestPrototype(
        name=f"Plant_{number + 1}_{asset_name(row.species)}",
        species=row.species,
        kind=row.kind.value,
        share=row.share,
        scale_range=(row.height_m[0] / height_m, row.height_m[1] / height_m),
        reference=reference_path(asset.layer, payload),
        selections=form.selections,
        crown_form=crown_form,
        asset_to_meters=asset.meters_per_unit,
        is_z_up=asset.is_z_up,
        raised_m=raised_m,
        trunk_m=trunk_m,
        extent_m=extent_m,
        leaves=leaves,
    )
    return prototype, height_m, form.radius_m


def count_rows(planting: Planting, plants: PlantsFile) -> Mapping[str, int]:
    """How many plants there are of each species."""
    counts = np.bincount(planting.row, minlength=len(plants.rows))
    named: dict[str, int] = {}
    for row, count in zip(plants.rows, counts.tolist(), strict=True):
        named[row.species] = named.get(row.species, 0) + count
    return named
