"""Scans of grown trees with their leaves: to learn how wood is distinguished from leaves, and to measure it."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from usdfoliage.branch.allometry import AllometrySettings
from usdfoliage.branch.foliage.place import FoliageSettings, LeafPlaces, place_leaves
from usdfoliage.branch.foliage.species import GENERIC, load_species
from usdfoliage.branch.growth.grow import grow_branches, seed_plants
from usdfoliage.branch.growth.logistic import LogisticSettings
from usdfoliage.branch.growth.settings import GrowthSettings
from usdfoliage.branch.model import Skeleton
from usdfoliage.geometry.directions import two_across

from tools.synthetic.scan import WOOD, Scan, ScanSettings, scan_scene
from tools.synthetic.scene import Tube, build_tubes

Array = NDArray[np.float64]

THIN, SIDES = 0.004, (12, 5)  # metres, radius below which tubes have fewer sides
PETIOLE_M = 0.0008  # radius
TWIGS_ON = 6.0  # radii of the thinnest twig, of branches with side twigs
TWIG_POINTS = 8
CROWNS = {  # half of their height and of their width, in heights of the tree
    "ball": (0.36, 0.3),
    "column": (0.42, 0.13),
    "cone": (0.42, 0.25),
    "umbrella": (0.2, 0.42),
}
BLADE = ((0.0, 0.0), (0.5, 0.28), (0.42, 0.62), (0.0, 1.0))  # half of an outline: across in widths, along in lengths


@dataclass(frozen=True, kw_only=True)
class LeafyTree:
    """What stands there and how it is scanned. Lengths in metres."""

    name: str
    height_m: float = 6.0
    crown: str = "ball"
    markers: int = 2500  # that branches grow to
    internode_of_height: float = 0.02
    branching_deg: float = 40.0
    exponent: float = 0.45
    droop: float = 1.0  # -1 where twigs turn up, 1 where they hang
    twig_m: float = 0.0008  # radius of the thinnest
    twig_step_m: float = 0.1  # from a side twig to the next on thin branches
    twig_length_m: float = 0.25
    leaf_m: float = 0.08
    leaf_width: float = 0.5
    leaf_step_m: float = 0.04  # from a leaf to the next on a twig
    petiole: float = 0.3  # of a blade's length
    droop_deg: float = 20.0
    leaves: int = 6000  # at most
    scan: ScanSettings = field(default_factory=ScanSettings)
    seed: int = 0

    def __post_init__(self) -> None:
        if self.crown not in CROWNS:
            raise ValueError(f"crown must be one of {', '.join(CROWNS)}, not {self.crown}")


def list_leafy_trees(seed: int, count: int) -> Sequence[LeafyTree]:
    """Trees of many forms, leaves and scans, as they come; every fifth has no leaves."""
    rng = np.random.default_rng((seed, 12))
    trees = []
    for number in range(count):
        height_m = float(np.exp(rng.uniform(np.log(3), np.log(14))))
        leaf_m = float(np.exp(rng.uniform(np.log(0.035), np.log(0.16))))
        trees.append(
            LeafyTree(
                name=f"tree-{number}",
                height_m=height_m,
                crown=list(CROWNS)[number % len(CROWNS)],
                markers=int(np.exp(rng.uniform(np.log(1500), np.log(12_000)))),
                internode_of_height=float(rng.uniform(0.006, 0.018)),
                branching_deg=float(rng.uniform(30, 60)),
                exponent=float(rng.uniform(0.4, 0.55)),
                droop=float(rng.uniform(-1, 1)),
                twig_m=float(np.exp(rng.uniform(np.log(0.0006), np.log(0.0025)))),
                twig_step_m=float(np.exp(rng.uniform(np.log(0.05), np.log(0.4)))),
                twig_length_m=float(rng.uniform(0.1, 0.45)),
                leaf_m=leaf_m,
                leaf_width=float(rng.uniform(0.25, 1.0)),
                leaf_step_m=float(leaf_m * rng.uniform(0.3, 0.9)),
                petiole=float(rng.uniform(0.02, 0.6)),
                droop_deg=float(rng.uniform(0, 60)),
                leaves=0 if number % 5 == 4 else int(np.exp(rng.uniform(np.log(1500), np.log(15000)))),
                scan=ScanSettings(
                    points=int(np.exp(rng.uniform(np.log(40_000), np.log(200_000)))),
                    stations=int(rng.integers(3, 7)),
                    noise_m=float(rng.choice([0.001, 0.002, 0.003, 0.005])),
                ),
                seed=int(rng.integers(1 << 30)),
            )
        )
    return trees


def scan_leafy_tree(tree: LeafyTree) -> tuple[Scan, Skeleton]:
    """The scan, Y up, and the skeleton that it is of; the same tree gives the same scan."""
    rng = np.random.default_rng((tree.seed, 13))
    skeleton = _add_twigs(tree, _grow(tree, rng), rng)
    wood = [
        Tube(points_m=skeleton.points_m[skeleton.branch(k)], radius_m=skeleton.radius_m[skeleton.branch(k)])
        for k in range(len(skeleton))
    ]
    thin = [tube for tube in wood if tube.radius_m[0] < THIN]
    thick = [tube for tube in wood if tube.radius_m[0] >= THIN]
    parts = []
    places = _place(tree, skeleton, rng) if tree.leaves else None
    if places is not None:
        stalk_m = tree.petiole * places.length_m
        apart_m = Rotation.from_quat(places.orientation).apply([0.0, 1.0, 0.0]) * stalk_m[:, None]
        ends = np.stack([places.base_m, places.base_m + apart_m], axis=1)
        thin += [Tube(points_m=pair, radius_m=np.full(2, PETIOLE_M)) for pair in ends]
        parts.append(_blades(tree, places, ends[:, 1]))
    for tubes, sides in ((thick, SIDES[0]), (thin, SIDES[1])):
        if tubes:
            points_m, _, triangles = build_tubes(tubes, sides)
            parts.append((points_m, triangles, np.full(len(triangles), WOOD, np.int32)))
    begin = np.cumsum([0, *[len(part[0]) for part in parts]])
    scan = scan_scene(
        np.concatenate([part[0] for part in parts]),
        np.concatenate([part[1] + start for part, start in zip(parts, begin[:-1], strict=True)]),
        np.concatenate([part[2] for part in parts]),
        replace(tree.scan, seed=tree.seed),
    )
    return scan, skeleton


def _grow(tree: LeafyTree, rng: np.random.Generator) -> Skeleton:
    points = rng.normal(size=(tree.markers, 3))
    points *= (rng.random(tree.markers) ** (1 / 3) / np.linalg.norm(points, axis=1))[:, None]
    half, wide = CROWNS[tree.crown]
    if tree.crown == "cone":
        points[:, [0, 2]] *= (0.5 * (1.15 - points[:, 1]))[:, None]
    middle = 1 - half - 0.02
    markers = points * [wide, half, wide] + [0, middle, 0]
    trunk = np.linspace([0, 0, 0], [0, middle, 0], 60)
    internode_m = tree.internode_of_height * tree.height_m
    settings = GrowthSettings(
        internode_m=internode_m,
        branching_deg=tree.branching_deg,
        tropism=0.3 * abs(tree.droop),
        tropism_direction=(0.0, -float(np.sign(tree.droop)), 0.0),
        allometry=AllometrySettings(exponent=tree.exponent),
        logistic=LogisticSettings(longest=1 / tree.internode_of_height),
        min_radius_m=tree.twig_m,
    )
    root = seed_plants(np.zeros((1, 3)), internode_m, 0.015 * tree.height_m)
    cloud_m = tree.height_m * np.concatenate([trunk, markers])
    return grow_branches(root, cloud_m, np.ones(len(cloud_m)), settings, tree.seed).skeleton


def _add_twigs(tree: LeafyTree, skeleton: Skeleton, rng: np.random.Generator) -> Skeleton:
    """The skeleton with side twigs on all that is thin, in a spiral."""
    points, radii, parents, vertices = [], [], [], []
    for curve in range(len(skeleton)):
        own = np.arange(skeleton.first[curve], skeleton.first[curve] + skeleton.counts[curve])
        if len(own) < 3:
            continue
        arc_m, along = skeleton.arcs_m[own], np.gradient(skeleton.points_m[own], axis=0)
        at = rng.uniform(0, tree.twig_step_m)
        roll = rng.uniform(0, 2 * np.pi)
        while at < arc_m[-1]:
            k = min(int(np.searchsorted(arc_m, at)), len(own) - 2)
            at += tree.twig_step_m * np.exp(rng.normal(0, 0.2))
            roll += np.radians(137.5)
            if k <= 0 or skeleton.radius_m[own[k]] > TWIGS_ON * tree.twig_m:
                continue
            forward = along[k] / max(float(np.linalg.norm(along[k])), 1e-12)
            side, other = (each[0] for each in two_across(forward[None]))
            across = np.cos(roll) * side + np.sin(roll) * other
            angle = np.radians(tree.branching_deg) * np.exp(rng.normal(0, 0.15))
            start = np.cos(angle) * forward + np.sin(angle) * across
            turned = start + [0, -0.5 * tree.droop, 0] + 0.3 * rng.normal(size=3)
            share = np.linspace(0, 1, TWIG_POINTS)[:, None]
            length_m = tree.twig_length_m * np.exp(rng.normal(0, 0.4))
            path = length_m * (share * start + 0.5 * share**2 * (turned - start))
            points.append(skeleton.points_m[own[k]] + path)
            radii.append(np.full(TWIG_POINTS, tree.twig_m) * (1.3 - 0.3 * share[:, 0]))
            parents.append(curve)
            vertices.append(own[k])
    if not points:
        return skeleton
    return Skeleton(
        points_m=np.concatenate([skeleton.points_m, *points]),
        radius_m=np.concatenate([skeleton.radius_m, *radii]),
        counts=np.concatenate([skeleton.counts, np.full(len(points), TWIG_POINTS)]).astype(np.int32),
        parent_curve=np.concatenate([skeleton.parent_curve, parents]).astype(np.int32),
        parent_vertex=np.concatenate([skeleton.parent_vertex, vertices]).astype(np.int32),
        order=np.concatenate([skeleton.order, skeleton.order[np.array(parents)] + 1]).astype(np.int32),
    )


def _place(tree: LeafyTree, skeleton: Skeleton, rng: np.random.Generator) -> LeafPlaces:
    species = replace(
        load_species(GENERIC),
        internode_m=tree.leaf_step_m,
        leaf_length_m=tree.leaf_m,
        leaf_width=tree.leaf_width,
        droop_rad=np.radians(tree.droop_deg),
        twig_radius_m=3 * tree.twig_m,
        shoot_m=0.5,
    )
    return place_leaves(skeleton, species, rng, FoliageSettings(max_leaves=tree.leaves))


def _blades(tree: LeafyTree, places: LeafPlaces, base_m: Array) -> tuple[Array, NDArray[np.int64], NDArray[np.int32]]:
    """Folded blades: vertices (V, 3), triangles (F, 3), number of the leaf (F,)."""
    outline = np.array(BLADE)
    fold = 0.3
    right = np.column_stack([tree.leaf_width * outline[:, 0], outline[:, 1], fold * tree.leaf_width * outline[:, 0]])
    one = np.concatenate([right, right[1:3] * [-1, 1, 1], [[0, 0.5, 0]]])
    ring = [0, 1, 2, 3, 5, 4]
    fan = np.array([(6, ring[k], ring[(k + 1) % 6]) for k in range(6)])
    turn = Rotation.from_quat(places.orientation).as_matrix()
    blades_m = np.einsum("nij,kj->nki", turn, one) * places.length_m[:, None, None]
    vertices_m = (blades_m + base_m[:, None]).reshape(-1, 3)
    triangles = (fan[None] + 7 * np.arange(len(places))[:, None, None]).reshape(-1, 3)
    return vertices_m, triangles, np.repeat(np.arange(len(places), dtype=np.int32), 6)
