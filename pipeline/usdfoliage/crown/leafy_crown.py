"""A crown as clusters of leaves: places inside it, sorted so that the first few cover it, and the leaves of a cluster.

The thesis places 320 billboards in a ball, sorts them by their distances, and cuts away fragments outside the crown
(Argudo, section 5.2). Ours differs: places are spread over the crown itself, farthest first, so that every prefix
covers it; a cluster is of single leaves, which the shader moves into the crown, so that no leaf is cut; and each leaf
has the crown's colour where it is, so that leaves differ as the photograph does.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.crown.leaf_picture import PLAIN_COVER, PLAIN_WIDTH, WIDEST
from usdfoliage.crown.model import CrownModel
from usdfoliage.geometry.cubemap import sample_cubemap

Floats = NDArray[np.float64]

_POOL = 24  # places to choose each from
_DRAWN = 8  # times as many are drawn in the ball
_LONG = 1.5  # power of the crown's radius, by which they are kept; 3 is even in the crown
_SIZES = (1.0, 0.7, 0.5, 0.35)  # of the radius of a cluster, where the crown has room for it and where it is thin
_ROOM = 0.8  # of its radius, around a cluster's middle, where there must be crown
_MIN_INSIDE = 0.5  # of the directions from there
_DIRECTIONS = 24
_FILL = 0.8  # of the distance between neighbouring places, radius of a cluster
_INSIDE = 0.75  # of that radius, by which a cluster's middle is inside the crown
_LEAF = 1.6  # of that radius, half of the length of a plain leaf times the root of how many there are
_LONGEST = 0.6  # of that radius, half of the length of any leaf
_TILT = 0.7  # tangent, standard deviation, of how far a leaf leans from looking outwards, on either axis
_MORE = 4.0  # times as many leaves, where they are slim
_SHADE = 0.25  # standard deviation of the logarithm of a leaf's brightness, beyond what the map of colours has
_ON_LEAF = 8  # directions, of whose colours a leaf has the mean
_LEAF_PART = 0.5  # of half its length, standard deviation of how far these are from its middle
_OCCLUSION = 0.35  # of the light, that the deepest place below loses; as the shader of the mesh has it


@dataclass(frozen=True, kw_only=True)
class LeafyCrownSettings:
    """How many leaves a crown has."""

    clusters: int = 320
    leaves: int = 36  # of a cluster
    forms: int = 3  # of clusters
    leaf_width: float = PLAIN_WIDTH  # of the picture of a leaf, over its height
    leaf_cover: float = PLAIN_COVER  # of the picture's area, that shows leaf
    seed: int = 0

    def __post_init__(self) -> None:
        if not (8 <= self.clusters <= 100_000 and 1 <= self.leaves <= 1000 and 1 <= self.forms <= 64):
            raise ValueError("clusters must be 8 to 100,000, leaves 1 to 1,000, forms 1 to 64")
        if not 0 < self.leaf_width <= WIDEST:
            raise ValueError(f"leaf_width must be above 0 and at most {WIDEST:g}, not {self.leaf_width:g}")
        if not 0 < self.leaf_cover <= 1:
            raise ValueError(f"leaf_cover must be above 0 and at most 1, not {self.leaf_cover:g}")

    @property
    def half_length(self) -> float:
        """Of a leaf, in radii of its cluster, before leaves differ: leaves of any form cover the same area."""
        return min(_LEAF * float(np.sqrt(self._slimness / self.leaf_count)), _LONGEST)

    @property
    def leaf_count(self) -> int:
        """Leaves of a cluster: more where they are slim, since few long ones would stand out of it."""
        return round(self.leaves * min(max(self._slimness, 1.0), _MORE))

    @property
    def _slimness(self) -> float:
        """How many leaves have the area of one plain leaf of their length."""
        return (PLAIN_WIDTH * PLAIN_COVER) / (self.leaf_width * self.leaf_cover)


@dataclass(frozen=True, kw_only=True, eq=False)
class LeafCluster:
    """One form of cluster, in its own space: a ball of radius 1, +Z outwards of the crown. Every leaf is a quad."""

    points: Floats  # (4 L, 3), corner after corner
    middle: Floats  # (4 L, 3) of the leaf of each corner
    corner: Floats  # (4 L, 2) across and along a leaf, from its middle
    st: Floats  # (4 L, 2)
    normals: Floats  # (4 L, 3), unit

    @property
    def reach(self) -> float:
        """How far from its middle it has leaves."""
        return float(np.linalg.norm(self.points, axis=1).max())


@dataclass(frozen=True, kw_only=True, eq=False)
class LeafyCrown:
    """Clusters (N,) of a crown, in the order in which they are drawn."""

    place_m: Floats  # (N, 3) in the crown's frame
    orientation: Floats  # (N, 4) unit quaternions, real part first: the cluster's +Z looks away from the centre
    radius_m: Floats  # (N,)
    color: Floats  # (N, 3) linear, with the occlusion below and inside
    leaf_color: Floats  # (N, L, 3) the same of each leaf
    form: NDArray[np.int64]  # (N,)
    rank: Floats  # (N,) 0 to below 1, by the order
    forms: tuple[LeafCluster, ...]

    @property
    def extent_m(self) -> Floats:
        """(2, 3) around all leaves, in the crown's frame."""
        reach = max(form.reach for form in self.forms)
        reach_m = reach * self.radius_m[:, None]
        return np.stack([(self.place_m - reach_m).min(axis=0), (self.place_m + reach_m).max(axis=0)])


def build_leafy_crown(crown: CrownModel, settings: LeafyCrownSettings = LeafyCrownSettings()) -> LeafyCrown:
    """Clusters of leaves that fill a crown.

    Args:
        crown: Its radii, colours and centre.
        settings: How many leaves.
    """
    rng = np.random.default_rng(settings.seed)
    pool = _ball(_DRAWN * _POOL * settings.clusters, rng)
    reach_m = sample_cubemap(crown.radius_m, pool)
    # Evenly drawn in the ball, long parts of the crown would have few, and evenly in the crown its middle would.
    weight = reach_m**_LONG
    even = rng.choice(len(pool), len(pool) // _DRAWN, replace=False, p=weight / weight.sum())
    pool = pool[even]
    share = np.linalg.norm(pool, axis=1)
    volume_m3 = 4 * np.pi / 3 * float((reach_m**3).mean())
    reach_m = reach_m[even]
    direction = pool / share[:, None]
    full_m = _FILL * (volume_m3 / settings.clusters) ** (1 / 3)
    size_m, out_m = _fitted_sizes(crown, direction, share * reach_m, share, full_m)
    chosen = _farthest_first(out_m[:, None] * direction, settings.clusters, size_m)
    direction = direction[chosen]
    out_m, radius_m = out_m[chosen], size_m[chosen]
    place_m = crown.center_m + out_m[:, None] * direction
    orientation = _outwards(direction, rng.uniform(0, 2 * np.pi, len(chosen)))
    forms, form = _clusters(settings, rng), np.arange(len(chosen)) % settings.forms
    middles = np.stack([each.middle[::4] for each in forms])[form] * radius_m[:, None, None]
    leaves_m = out_m[:, None, None] * direction[:, None] + _turn(middles, orientation)
    leaf_color = _leaf_colors(crown, leaves_m, settings.half_length * radius_m, rng)
    return LeafyCrown(
        place_m=place_m,
        orientation=orientation,
        radius_m=radius_m,
        color=leaf_color.mean(axis=1),
        leaf_color=leaf_color,
        form=form,
        rank=np.arange(len(chosen)) / len(chosen),
        forms=forms,
    )


def build_leaf_clusters(settings: LeafyCrownSettings = LeafyCrownSettings()) -> tuple[LeafCluster, ...]:
    """The forms of clusters alone, for crowns that have their places already."""
    return _clusters(settings, np.random.default_rng(settings.seed))


def _leaf_colors(crown: CrownModel, places_m: Floats, half_m: Floats, rng: np.random.Generator) -> Floats:
    """(N, L, 3) linear: what the crown has around each leaf, shaded as its mesh is (Argudo, section 5.3).

    Args:
        crown: Its radii and colours.
        places_m: (N, L, 3) of the leaves, from the crown's centre.
        half_m: (N,) of the length of leaves.
        rng: For what differs from leaf to leaf.
    """
    away_m = np.linalg.norm(places_m, axis=-1)
    direction = places_m / np.maximum(away_m, 1e-12)[..., None]
    reach_m = sample_cubemap(crown.radius_m, direction)
    aside = (_LEAF_PART * half_m[:, None] / reach_m)[..., None]
    color = np.zeros((*away_m.shape, 3))
    for _ in range(_ON_LEAF):
        color += sample_cubemap(crown.color, direction + aside * rng.standard_normal(direction.shape)) / _ON_LEAF
    low_m, high_m = float(crown.radius_m.min()), float(crown.radius_m.max())
    at_m = np.minimum(away_m, reach_m)
    outside = np.clip((at_m - low_m) / (high_m - low_m), 0, 1) if high_m > low_m else np.ones_like(at_m)
    above = np.clip(0.5 + 0.5 * direction[..., 1] * at_m / high_m, 0, 1)
    shade = np.exp(_SHADE * rng.standard_normal(away_m.shape))
    shade /= shade.mean(axis=1, keepdims=True)
    return color * (shade * (1 - _OCCLUSION * (1 - 0.5 * (outside + above))))[..., None]


def _fitted_sizes(
    crown: CrownModel, direction: Floats, at_m: Floats, share: Floats, full_m: float
) -> tuple[Floats, Floats]:
    """Radii (N,) of clusters, and how far from the centre (N,) they are: thin parts of a crown have small clusters.

    Args:
        crown: Its radii.
        direction: (N, 3) of the places.
        at_m: (N,) how far from the centre a place is.
        share: (N,) the same, of the crown's radius there.
        full_m: Radius of a cluster where there is room.
    """
    around = spread_on_ball(_DIRECTIONS)
    size_m = np.full(len(direction), _SIZES[-1] * full_m)
    out_m = np.maximum(at_m - _INSIDE * size_m * share**2, 0.0)
    for size in reversed(_SIZES[:-1]):
        inner_m = np.maximum(at_m - _INSIDE * size * full_m * share**2, 0.0)
        places_m = inner_m[:, None] * direction
        inside = np.zeros(len(direction))
        for each in around:
            beside_m = places_m + _ROOM * size * full_m * each
            away_m = np.linalg.norm(beside_m, axis=1)
            inside += away_m <= sample_cubemap(crown.radius_m, beside_m / np.maximum(away_m, 1e-12)[:, None])
        fits = inside >= _MIN_INSIDE * len(around)
        size_m[fits], out_m[fits] = size * full_m, inner_m[fits]
    return size_m, out_m


def spread_on_ball(count: int) -> Floats:
    """(count, 3) unit directions, even over the ball: points on a spiral."""
    number = np.arange(count) + 0.5
    up = 1 - 2 * number / count
    turn = np.pi * (1 + np.sqrt(5)) * number
    aside = np.sqrt(1 - up**2)
    return np.column_stack([aside * np.cos(turn), up, aside * np.sin(turn)])


def spread_in_ball(count: int, rng: np.random.Generator) -> Floats:
    """(count, 3) places in the unit ball, each the one of many that is farthest from those before it."""
    pool = _ball(_POOL * count, rng)
    return pool[_farthest_first(pool, count)]


def _ball(count: int, rng: np.random.Generator) -> Floats:
    """(count, 3) places, even in the unit ball."""
    places = rng.standard_normal((count, 3))
    return places * (rng.random(count) ** (1 / 3) / np.linalg.norm(places, axis=1))[:, None]


def _farthest_first(places: Floats, count: int, size: Floats | float = 1.0) -> NDArray[np.int64]:
    """(count,) of places (N, 3) the outermost, then again and again the one that is farthest from those before it.

    Distances count in sizes (N,) of the places: where these are small, places are close together.
    """
    chosen = np.empty(count, np.int64)
    away = np.full(len(places), np.inf)
    best = int(np.argmax(np.linalg.norm(places, axis=1)))
    for number in range(count):
        chosen[number] = best
        away = np.minimum(away, np.linalg.norm(places - places[best], axis=1) / size)
        best = int(np.argmax(away))
    return chosen


def _outwards(direction: Floats, roll: Floats) -> Floats:
    """(N, 4) quaternions that turn +Z to directions (N, 3), after a roll (N,) about it."""
    # The shortest turn from +Z: (1 + z, -y, x, 0), which is none where the direction is -Z.
    shortest = np.column_stack([1 + direction[:, 2], -direction[:, 1], direction[:, 0], np.zeros(len(direction))])
    shortest[shortest[:, 0] < 1e-9] = [0.0, 1.0, 0.0, 0.0]
    shortest /= np.linalg.norm(shortest, axis=1, keepdims=True)
    w, x, y, _ = shortest.T
    c, s = np.cos(roll / 2), np.sin(roll / 2)
    return np.column_stack([w * c, x * c + y * s, y * c - x * s, w * s])


def _turn(points: Floats, orientation: Floats) -> Floats:
    """Points (N, L, 3) turned by quaternions (N, 4), real part first."""
    real, axis = orientation[:, None, :1], np.broadcast_to(orientation[:, None, 1:], points.shape)
    twice = 2 * np.cross(axis, points)
    return points + real * twice + np.cross(axis, twice)


def _clusters(settings: LeafyCrownSettings, rng: np.random.Generator) -> tuple[LeafCluster, ...]:
    return tuple(_cluster(settings, rng) for _ in range(settings.forms))


def _cluster(settings: LeafyCrownSettings, rng: np.random.Generator) -> LeafCluster:
    """Leaves around a middle, each in a plane that looks outwards and a little to a side."""
    half, leaves = settings.half_length, settings.leaf_count
    middle = spread_in_ball(leaves, rng) * (1 - 0.5 * half)
    tilt = rng.normal(0, _TILT, (leaves, 2))
    normal = np.column_stack([tilt, np.ones(leaves)])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    turn = rng.uniform(0, 2 * np.pi, leaves)
    along = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(leaves)])
    along -= np.sum(along * normal, axis=1, keepdims=True) * normal
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = np.cross(along, normal)
    size = half * rng.uniform(0.8, 1.2, leaves)
    square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    corner = (square[None] * [settings.leaf_width, 1.0] * size[:, None, None]).reshape(-1, 2)
    of = np.repeat(np.arange(leaves), 4)
    return LeafCluster(
        points=middle[of] + corner[:, :1] * across[of] + corner[:, 1:] * along[of],
        middle=middle[of],
        corner=corner,
        st=np.tile(0.5 + 0.5 * square, (leaves, 1)),
        normals=normal[of],
    )
