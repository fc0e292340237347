"""Leafy shoots whose leaves are no Bézier surfaces: outlines of several kinds, folded, bent, twisted and wavy.

What the pipeline's own model draws, it also fits; these leaves are made otherwise. Y up, the ground at y = 0.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from tools.synthetic.scene import GOLDEN_ANGLE_RAD, UP, Tube, build_tubes

Array = NDArray[np.float64]

ACROSS, ALONG = 9, 17  # vertices of a leaf
SIDES = 8
APART = 0.012  # leaves that come nearer to each other, in leaf lengths, do not both stand
FROM_BASE = 0.15  # nearer to their bases they may


@dataclass(frozen=True, kw_only=True)
class ShootSpecies:
    """How the leaves of a species are, and how they stand."""

    length_m: float = 0.06  # the median
    spread: float = 0.2  # standard deviation of the logarithm of the length
    width: float = 0.5  # in leaf lengths
    base: float = 0.7  # power of the outline at the base: below 1 it is blunt
    apex: float = 0.9  # likewise
    fold_rad: float = 0.25  # of either half
    bend_rad: float = 0.6  # of the midrib, from base to apex; the standard deviation is half of it
    twist_rad: float = 0.2  # standard deviation
    wave: float = 0.02  # of the margin, in leaf lengths
    petiole: float = 0.15  # in leaf lengths
    leaves_a_node: int = 1  # 1 in a spiral, 2 opposite, more in whorls
    internode: float = 0.4  # in leaf lengths
    nodes: int = 10  # a shoot
    rise_rad: float = 0.6  # of the leaves above the level


SPECIES: Mapping[str, ShootSpecies] = {
    "ovate": ShootSpecies(),
    "opposite": ShootSpecies(leaves_a_node=2, internode=0.55, petiole=0.05, length_m=0.05, spread=0.35),
    "lanceolate": ShootSpecies(width=0.22, length_m=0.11, base=0.9, apex=1.3, internode=0.2, bend_rad=0.9),
    "round": ShootSpecies(width=0.95, base=0.5, apex=0.5, length_m=0.045, petiole=0.5, internode=0.5),
    "rosette": ShootSpecies(internode=0.04, nodes=14, petiole=0.3, length_m=0.08, width=0.4, base=1.3, rise_rad=0.5),
    "small": ShootSpecies(length_m=0.022, width=0.55, leaves_a_node=2, internode=0.5, petiole=0.1, nodes=14),
    "large": ShootSpecies(length_m=0.16, width=0.6, petiole=0.35, internode=0.35, wave=0.03, fold_rad=0.15, nodes=7),
    "whorled": ShootSpecies(leaves_a_node=4, width=0.35, internode=0.7, petiole=0.06, nodes=6, spread=0.3),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class LeafyShoots:
    """Triangles, and the leaf that each is of."""

    vertices_m: Array  # (V, 3)
    triangles: NDArray[np.int32]  # (F, 3)
    leaf: NDArray[np.int32]  # (F,), -1 for wood
    count: int  # leaves


def grow_shoots(species: ShootSpecies, leaves: int, seed: int) -> LeafyShoots:
    """Shoots beside each other until so many leaves stand apart; the same seed gives the same shoots."""
    rng = np.random.default_rng((seed, 7))
    meshes: list[Array] = []
    tubes: list[Tube] = []
    taken: list[Array] = []
    shoot = 0
    while len(meshes) < leaves:
        place = np.modf(shoot * np.array([0.7548776662466927, 0.5698402909980532]))[0] - 0.5
        side_m = species.length_m * np.sqrt(leaves / max(species.nodes * species.leaves_a_node, 1)) * 2.2
        _grow_shoot(species, np.array([place[0] * side_m, 0.0, place[1] * side_m]), leaves, rng, meshes, tubes, taken)
        shoot += 1
    one = _grid_triangles()
    wood, _, wood_triangles = build_tubes(tubes, SIDES)
    each = ACROSS * ALONG
    triangles = [one + each * k for k in range(len(meshes))]
    return LeafyShoots(
        vertices_m=np.concatenate([*meshes, wood]),
        triangles=np.concatenate([*triangles, wood_triangles + each * len(meshes)]).astype(np.int32),
        leaf=np.concatenate(
            [np.repeat(np.arange(len(meshes), dtype=np.int32), len(one)), np.full(len(wood_triangles), -1, np.int32)]
        ),
        count=len(meshes),
    )


def _grow_shoot(
    species: ShootSpecies,
    root_m: Array,
    leaves: int,
    rng: np.random.Generator,
    meshes: list[Array],
    tubes: list[Tube],
    taken: list[Array],
) -> None:
    """One more stem at root_m (3,), with the leaves that stand apart from those there are."""
    tilt = Rotation.from_rotvec([rng.normal(0, 0.25), 0, rng.normal(0, 0.25)])
    steps = species.internode * species.length_m * np.exp(rng.normal(0, 0.1, species.nodes + 1))
    first_m = species.length_m * rng.uniform(0.4, 1.2)
    along = np.concatenate([[0.0], first_m + np.cumsum(steps)])
    sway = np.column_stack([np.zeros_like(along), along, np.zeros_like(along)])
    sway[:, [0, 2]] += 0.05 * along[:, None] * np.sin(along[:, None] / along[-1] * 3 + rng.uniform(0, 6, 2))
    stem_m = root_m + tilt.apply(sway)
    tubes.append(Tube(points_m=stem_m, radius_m=np.linspace(0.035, 0.015, len(stem_m)) * species.length_m))
    turn = rng.uniform(0, 2 * np.pi)
    for node in range(1, species.nodes + 1):
        turn += GOLDEN_ANGLE_RAD if species.leaves_a_node == 1 else np.pi / species.leaves_a_node
        for k in range(species.leaves_a_node):
            azimuth = turn + 2 * np.pi * k / species.leaves_a_node + rng.normal(0, 0.12)
            rise = species.rise_rad + rng.normal(0, 0.25)
            level = np.array([np.cos(azimuth), 0.0, np.sin(azimuth)])
            y = np.cos(rise) * level + np.sin(rise) * UP
            x = np.cross(y, np.cross(level, y) if abs(y[1]) > 0.99 else np.cross(y, UP))
            x = np.cross(y, x / np.linalg.norm(x))
            turned = Rotation.from_rotvec(rng.normal(0, 0.3) * y)
            x = turned.apply(x)
            length_m = species.length_m * np.exp(rng.normal(0, species.spread))
            base_m = stem_m[node] + species.petiole * length_m * y
            leaf_m = base_m + length_m * _leaf(species, rng) @ np.stack([x, y, np.cross(x, y)])
            if len(meshes) >= leaves or leaf_m[:, 1].min() < 0:
                continue
            free_m = leaf_m.reshape(ALONG, ACROSS, 3)[int(FROM_BASE * ALONG) :].reshape(-1, 3)
            near = [other for other in taken if np.linalg.norm(other.mean(axis=0) - free_m.mean(axis=0)) < 3 * length_m]
            if near:
                away_m = cKDTree(np.concatenate(near)).query(free_m)[0].min()
                if away_m < APART * species.length_m + length_m / (2 * ALONG):
                    continue
            meshes.append(leaf_m)
            taken.append(free_m)
            radius_m = np.full(2, max(0.012 * length_m, 0.0003))
            tubes.append(Tube(points_m=np.stack([stem_m[node], leaf_m[ACROSS // 2]]), radius_m=radius_m))


def _leaf(species: ShootSpecies, rng: np.random.Generator) -> Array:
    """Vertices (ALONG * ACROSS, 3) of one leaf, row after row from its base: width x, length y, height z."""
    u, v = np.linspace(-1, 1, ACROSS)[None], np.linspace(0, 1, ALONG)[:, None]
    base, apex = species.base * np.exp(rng.normal(0, 0.1)), species.apex * np.exp(rng.normal(0, 0.1))
    outline = v**base * (1 - v) ** apex
    half = 0.5 * species.width * np.exp(rng.normal(0, 0.12)) * outline / outline.max()
    x = half * u * (1 + 0.05 * np.sin(9 * v + rng.uniform(0, 6)))
    z = np.abs(x) * np.tan(species.fold_rad + rng.normal(0, 0.1))
    z = z + species.wave * np.sin(2 * np.pi * rng.uniform(1.5, 3) * v + rng.uniform(0, 6) + 0.8 * np.sign(u)) * u**2
    twist = rng.normal(0, species.twist_rad) * v
    x, z = x * np.cos(twist) - z * np.sin(twist), x * np.sin(twist) + z * np.cos(twist)
    bend = rng.normal(species.bend_rad, 0.5 * species.bend_rad) * v**1.5
    aside = rng.normal(0, 0.1) * v
    step = np.diff(v, axis=0, prepend=0)
    y = np.cumsum(step * np.cos(bend), axis=0) + z * np.sin(bend)
    height = z * np.cos(bend) - np.cumsum(step * np.sin(bend), axis=0)
    x = x + aside * v
    return np.stack(np.broadcast_arrays(x, y, height), axis=-1).reshape(-1, 3)


def _grid_triangles() -> NDArray[np.int64]:
    row, column = np.meshgrid(np.arange(ALONG - 1), np.arange(ACROSS - 1), indexing="ij")
    corner = (row * ACROSS + column).reshape(-1, 1)
    lower, upper = np.array([0, 1, ACROSS]), np.array([1, ACROSS + 1, ACROSS])
    return np.concatenate([corner + lower, corner + upper])
