"""A bed of leafy shoots before a wall, and the cameras that look at it.

Y up, the ground at y = 0, the wall behind the bed, at z below 0, cameras before it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from usdfoliage.geometry.pinhole import Pinhole, look_at
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.jitter import spread_phases
from usdfoliage.leaf.shape.mesh import LeafMeshSettings, build_leaf_mesh
from usdfoliage.leaf.shape.spray import GOLDEN_ANGLE_RAD, SpraySettings, scatter_spray
from usdfoliage.leaf.shape.surface import evaluate_points, grid_places
from usdfoliage.leaf.shape.topology import leaf_topology
from usdfoliage.leaf.shape.variation import VariationSettings, vary_colors

Array = NDArray[np.float64]

LEAVES_A_SHOOT = (8, 18)
INTERNODE = 0.34  # in leaf lengths
LEAVES_AN_AREA = 3.6  # on the ground, in leaf lengths
BED_ASPECT = 2.4  # width to depth, of what one camera frames
SHOOT_HEIGHT = 5.0  # about, in leaf lengths
PETIOLE, PETIOLE_RADIUS, TWIG_RADIUS = 0.14, 0.011, (0.034, 0.012)  # in leaf lengths
APART = 0.03  # leaves that come nearer to each other, in leaf lengths, do not both stand
SIDES = 6  # of a tube
SIZES = (0.35, 1.8)  # of the typical length, between which leaves of other sizes lie
GREEN = (0.05, 0.125, 0.025)  # linear
MESH = LeafMeshSettings(across=8, along=16, silhouette=32)
FOCAL = 0.95  # in picture widths
ARC_RAD, ELEVATIONS_RAD = 0.6, (0.35, 0.65)
UP = np.array([0.0, 1.0, 0.0])


@dataclass(frozen=True, kw_only=True)
class SceneSettings:
    """What is grown, and from where it is seen."""

    leaves: int = 400
    views: int = 10
    width_px: int = 1200
    height_px: int = 900
    length_m: float = 0.07  # of a leaf, on average
    width: float = 1.0  # of leaves, to that of the default leaf, which is half as wide as long
    variation: float = 1.0  # how much leaves differ and bend: 0 all equal, 1 as on a plant
    sizes: float = 0.0  # standard deviation of the logarithm of lengths, beyond how leaves differ anyway
    relief: float = 0.0  # how far leaves lie off the model of 21 numbers, by waves, ribs and teeth; 1 as on a plant
    framed_leaves: int = 400  # about how many of them a view shows; more leaves make the bed longer
    wall: bool = True
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("leaves", "views", "width_px", "height_px", "framed_leaves"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be 1 or more, not {getattr(self, name)}")
        for name in ("relief", "sizes"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) >= 0):
                raise ValueError(f"{name} must be 0 or more, not {getattr(self, name)}")
        for name in ("length_m", "width"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise ValueError(f"{name} must be above 0, not {getattr(self, name)}")
        VariationSettings(amount=self.variation)


@dataclass(frozen=True, kw_only=True)
class Bark:
    """What wood looks like from near."""

    color: tuple[float, float, float]  # linear
    grain_m: float  # of its finest furrows
    contrast: float  # standard deviation of the logarithm to 2


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """Triangles: those of the leaves, leaf after leaf, then those of twigs and petioles."""

    leaves: Leaves  # Y up, with colours
    points_m: Array  # (V, 3)
    normals: Array  # (V, 3), unit, of leaves' upper side
    uv: Array  # (V, 2), 0 on wood
    triangles: NDArray[np.int32]  # (F, 3)
    leaf: NDArray[np.int32]  # (F,), number of the leaf, -1 for wood
    vertices_a_leaf: int
    triangles_a_leaf: int
    wall_z_m: float | None
    cameras: Sequence[Pinhole]
    bark: Bark | None = None  # None: plain and dark


def build_scene(settings: SceneSettings) -> Scene:
    """Grow the bed and place the cameras; the same settings give the same scene."""
    rng = np.random.default_rng(settings.seed)
    area = settings.length_m**2 / LEAVES_AN_AREA
    depth_m = (min(settings.leaves, settings.framed_leaves) * area / BED_ASPECT) ** 0.5
    width_m = settings.leaves * area / depth_m
    leaves, twigs = _grow_bed(settings, width_m, depth_m, rng)
    leaves = replace(leaves, color=vary_colors(GREEN, len(leaves), rng))
    mesh = build_leaf_mesh(leaves, MESH)
    topology = leaf_topology(MESH.across, MESH.along, MESH.silhouette or 0)
    one_leaf = triangulate(topology.face_counts, topology.face_vertices)
    count, vertices = len(leaves), topology.vertex_count
    of_leaves = (one_leaf[None] + vertices * np.arange(count, dtype=np.int32)[:, None, None]).reshape(-1, 3)
    wood_points, wood_normals, wood_triangles = build_tubes(twigs)
    blades_m = mesh.points_m.astype(np.float64)
    if settings.relief > 0:
        normals = mesh.normals.reshape(count, vertices, 3).astype(np.float64)
        blades_m = add_relief(leaves, blades_m.reshape(count, vertices, 3), normals, topology.uv, settings.relief, rng)
    points_m = np.concatenate([blades_m.reshape(-1, 3), wood_points])
    return Scene(
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
        wall_z_m=float(points_m[:, 2].min()) - settings.length_m if settings.wall else None,
        cameras=_place_cameras(settings, width_m, depth_m),
    )


def add_relief(
    leaves: Leaves, points_m: Array, normals: Array, uv: Array, amount: float, rng: np.random.Generator
) -> Array:
    """Points (N, V, 3) of leaves with what a real blade has and the model has not; base and apex stay.

    Args:
        leaves: N.
        points_m: (N, V, 3), of their surfaces.
        normals: (N, V, 3), unit.
        uv: (V, 2), places of the points, -1 to 1 across and 0 to 1 along.
        amount: 1 as on a plant: margins wave by 3 %, ribs rise by 0.8 % of the length, teeth reach 6 % of the width.
        rng: For phases and numbers of waves.
    """
    u, v = uv[None, :, 0], uv[None, :, 1]
    count, ends = len(leaves), np.sin(np.pi * v)
    phase, waves = rng.uniform(0, 2 * np.pi, (2, count, 1)), rng.uniform(1.0, 3.0, (count, 1))
    side = np.where(u < 0, phase[0], phase[1])  # the margins wave each for itself
    margin = 0.03 * u**2 * np.sin(2 * np.pi * waves * v + side)
    ribs = 0.008 * np.cos(2 * np.pi * (7 * v - 1.5 * np.abs(u))) * (1 - u**2)
    height_m = amount * leaves.length_m[:, None] * ends * (margin + ribs)
    teeth = rng.integers(6, 14, (count, 1))
    inwards = amount * 0.06 * np.abs(u) ** 8 * ((teeth * v) % 1.0) * ends  # share of the way from margin to axis
    across = points_m - _axis_points(leaves, uv[:, 1])
    return points_m - inwards[..., None] * across + height_m[..., None] * normals


def _axis_points(leaves: Leaves, v: Array) -> Array:
    """(N, V, 3), the points of the axes at these v."""
    places = np.stack([np.zeros_like(v), v], axis=1)
    return evaluate_points(leaves.parameters, places, placements=leaves.asset_from_leaf())


@dataclass(frozen=True, kw_only=True, eq=False)
class Tube:
    """A piece of wood."""

    points_m: Array  # (K, 3)
    radius_m: Array  # (K,)


def _grow_bed(
    settings: SceneSettings, width_m: float, depth_m: float, rng: np.random.Generator
) -> tuple[Leaves, list[Tube]]:
    """Shoots until enough leaves stand free of each other; every prefix of the shoots is even on the bed."""
    shoots: list[Leaves] = []
    stems: list[Array] = []
    start = rng.random(2)
    while True:
        grown = sum(map(len, shoots))
        wanted = max(int(1.3 * settings.leaves), settings.leaves + LEAVES_A_SHOOT[0])
        wanted = wanted if not grown else grown + max(settings.leaves // 4, 1)
        while grown < wanted:
            place = np.modf(start + len(shoots) * np.array([0.7548776662466927, 0.5698402909980532]))[0] - 0.5
            shoot, stem = _grow_shoot(settings, place * (width_m, depth_m), rng)
            shoots.append(shoot)
            stems.append(stem)
            grown += len(shoot)
        everything = _join(shoots)
        free = np.flatnonzero(stand_free(everything, settings.length_m))[: settings.leaves]
        if len(free) == settings.leaves:
            break
    last = int(np.searchsorted(np.cumsum([len(shoot) for shoot in shoots]), free[-1], side="right"))
    chosen = everything.take(free)
    rank = np.concatenate([np.arange(len(shoot)) for shoot in shoots])[free]
    shoot_of = np.repeat(np.arange(len(shoots)), [len(shoot) for shoot in shoots])[free]
    nodes = np.array([stems[shoot][node + 1] for shoot, node in zip(shoot_of, rank, strict=True)])
    tubes = [
        Tube(points_m=stem, radius_m=settings.length_m * np.linspace(*TWIG_RADIUS, len(stem)))
        for stem in stems[: last + 1]
    ]
    radius = np.full(2, settings.length_m * PETIOLE_RADIUS)
    tubes += [
        Tube(points_m=np.stack([node, base]), radius_m=radius) for node, base in zip(nodes, chosen.base_m, strict=True)
    ]
    return replace(chosen, phase=spread_phases(len(chosen))), tubes


def _grow_shoot(settings: SceneSettings, place_m: Array, rng: np.random.Generator) -> tuple[Leaves, Array]:
    """A shoot at place_m (2,), x and z, on the ground: its leaves, and its stem (K, 3) from root over their nodes."""
    count = int(rng.integers(*LEAVES_A_SHOOT, endpoint=True))
    tilt = Rotation.from_rotvec(np.array([rng.normal(0, 0.12), 0, rng.normal(0, 0.2)]))
    turn = tilt * Rotation.from_euler("y", rng.uniform(0, 2 * np.pi))
    light = turn.inv().apply([0.0, 0.9, 0.6])
    spray = scatter_spray(
        count,
        rng,
        SpraySettings(
            length_m=settings.length_m,
            leaves_per_twig=count,
            internode=INTERNODE,
            divergence_rad=GOLDEN_ANGLE_RAD,
            light=(float(light[0]), float(light[1]), float(light[2])),
            variation=VariationSettings(amount=settings.variation),
        ),
    )
    if settings.sizes > 0:
        factor = np.exp(np.clip(rng.normal(0, settings.sizes, count), *np.log(SIZES)))
        spray = replace(spray, length_m=spray.length_m * factor)
    parameters = spray.parameters.copy()
    parameters[:, 2:5, 1] *= settings.width
    root = np.array([place_m[0], 0.0, place_m[1]])
    stem = np.concatenate([root[None], turn.apply(spray.base_m) + root])
    orientation = turn * Rotation.from_quat(spray.orientation)
    along = orientation.as_matrix()[:, :, 1]
    leaves = replace(
        spray,
        parameters=parameters,
        base_m=stem[1:] + PETIOLE * spray.length_m[:, None] * along,
        orientation=orientation.as_quat(canonical=True),
    )
    return leaves, stem


def _join(parts: Sequence[Leaves]) -> Leaves:
    names = ("parameters", "base_m", "orientation", "length_m", "phase")
    return Leaves(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def stand_free(leaves: Leaves, length_m: float) -> NDArray[np.bool_]:
    """Which leaves stand above the ground and apart from all before them that do: (N,)."""
    places = grid_places(np.linspace(-1, 1, 9), np.linspace(0.04, 1, 13))
    points = evaluate_points(leaves.parameters, places, placements=leaves.asset_from_leaf())
    free = points[..., 1].min(axis=1) > APART * length_m
    leaf = np.repeat(np.arange(len(leaves)), points.shape[1])
    # Points are some 0.08 lengths apart, so that blades that cross each other are found by 0.06.
    pairs = cKDTree(points.reshape(-1, 3)).query_pairs(2 * APART * length_m, output_type="ndarray")
    pairs = np.sort(leaf[pairs], axis=1)
    for first, second in np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0)[:, :2]:
        if free[first]:
            free[second] = False
    return free


def _place_cameras(settings: SceneSettings, width_m: float, depth_m: float) -> list[Pinhole]:
    """Cameras on arcs before the bed; a bed longer than a view frames has several arcs beside each other."""
    arcs = max(1, round(settings.leaves / settings.framed_leaves))
    arcs = min(arcs, settings.views)
    focal_px = FOCAL * settings.width_px
    height_m = SHOOT_HEIGHT * settings.length_m
    framed_m = width_m / arcs + 2 * settings.length_m
    distance_m = focal_px * max(framed_m / settings.width_px, (height_m + depth_m / 2) / settings.height_px)
    distance_m += depth_m / 2
    cameras = []
    for view in range(settings.views):
        arc = view * arcs // settings.views
        members = [other for other in range(settings.views) if other * arcs // settings.views == arc]
        share = (view - members[0]) / (len(members) - 1) * 2 - 1 if len(members) > 1 else 0.0
        azimuth, elevation = share * ARC_RAD, ELEVATIONS_RAD[view % len(ELEVATIONS_RAD)]
        target = np.array([((arc + 0.5) / arcs - 0.5) * width_m, 0.42 * height_m, 0.0])
        away = np.array([np.sin(azimuth) * np.cos(elevation), np.sin(elevation), np.cos(azimuth) * np.cos(elevation)])
        cameras.append(look_at(target + distance_m * away, target, focal_px, (settings.width_px, settings.height_px)))
    return cameras


def triangulate(counts: NDArray[np.int32], vertices: NDArray[np.int32]) -> NDArray[np.int32]:
    """Fans (F, 3) of convex faces."""
    starts = np.cumsum(counts) - counts
    fans = [
        (vertices[start], vertices[start + k], vertices[start + k + 1])
        for start, count in zip(starts, counts, strict=True)
        for k in range(1, count - 1)
    ]
    return np.array(fans, np.int32)


def build_tubes(tubes: Sequence[Tube], sides: int = SIDES) -> tuple[Array, Array, NDArray[np.int32]]:
    """Points, normals (V, 3) and triangles (F, 3) of tubes, open at their ends."""
    turn = np.arange(sides) / sides * 2 * np.pi
    points, normals, triangles, begin = [], [], [], 0
    for tube in tubes:
        along = np.gradient(tube.points_m, axis=0)
        along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
        first = np.cross(along, np.eye(3)[np.argmin(np.abs(along).max(axis=0))])
        first /= np.maximum(np.linalg.norm(first, axis=1, keepdims=True), 1e-12)
        second = np.cross(along, first)
        out = np.cos(turn)[:, None] * first[:, None] + np.sin(turn)[:, None] * second[:, None]  # (K, sides, 3)
        points.append((tube.points_m[:, None] + tube.radius_m[:, None, None] * out).reshape(-1, 3))
        normals.append(out.reshape(-1, 3))
        ring = np.arange(sides)
        low = begin + sides * np.arange(len(tube.points_m) - 1)[:, None]
        a, b = low + ring, low + (ring + 1) % sides
        triangles.append(np.stack([a, b, b + sides, a, b + sides, a + sides], axis=-1).reshape(-1, 3))
        begin += len(points[-1])
    return np.concatenate(points), np.concatenate(normals), np.concatenate(triangles).astype(np.int32)
