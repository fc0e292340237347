"""Where the plants of a forest stand: trees as they are seen from above, the rest drawn in its class."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from usdfoliage.forest.ground_cover import scatter_blue_noise
from usdfoliage.forest.kinds import PlantKind
from usdfoliage.forest.plants_file import PlantRow, PlantsFile
from usdfoliage.forest.raster import Raster, is_inside, pixel_grid, sample_nearest, to_ground, to_pixels
from usdfoliage.forest.species import SeenTrees, are_of_leaves, assign_species, crown_colors
from usdfoliage.forest.terrain import Terrain, ground_height, is_known, slope_deg
from usdfoliage.forest.tree_tops import TreeTops, TreeTopSettings, find_tops_of_canopy, find_tops_of_photo
from usdfoliage.forest.vegetation_classes import (
    PhotoTexture,
    VegetationClasses,
    are_rough,
    find_classes,
    find_covered,
    find_hidden_trees,
)

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

FORMS: Mapping[PlantKind, float] = {PlantKind.TREE: 0.25, PlantKind.SHRUB: 0.5, PlantKind.GRASS: 0.5}
BORDER = 0.05  # of a pixel, that a place is inside it
SPACING = 0.8  # of the side of the square that a tree has on average, between two
MAX_PLANTS, MAX_PER_HA = 10_000_000, 100_000
ASIDE = 0.5  # of its crown's radius, by which a tree may be moved onto ground of trees
TURN_SEED, SHRUB_SEED, GRASS_SEED, TREE_SEED, JITTER_SEED = 1, 2, 3, 4, 5  # each draw has numbers of its own


@dataclass(frozen=True, kw_only=True)
class PlantingSettings:
    """How a forest is planted."""

    seed: int = 0
    tree_tops: TreeTopSettings = field(default_factory=TreeTopSettings)
    trees_per_ha: float = 300.0  # where trees are, and nothing shows them singly
    shrub_spacing: float = 1.2  # widths of a shrub, from one to the next
    grass_spacing: float = 1.5  # widths of a tuft, likewise
    find_classes: bool = True  # whether the pictures show where plants are, if no raster of classes does
    max_ground_cover: int = 100_000  # shrubs and tufts of grass in all; fewer, evenly, where there would be more
    patch_m: float = 25.0  # diameter of patches of one species, where nothing but the share decides
    lean_deg: float = 2.0  # standard deviation of how far plants lean
    scale_spread: float = 0.08  # standard deviation of a drawn crown's width, as a share of it

    def __post_init__(self) -> None:
        for name in ("trees_per_ha", "shrub_spacing", "grass_spacing", "patch_m"):
            if not 0 < getattr(self, name) < np.inf:
                raise ValueError(f"{name} must be above 0, not {getattr(self, name)}")
        if not 0 <= self.seed < 2**31:
            raise ValueError(f"the seed must be 0 to below 2^31, not {self.seed}")
        if not 0 <= self.max_ground_cover <= MAX_PLANTS:
            raise ValueError(f"max_ground_cover must be 0 to {MAX_PLANTS:,}, not {self.max_ground_cover}")
        if self.trees_per_ha > MAX_PER_HA:
            raise ValueError(f"trees_per_ha must be at most {MAX_PER_HA:,}, not {self.trees_per_ha:g}")
        if not 0 <= self.lean_deg <= 45:
            raise ValueError(f"lean_deg must be 0 to 45, not {self.lean_deg:g}")
        if not 0 <= self.scale_spread <= 0.5:
            raise ValueError(f"scale_spread must be 0 to 0.5, not {self.scale_spread:g}")


@dataclass(frozen=True, kw_only=True, eq=False)
class ForestInput:
    """What a forest is planted from, in one coordinate system."""

    terrain: Terrain
    plants: PlantsFile
    orthophoto: Raster | None = None  # (H, W, 3) linear
    canopy: Raster | None = None  # (H, W) metres above the ground
    vegetation: Raster | None = None  # (H, W) codes
    trunks_m: Floats | None = None  # (N, 2) places of trees that are given


@dataclass(frozen=True, kw_only=True, eq=False)
class Planting:
    """Plants (N,), in the frame of the terrain; their order is their ids."""

    ground_m: Floats  # (N, 2) easting and northing
    elevation_m: Floats  # (N,) of the ground there
    row: Ints  # (N,) of plants.toml
    height_m: Floats  # (N,)
    radius_m: Floats  # (N,) of the crown
    turn_deg: Floats  # (N,) about the vertical
    lean_deg: Floats  # (N, 2) to the east and to the north
    tint: Floats  # (N, 3) mean linear colour of the orthophoto over the crown; the row's where there is none
    jitter: Floats  # (N,) 0 to 1, where in a range of distances the form is changed
    seen: NDArray[np.bool_]  # (N,) whether a picture shows it singly
    not_planted: Mapping[str, int]  # by reason, how many
    empty_kinds: tuple[PlantKind, ...]  # of which there is ground, and no row
    found_shares: Mapping[PlantKind, float] = field(default_factory=dict)  # of the ground, where classes were found
    vegetated: Raster | None = None  # (H, W), 1 where the ground is of any kind of plant; None where nothing shows that

    def __len__(self) -> int:
        return len(self.row)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Some:
    """Plants of one kind before rows and turns are drawn."""

    kind: PlantKind
    ground_m: Floats
    height_m: Floats  # NaN: drawn
    radius_m: Floats  # NaN: of the row's form
    seen: bool


def plant_forest(given: ForestInput, settings: PlantingSettings = PlantingSettings()) -> Planting:
    """Plant a terrain.

    Args:
        given: Terrain, rasters and rows.
        settings: How.
    """
    refused: dict[str, int] = {}
    found = find_classes(given.orthophoto, given.canopy) if settings.find_classes and not given.vegetation else None
    covered = given if found is None else _with_classes(given, found)
    # Trees of an orthophoto alone may have colours that no lawn has.
    photo = None if found is None else found.photo
    trees = _find_trees(given if given.canopy is None else covered, settings, refused, photo)
    if found is not None and given.canopy is None:
        species = [row for row in given.plants.rows if row.kind == PlantKind.TREE]
        radius_m = np.where(np.isfinite(trees.radius_m), trees.radius_m, _typical_radius(species, PlantKind.TREE))
        under = find_covered(found.grid, found.grass, trees.ground_m, radius_m)
        covered = _with_classes(given, replace(found, grass=found.grass & ~under))
    cover = [
        _cover(covered, kind, settings, seed)
        for kind, seed in ((PlantKind.SHRUB, SHRUB_SEED), (PlantKind.GRASS, GRASS_SEED))
    ]
    total = sum(len(each.ground_m) for each in cover)
    if total > settings.max_ground_cover:
        # The first of blue noise in order of being thrown cover the ground evenly too.
        share = settings.max_ground_cover / total
        refused["more ground cover than max_ground_cover"] = total - settings.max_ground_cover
        cover = [_only(each, np.arange(len(each.ground_m)) < int(share * len(each.ground_m))) for each in cover]
    empty = []
    parts = []
    for some in (trees, *_hidden_trees(given, found, trees, settings), *cover):
        rows = [number for number, row in enumerate(given.plants.rows) if row.kind == some.kind]
        if not rows:
            if len(some.ground_m) or _has_ground(given, some.kind):
                empty.append(some.kind)
            continue
        known = is_known(given.terrain, some.ground_m)
        if (~known).any():
            refused["no height of the ground"] = refused.get("no height of the ground", 0) + int((~known).sum())
        parts.append(_decide(given, _only(some, known), rows, settings, refused))
    planting = _together(parts, refused, tuple(empty), settings)
    planting = replace(planting, vegetated=_vegetated(given if found is None else _with_classes(given, found)))
    return planting if found is None else replace(planting, found_shares=_shares(found))


def _with_classes(given: ForestInput, found: VegetationClasses) -> ForestInput:
    """The input with the classes that were found as a raster, whatever its own codes would stand for."""
    codes = np.zeros(found.tree.shape)
    classes: dict[int, PlantKind | None] = {0: None}
    for code, (mask, kind) in enumerate(_masks(found), 1):
        codes[mask] = code
        classes[code] = kind
    raster = Raster(values=codes, ground_from_pixel=found.grid.ground_from_pixel, crs=found.grid.crs)
    return replace(given, vegetation=raster, plants=replace(given.plants, classes=classes))


def _shares(found: VegetationClasses) -> dict[PlantKind, float]:
    return {kind: float(mask.mean()) for mask, kind in _masks(found)}


def _masks(found: VegetationClasses) -> tuple[tuple[NDArray[np.bool_], PlantKind], ...]:
    return (found.tree, PlantKind.TREE), (found.shrub, PlantKind.SHRUB), (found.grass, PlantKind.GRASS)


def _find_trees(
    given: ForestInput, settings: PlantingSettings, refused: dict[str, int], photo: PhotoTexture | None
) -> _Some:
    """Trees that are given, seen in the canopy or in the orthophoto, or drawn in the class of trees.

    With the texture of an orthophoto that alone decides on classes, they are as rough as crowns.
    """
    is_tree = _class_mask(given, PlantKind.TREE)
    seen = True
    if given.trunks_m is not None:
        tops = _at_trunks(given, settings)
    elif given.canopy is not None:
        tops = find_tops_of_canopy(given.canopy, settings.tree_tops)
    elif given.orthophoto is not None:
        tops = find_tops_of_photo(given.orthophoto, settings.tree_tops)
        if len(tops.ground_m):
            leafy = are_of_leaves(crown_colors(given.orthophoto, tops.ground_m, tops.radius_m))
            if (~leafy).any():
                refused["not of the colour of leaves"] = int((~leafy).sum())
            tops = TreeTops(**{each.name: getattr(tops, each.name)[leafy] for each in fields(tops)})
        if photo is not None and len(tops.ground_m):
            rough = are_rough(photo, tops.ground_m, tops.radius_m)
            if (~rough).any():
                refused["as smooth as a lawn"] = int((~rough).sum())
            tops = TreeTops(**{each.name: getattr(tops, each.name)[rough] for each in fields(tops)})
    elif is_tree is not None:
        cells_m, cell_m = _cells(given.vegetation, is_tree)
        rng = np.random.default_rng([settings.seed, TREE_SEED])
        places_m = scatter_blue_noise(cells_m, cell_m, SPACING * float(np.sqrt(1e4 / settings.trees_per_ha)), rng)
        wanted = settings.trees_per_ha * len(cells_m) * cell_m**2 / 1e4
        places_m = places_m[: round(wanted)]  # in small patches more fit
        unknown = np.full(len(places_m), np.nan)
        tops = TreeTops(ground_m=places_m, height_m=unknown, radius_m=unknown, strength=unknown)
        seen = False
    else:
        tops = TreeTops(ground_m=np.zeros((0, 2)), height_m=np.zeros(0), radius_m=np.zeros(0), strength=np.zeros(0))
    ground_m = tops.ground_m
    stays = is_inside(given.terrain.heights, ground_m)
    if (~stays).any():
        refused["outside the terrain"] = int((~stays).sum())
    if is_tree is not None and given.vegetation is not None and given.trunks_m is None and len(ground_m):
        ground_m, on = _move_onto(given.vegetation, is_tree, ground_m, ASIDE * np.nan_to_num(tops.radius_m))
        if (stays & ~on).any():
            refused["no ground of trees"] = int((stays & ~on).sum())
        stays &= on
    return _only(
        _Some(kind=PlantKind.TREE, ground_m=ground_m, height_m=tops.height_m, radius_m=tops.radius_m, seen=seen),
        stays,
    )


def _hidden_trees(
    given: ForestInput, found: VegetationClasses | None, trees: _Some, settings: PlantingSettings
) -> list[_Some]:
    """Trees where an orthophoto alone shows wood, and no crown singly: drawn as wide as those of the rows are."""
    rows = [row for row in given.plants.rows if row.kind == PlantKind.TREE]
    if found is None or given.canopy is not None or given.trunks_m is not None or not rows:
        return []
    mask = find_hidden_trees(found, trees.ground_m, trees.radius_m)
    cells_m, cell_m = _cells(found.grid, mask)
    rng = np.random.default_rng([settings.seed, TREE_SEED])
    spacing_m = max(2 * _typical_radius(rows, PlantKind.TREE), float(np.sqrt(1e4 / settings.trees_per_ha)) * SPACING)
    places_m = scatter_blue_noise(cells_m, cell_m, spacing_m, rng)
    places_m = places_m[is_inside(given.terrain.heights, places_m)]
    unknown = np.full(len(places_m), np.nan)
    return [_Some(kind=PlantKind.TREE, ground_m=places_m, height_m=unknown, radius_m=unknown, seen=False)]


def _at_trunks(given: ForestInput, settings: PlantingSettings) -> TreeTops:
    """Trees at given trunks, with the heights and radii of the tops of the canopy that are nearest to them."""
    assert given.trunks_m is not None
    unknown = np.full(len(given.trunks_m), np.nan)
    if given.canopy is None:
        return TreeTops(ground_m=given.trunks_m, height_m=unknown, radius_m=unknown, strength=unknown)
    tops = find_tops_of_canopy(given.canopy, settings.tree_tops)
    if not len(tops.ground_m):
        return TreeTops(ground_m=given.trunks_m, height_m=unknown, radius_m=unknown, strength=unknown)
    away_m, near = cKDTree(tops.ground_m).query(given.trunks_m)
    close = away_m < tops.radius_m[near]
    return TreeTops(
        ground_m=given.trunks_m,
        height_m=np.where(close, tops.height_m[near], np.nan),
        radius_m=np.where(close, tops.radius_m[near], np.nan),
        strength=unknown,
    )


def _class_mask(given: ForestInput, kind: PlantKind) -> NDArray[np.bool_] | None:
    """(H, W) of the vegetation raster, whether its class is this kind; None without one."""
    if given.vegetation is None:
        return None
    codes = [code for code, each in given.plants.classes.items() if each == kind]
    return np.isin(np.nan_to_num(given.vegetation.values, nan=0).astype(np.int64), codes)


def _vegetated(given: ForestInput) -> Raster | None:
    """Where the raster of classes has a kind of plant; None without one."""
    masks = [mask for mask in (_class_mask(given, kind) for kind in PlantKind) if mask is not None]
    if given.vegetation is None or not masks:
        return None
    return replace(given.vegetation, values=np.any(masks, axis=0).astype(np.float32))


def _has_ground(given: ForestInput, kind: PlantKind) -> bool:
    mask = _class_mask(given, kind)
    return mask is not None and bool(mask.any())


def _cells(raster: Raster | None, mask: NDArray[np.bool_]) -> tuple[Floats, float]:
    """Middles (C, 2) of the pixels of a mask, and their side."""
    assert raster is not None
    return pixel_grid(raster)[mask], raster.cell_m


def _move_onto(
    raster: Raster, mask: NDArray[np.bool_], ground_m: Floats, reach_m: Floats
) -> tuple[Floats, NDArray[np.bool_]]:
    """Places (N, 2), moved to the nearest pixel of the mask within reach (N,), and which are on it."""
    if not mask.any():
        return ground_m, np.zeros(len(ground_m), bool)
    nearest = ndimage.distance_transform_edt(~mask, return_distances=False, return_indices=True)
    height, width = mask.shape
    place = to_pixels(raster, ground_m)
    column, row = np.clip(np.floor(place).astype(np.int64), 0, [width - 1, height - 1]).T
    to = np.stack([nearest[1][row, column], nearest[0][row, column]], axis=-1)
    inside = np.clip(place, to + BORDER, to + 1 - BORDER)  # of that pixel
    moved = np.where(mask[row, column, None], ground_m, to_ground(raster, inside))
    off_m = np.linalg.norm(moved - ground_m, axis=1)
    return moved, (off_m <= reach_m) & is_inside(raster, ground_m)


def _cover(given: ForestInput, kind: PlantKind, settings: PlantingSettings, seed: int) -> _Some:
    """Shrubs or grass by blue noise in their class."""
    mask = _class_mask(given, kind)
    rows = [row for row in given.plants.rows if row.kind == kind]
    places_m = np.zeros((0, 2))
    if mask is not None and mask.any() and rows:
        width_m = sum(row.share * 2 * (row.form or FORMS[kind]) * sum(row.height_m) / 2 for row in rows)
        factor = settings.shrub_spacing if kind == PlantKind.SHRUB else settings.grass_spacing
        cells_m, cell_m = _cells(given.vegetation, mask)
        rng = np.random.default_rng([settings.seed, seed])
        # No more is thrown than may stay, with a margin.
        sparse_m = float(np.sqrt(len(cells_m) * cell_m**2 / max(2 * settings.max_ground_cover, 1)))
        places_m = scatter_blue_noise(cells_m, cell_m, max(factor * width_m, sparse_m), rng)
        places_m = places_m[is_inside(given.terrain.heights, places_m)]
    unknown = np.full(len(places_m), np.nan)
    return _Some(kind=kind, ground_m=places_m, height_m=unknown, radius_m=unknown, seen=False)


def _only(some: _Some, stays: NDArray[np.bool_]) -> _Some:
    return replace(some, ground_m=some.ground_m[stays], height_m=some.height_m[stays], radius_m=some.radius_m[stays])


@dataclass(frozen=True, kw_only=True, eq=False)
class _Decided:
    """Plants with their rows."""

    ground_m: Floats
    elevation_m: Floats
    row: Ints
    height_m: Floats
    radius_m: Floats
    tint: Floats
    seen: NDArray[np.bool_]


def _decide(
    given: ForestInput, some: _Some, rows: list[int], settings: PlantingSettings, refused: dict[str, int]
) -> _Decided:
    """Rows, heights and colours of plants of one kind."""
    chosen = [given.plants.rows[number] for number in rows]
    elevation_m = ground_height(given.terrain, some.ground_m)
    allowed = _allowed(given, some.ground_m, elevation_m, chosen)
    radius_m = np.where(np.isfinite(some.radius_m), some.radius_m, _typical_radius(chosen, some.kind))
    color = np.full((len(some.ground_m), 3), np.nan)
    if given.orthophoto is not None and len(some.ground_m):
        covered = is_inside(given.orthophoto, some.ground_m)
        color[covered] = crown_colors(given.orthophoto, some.ground_m[covered], radius_m[covered])
    trees = SeenTrees(
        ground_m=some.ground_m,
        height_m=some.height_m,
        radius_m=some.radius_m,
        color=color if some.kind == PlantKind.TREE else np.full_like(color, np.nan),
    )
    row = assign_species(trees, chosen, allowed, settings.seed + rows[0], settings.patch_m)
    stays = row >= 0
    if (~stays).any():
        reason = "no row of plants.toml may stand there"
        refused[reason] = refused.get(reason, 0) + int((~stays).sum())
    row, ground_m, color = row[stays], some.ground_m[stays], color[stays]
    rng = np.random.default_rng([settings.seed, rows[0], TURN_SEED])
    low, high = np.array([each.height_m for each in chosen])[row].T
    drawn_m = low + (high - low) * rng.random(len(row))
    form = np.array([each.form or FORMS[some.kind] for each in chosen])[row]
    known_m = some.height_m[stays]
    # Of a crown that is seen from above alone, the height follows from its form.
    formed_m = np.clip(some.radius_m[stays] / form, low, high)
    height_m = np.where(np.isfinite(known_m), known_m, np.where(np.isfinite(formed_m), formed_m, drawn_m))
    wide = np.exp(settings.scale_spread * rng.standard_normal(len(row)))
    own = np.array([each.color or (0.1, 0.14, 0.05) for each in chosen])[row] if len(row) else np.zeros((0, 3))
    return _Decided(
        ground_m=ground_m,
        elevation_m=elevation_m[stays],
        row=np.array(rows)[row],
        height_m=height_m,
        radius_m=np.where(np.isfinite(some.radius_m[stays]), some.radius_m[stays], height_m * form * wide),
        tint=np.where(np.isfinite(color), color, own),
        seen=np.full(len(row), some.seen),
    )


def _allowed(given: ForestInput, ground_m: Floats, elevation_m: Floats, rows: list[PlantRow]) -> NDArray[np.bool_]:
    """(N, R) by the rules of rows on elevation, slope and water."""
    allowed = np.ones((len(ground_m), len(rows)), bool)
    slope = away_m = None
    for number, row in enumerate(rows):
        if row.elevation_m is not None:
            allowed[:, number] &= (elevation_m >= row.elevation_m[0]) & (elevation_m <= row.elevation_m[1])
        if row.max_slope_deg is not None:
            slope = sample_nearest(slope_deg(given.terrain), ground_m) if slope is None else slope
            allowed[:, number] &= slope <= row.max_slope_deg
        if row.water_m is not None:
            away_m = _from_water(given, ground_m) if away_m is None else away_m
            allowed[:, number] &= (away_m >= row.water_m[0]) & (away_m <= row.water_m[1])
    return allowed


def _from_water(given: ForestInput, ground_m: Floats) -> Floats:
    """(N,) how far from the nearest pixel of water, infinite where no raster shows any."""
    if given.vegetation is None:
        return np.full(len(ground_m), np.inf)
    water = np.isin(np.nan_to_num(given.vegetation.values, nan=-1.0).astype(np.int64), list(given.plants.water))
    if not water.any():
        return np.full(len(ground_m), np.inf)
    away_px = np.asarray(ndimage.distance_transform_edt(~water))
    raster = replace(given.vegetation, values=away_px * given.vegetation.cell_m)
    return np.asarray(sample_nearest(raster, ground_m), np.float64)


def _typical_radius(rows: list[PlantRow], kind: PlantKind) -> float:
    return float(sum(row.share * (row.form or FORMS[kind]) * sum(row.height_m) / 2 for row in rows))


def _together(
    parts: list[_Decided], refused: Mapping[str, int], empty: tuple[PlantKind, ...], settings: PlantingSettings
) -> Planting:
    """All plants in one order: trees, shrubs, grass, each as it was found."""

    def all_of(name: str, width: int = 0) -> Floats:
        none = np.zeros((0, width) if width else 0)
        return np.concatenate([none, *(getattr(part, name) for part in parts)])

    count = sum(len(part.row) for part in parts)
    rng = np.random.default_rng([settings.seed, TURN_SEED])
    jitter = np.random.default_rng([settings.seed, JITTER_SEED])
    return Planting(
        ground_m=all_of("ground_m", 2),
        elevation_m=all_of("elevation_m"),
        row=all_of("row").astype(np.int64),
        height_m=all_of("height_m"),
        radius_m=all_of("radius_m"),
        turn_deg=rng.uniform(0, 360, count),
        lean_deg=settings.lean_deg * rng.standard_normal((count, 2)),
        tint=all_of("tint", 3),
        jitter=jitter.random(count),
        seen=all_of("seen").astype(bool),
        not_planted=dict(refused),
        empty_kinds=empty,
    )
