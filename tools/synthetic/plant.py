"""A young tree that stands alone: its skeleton, its leaves, and the cameras around it.

Y up, its foot at the origin, the ground at y = 0.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from usdfoliage.branch.foliage.place import FoliageSettings, place_leaves
from usdfoliage.branch.foliage.species import GENERIC, Species, load_species
from usdfoliage.branch.model import Skeleton
from usdfoliage.geometry.directions import unit_vectors
from usdfoliage.geometry.pinhole import Pinhole, look_at
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.jitter import spread_phases
from usdfoliage.leaf.shape.mesh import LeafMeshSettings, build_leaf_mesh
from usdfoliage.leaf.shape.spray import GOLDEN_ANGLE_RAD
from usdfoliage.leaf.shape.topology import leaf_topology
from usdfoliage.leaf.shape.variation import vary_colors, vary_leaves

from tools.synthetic.scene import (
    GREEN,
    PETIOLE,
    UP,
    Bark,
    Scene,
    Tube,
    build_tubes,
    stand_free,
    triangulate,
)

Array = NDArray[np.float64]

# Lengths in plant heights.
STEP = 0.012  # between the vertices of an axis
STEM, STEM_RADIUS = 0.9, (0.017, 0.0045)
LIMBS, LIMBS_FROM = 11, (0.27, 0.93)  # along the stem
LIMB_LENGTH = (0.42, 0.2)  # the lowest, the highest
TWIGS_A_LIMB, TWIGS_FROM = 4, (0.28, 0.82)
TWIG_LENGTH = 0.8  # of what the limb has beyond it
OF_PARENT = 0.62  # radius of a branch at its base, to its parent's there
TIP_RADIUS = 0.0022
LEAF_LENGTH, INTERNODE, SHOOT = 0.078, 0.03, 0.3
DROOP_RAD = 0.85  # blades that hang face outwards, to the cameras
PETIOLE_RADIUS = 0.0011
SIDES = 14
HALVINGS = 24  # of the way in which the cameras' distance is looked for
MESH = LeafMeshSettings(across=6, along=12, silhouette=24)
GREY_BROWN = (0.16, 0.115, 0.075)  # linear
GRAIN = 0.0009
FOCAL = 1.15  # in the picture's longer side
ELEVATIONS_RAD = (0.2, 0.6)
MARGIN = 0.04  # of a picture's sides, around the plant


@dataclass(frozen=True, kw_only=True)
class PlantSettings:
    """What is grown, and from where it is seen."""

    height_m: float = 1.4
    leaves: int = 240  # at most: leaves that cross others are left out
    views: int = 24
    width_px: int = 480
    height_px: int = 640
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("leaves", "views", "width_px", "height_px"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be 1 or more, not {getattr(self, name)}")
        if not (np.isfinite(self.height_m) and self.height_m > 0):
            raise ValueError(f"height_m must be above 0, not {self.height_m}")


@dataclass(frozen=True, kw_only=True, eq=False)
class Plant:
    """What stands there; the triangles of the scene are those of the leaves, then those of the wood."""

    skeleton: Skeleton
    branch: NDArray[np.int32]  # (N,), that each leaf stands on
    scene: Scene


def build_plant(settings: PlantSettings) -> Plant:
    """Grow the plant and place the cameras; the same settings give the same plant."""
    rng = np.random.default_rng((settings.seed, 4))
    skeleton = grow_skeleton(settings.height_m, rng)
    leaves, branch, petioles = _grow_leaves(skeleton, settings, rng)
    wood = [
        Tube(points_m=skeleton.points_m[skeleton.branch(k)], radius_m=skeleton.radius_m[skeleton.branch(k)])
        for k in range(len(skeleton))
    ]
    wood_points, wood_normals, wood_triangles = build_tubes([*wood, *petioles], SIDES)
    mesh = build_leaf_mesh(leaves, MESH)
    topology = leaf_topology(MESH.across, MESH.along, MESH.silhouette or 0)
    one_leaf = triangulate(topology.face_counts, topology.face_vertices)
    count, vertices = len(leaves), topology.vertex_count
    of_leaves = (one_leaf[None] + vertices * np.arange(count, dtype=np.int32)[:, None, None]).reshape(-1, 3)
    points_m = np.concatenate([mesh.points_m.astype(np.float64), wood_points])
    scene = Scene(
        leaves=leaves,
        points_m=points_m,
        normals=np.concatenate([mesh.normals.astype(np.float64), wood_normals]),
        uv=np.concatenate([np.tile(topology.uv, (count, 1)), np.zeros((len(wood_points), 2))]),
        triangles=np.concatenate([of_leaves, wood_triangles + np.int32(count * vertices)]),
        leaf=np.concatenate(
            [np.repeat(np.arange(count, dtype=np.int32), len(one_leaf)), np.full(len(wood_triangles), -1, np.int32)]
        ),
        vertices_a_leaf=vertices,
        triangles_a_leaf=len(one_leaf),
        wall_z_m=None,
        cameras=_stand_around(points_m, settings),
        bark=Bark(color=GREY_BROWN, grain_m=GRAIN * settings.height_m, contrast=0.55),
    )
    return Plant(skeleton=skeleton, branch=branch, scene=scene)


def grow_skeleton(height_m: float, rng: np.random.Generator) -> Skeleton:
    """A stem, limbs around it in a spiral, and twigs to both sides of each limb: orders 0, 1 and 2."""
    axes = [_Axis(points=_bend(np.zeros(3), UP, UP, STEM, 0.012, rng), radius=STEM_RADIUS, parent=-1, vertex=-1)]
    turn = rng.uniform(0, 2 * np.pi)
    for k in range(LIMBS):
        share = k / (LIMBS - 1)
        at = LIMBS_FROM[0] + share * (LIMBS_FROM[1] - LIMBS_FROM[0])
        turn += GOLDEN_ANGLE_RAD + rng.normal(0, 0.15)
        rise = 0.55 + 0.5 * share + rng.normal(0, 0.06)  # tangent of the angle over the level
        level = np.array([np.cos(turn), 0.0, np.sin(turn)])
        length = (LIMB_LENGTH[0] + share * (LIMB_LENGTH[1] - LIMB_LENGTH[0])) * np.exp(rng.normal(0, 0.08))
        axes.append(_branch_off(axes, 0, at, level + rise * UP, level + (rise + 0.7) * UP, length, rng))
    for limb in range(1, 1 + LIMBS):
        points = axes[limb].points
        length = STEP * (len(points) - 1)
        for k in range(TWIGS_A_LIMB):
            at = TWIGS_FROM[0] + k / max(TWIGS_A_LIMB - 1, 1) * (TWIGS_FROM[1] - TWIGS_FROM[0]) + rng.normal(0, 0.02)
            along = points[-1] - points[0]
            side = unit_vectors(np.cross(along, UP)) * (1 if (k + limb) % 2 else -1)
            start = unit_vectors(along) + 0.95 * side + rng.normal(0, 0.12, 3)
            twig = TWIG_LENGTH * max(length * (1 - at), 0.3 * length) * np.exp(rng.normal(0, 0.08))
            axes.append(_branch_off(axes, limb, at, start, start + 0.5 * UP, twig, rng))
    counts = np.array([len(axis.points) for axis in axes], np.int32)
    first = np.cumsum(counts) - counts
    parent = np.array([axis.parent for axis in axes], np.int32)
    return Skeleton(
        points_m=height_m * np.concatenate([axis.points for axis in axes]),
        radius_m=height_m * np.concatenate([axis.radii() for axis in axes]),
        counts=counts,
        parent_curve=parent,
        parent_vertex=np.array(
            [-1 if axis.parent < 0 else first[axis.parent] + axis.vertex for axis in axes], np.int32
        ),
        order=np.array([0, *[1] * LIMBS, *[2] * (len(axes) - 1 - LIMBS)], np.int32),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Axis:
    """In plant heights."""

    points: Array  # (K, 3)
    radius: tuple[float, float]  # at its base, at its tip
    parent: int
    vertex: int  # of the parent

    def radii(self) -> Array:
        return self.radius[0] + (self.radius[1] - self.radius[0]) * np.linspace(0, 1, len(self.points)) ** 0.85


def _branch_off(
    axes: Sequence[_Axis], parent: int, at: float, start: Array, end: Array, length: float, rng: np.random.Generator
) -> _Axis:
    holder = axes[parent]
    vertex = int(np.clip(round(at * (len(holder.points) - 1)), 1, len(holder.points) - 2))
    base = OF_PARENT * float(holder.radii()[vertex])
    return _Axis(
        points=_bend(holder.points[vertex], start, end, length, 0.01, rng),
        radius=(max(base, TIP_RADIUS * 1.3), TIP_RADIUS),
        parent=parent,
        vertex=vertex,
    )


def _bend(base: Array, start: Array, end: Array, length: float, sway: float, rng: np.random.Generator) -> Array:
    """An axis (K, 3) from its base that turns from one direction to another, with a slow sway on the way."""
    count = max(2, round(length / STEP))
    share = (np.arange(count) + 0.5)[:, None] / count
    along = unit_vectors(unit_vectors(start) * (1 - share) + unit_vectors(end) * share)
    wave = rng.normal(0, 1, (2, 3))
    # Slopes of the sway, that of its beginning 0: a branch leaves its parent where it should.
    slope = sway / length * (wave[0] * np.sin(2 * np.pi * share) + 2 * wave[1] * np.sin(4 * np.pi * share))
    steps = unit_vectors(along + np.pi * slope) * STEP
    return np.concatenate([base[None], base + np.cumsum(steps, axis=0)])


def _species(height_m: float) -> Species:
    return replace(
        load_species(GENERIC),
        internode_m=INTERNODE * height_m,
        leaf_length_m=LEAF_LENGTH * height_m,
        droop_rad=DROOP_RAD,
        twig_radius_m=0.0062 * height_m,
        shoot_m=SHOOT * height_m,
    )


def _grow_leaves(
    skeleton: Skeleton, settings: PlantSettings, rng: np.random.Generator
) -> tuple[Leaves, NDArray[np.int32], list[Tube]]:
    """Leaves that stand free of each other, evenly over the plant, the branch of each, and their petioles."""
    places = place_leaves(skeleton, _species(settings.height_m), rng, FoliageSettings(of_root=0.0))
    along = Rotation.from_quat(places.orientation).as_matrix()[:, :, 1]
    stalk_m = PETIOLE * places.length_m[:, None] * along
    leaves = Leaves(
        parameters=vary_leaves(len(places), rng),
        base_m=places.base_m + stalk_m,
        orientation=places.orientation,
        length_m=places.length_m,
        phase=spread_phases(len(places)),
        color=vary_colors(GREEN, len(places), rng),
    )
    free = np.flatnonzero(stand_free(leaves, LEAF_LENGTH * settings.height_m))
    count = min(settings.leaves, len(free))
    chosen = free[np.arange(count) * len(free) // max(count, 1)]
    radius = np.full(2, PETIOLE_RADIUS * settings.height_m)
    petioles = [Tube(points_m=np.stack([places.base_m[k], leaves.base_m[k]]), radius_m=radius) for k in chosen.tolist()]
    return replace(leaves.take(chosen), phase=spread_phases(count)), places.branch[chosen], petioles


def _stand_around(points_m: Array, settings: PlantSettings) -> list[Pinhole]:
    """Cameras all around, low and high by turns, as far away as the plant needs to be seen whole."""
    size = settings.width_px, settings.height_px
    focal_px = FOCAL * max(size)
    middle_m = (points_m[:, 1].min() + points_m[:, 1].max()) / 2
    target = np.array([0.0, middle_m, 0.0])
    near_m, far_m = 0.0, 100 * float(np.linalg.norm(points_m - target, axis=1).max())
    for _ in range(HALVINGS):
        distance_m = (near_m + far_m) / 2
        cameras = [look_at(target + distance_m * away, target, focal_px, size) for away in _directions(settings.views)]
        if all(_frames(camera, points_m) for camera in cameras):
            far_m = distance_m
        else:
            near_m = distance_m
    return [look_at(target + far_m * away, target, focal_px, size) for away in _directions(settings.views)]


def _directions(views: int) -> list[Array]:
    """Unit vectors (3,) to cameras from what they look at."""
    azimuth = 2 * np.pi * np.arange(views) / views
    elevation = np.resize(ELEVATIONS_RAD, views)
    level = np.cos(elevation)
    return list(np.column_stack([np.sin(azimuth) * level, np.sin(elevation), np.cos(azimuth) * level]))


def _frames(camera: Pinhole, points_m: Array) -> bool:
    places, depth_m = camera.project(points_m)
    size = np.array([camera.width_px, camera.height_px])
    inside = (places >= MARGIN * size) & (places <= (1 - MARGIN) * size)  # false for NaN, behind the camera
    return bool((depth_m > 0).all() and inside.all())
