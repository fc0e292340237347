"""Scans of many kinds of generated plants: to learn from, and to measure by."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from tools.synthetic.plant import PlantSettings, build_plant
from tools.synthetic.scan import WOOD, Scan, ScanSettings, scan_scene
from tools.synthetic.scene import SceneSettings, build_scene
from tools.synthetic.shoots import SPECIES, grow_shoots

BED, PLANT, TREE = "bed", "plant", "tree"  # besides the species of shoots
MAX_POINTS = 20_000  # of a scan to learn from
UNEVEN_M = 0.004  # of ground, in each of two waves
MAX_WOOD = 2.0  # times as many points on the wood of a tree as on its leaves


@dataclass(frozen=True, kw_only=True)
class ScannedPlant:
    """What stands there and how it is scanned."""

    name: str
    kind: str  # a species of shoots, BED, PLANT or TREE
    leaves: int
    points_a_leaf: float  # of those on leaves, about, with what hides
    scan: ScanSettings = field(default_factory=ScanSettings)
    size: float = 1.0  # of the leaves, to that of the species
    spread: float = 1.0  # of the leaves' lengths, to that of the species
    height_m: float = 1.4  # of plants and trees
    ground: float = 0.0  # points on rough ground around it, for one of its own
    seed: int = 0


def scan_plant(plant: ScannedPlant) -> Scan:
    """Grow a plant and scan it; the same plant gives the same scan."""
    vertices_m, triangles, leaf = _grow(plant)
    areas_m2 = np.linalg.norm(
        np.cross(
            vertices_m[triangles[:, 1]] - vertices_m[triangles[:, 0]],
            vertices_m[triangles[:, 2]] - vertices_m[triangles[:, 0]],
        ),
        axis=1,
    )
    count = int(leaf.max()) + 1
    # A closed surface of wood shows half of itself; of a leaf either side shows it all.
    wood = 0.5 * areas_m2[leaf < 0].sum() / max(areas_m2[leaf >= 0].sum(), 1e-30)
    points = plant.points_a_leaf * count * (1 + min(float(wood), MAX_WOOD))
    scan = scan_scene(vertices_m, triangles, leaf, replace(plant.scan, points=int(points), seed=plant.seed))
    return _on_ground(scan, plant) if plant.ground > 0 else scan


def _on_ground(scan: Scan, plant: ScannedPlant) -> Scan:
    """The scan with ground of twice its width below it: uneven by some millimetres, as rough as its points are."""
    rng = np.random.default_rng((plant.seed, 10))
    low_m, high_m = scan.points_m.min(axis=0), scan.points_m.max(axis=0)
    half_m = float(max(high_m[0] - low_m[0], high_m[2] - low_m[2]))
    count = round(plant.ground * len(scan.points_m))
    aside_m = rng.uniform(-half_m, half_m, (count, 2))
    waves = np.sin(2 * np.pi * aside_m / half_m + rng.uniform(0, 2 * np.pi, 2)).sum(axis=1)
    rise_m = UNEVEN_M * waves + plant.scan.noise_m * rng.normal(size=count)
    middle_m = (low_m + high_m) / 2
    ground_m = np.column_stack([middle_m[0] + aside_m[:, 0], low_m[1] - 0.02 + rise_m, middle_m[2] + aside_m[:, 1]])
    order = rng.permutation(len(scan.points_m) + count)
    return Scan(
        points_m=np.concatenate([scan.points_m, ground_m])[order],
        leaf=np.concatenate([scan.leaf, np.full(count, WOOD, np.int32)])[order],
    )


def list_training(seed: int, rounds: int) -> Sequence[ScannedPlant]:
    """Plants of every kind, with leaves, densities, noise, sides and clutter as they come."""
    rng = np.random.default_rng((seed, 8))
    plants = []
    for number in range(rounds):
        for kind in (*SPECIES, BED, PLANT, TREE):
            points_a_leaf = float(np.exp(rng.uniform(np.log(30), np.log(700))))
            size = float(np.exp(rng.uniform(-0.5, 0.5)))
            leaf_m = size * (SPECIES[kind].length_m if kind in SPECIES else 0.07)
            plants.append(
                ScannedPlant(
                    name=f"{kind}-{number}",
                    kind=kind,
                    leaves=int(np.clip(MAX_POINTS / points_a_leaf, 40, 160)),
                    points_a_leaf=points_a_leaf,
                    scan=ScanSettings(
                        stations=int(rng.integers(3, 9)),
                        one_sided=bool(rng.random() < 0.3),
                        noise_m=float(rng.choice([0.0005, 0.001, 0.0015, 0.002])) * min(1.0, leaf_m / 0.05),
                        clutter=float(rng.choice([0, 0, 0, 0.1, 1 / 3])) if kind != TREE else 0.0,
                    ),
                    size=size,
                    spread=float(rng.uniform(0.7, 1.7)),
                    height_m=float(rng.uniform(2, 6)) if kind == TREE else 1.4,
                    seed=int(rng.integers(1 << 30)),
                )
            )
    return plants


def _grow(plant: ScannedPlant) -> tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.int32]]:
    """Vertices (V, 3), triangles (F, 3) and the leaf of each (F,)."""
    if plant.kind == BED:
        bed = build_scene(
            SceneSettings(
                leaves=plant.leaves,
                views=1,
                wall=False,
                length_m=0.07 * plant.size,
                width=plant.spread,
                seed=plant.seed,
            )
        )
        return bed.points_m, bed.triangles, bed.leaf
    if plant.kind == PLANT:
        grown = build_plant(PlantSettings(leaves=plant.leaves, views=1, height_m=plant.height_m, seed=plant.seed)).scene
        return grown.points_m, grown.triangles, grown.leaf
    if plant.kind == TREE:
        return _hang_on_tree(plant)
    species = SPECIES[plant.kind]
    species = replace(species, length_m=species.length_m * plant.size, spread=species.spread * plant.spread)
    shoots = grow_shoots(species, plant.leaves, plant.seed)
    return shoots.vertices_m, shoots.triangles, shoots.leaf


def _hang_on_tree(plant: ScannedPlant) -> tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.int32]]:
    """Shoots amid the bare branches of a tree, whose wood is much larger than they are."""
    rng = np.random.default_rng((plant.seed, 9))
    tree = build_plant(PlantSettings(leaves=1, views=1, height_m=plant.height_m, seed=plant.seed)).scene
    wood = tree.triangles[tree.leaf < 0]
    kinds = list(SPECIES)
    species = SPECIES[kinds[int(rng.integers(len(kinds)))]]
    shoots = grow_shoots(replace(species, length_m=species.length_m * plant.size), plant.leaves, plant.seed)
    aside_m = plant.height_m * np.array([rng.uniform(-0.1, 0.1), 0.35, rng.uniform(-0.1, 0.1)])
    return (
        np.concatenate([tree.points_m, shoots.vertices_m + aside_m]),
        np.concatenate([wood, shoots.triangles + np.int32(len(tree.points_m))]),
        np.concatenate([np.full(len(wood), -1, np.int32), shoots.leaf]),
    )
