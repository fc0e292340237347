"""A skeleton along the veins of a leaf, from its base to the tip of each lobe.

The veins are given as a region, or traced in the picture, where they are ridges of another colour. Each lobe that the
medial axis has gets one path: the cheapest one from the base to its tip, where going along a vein is cheap and going
through the blade between veins is not. All cheapest paths from one place make a tree, and none leaves the blade, so
that these two criteria of the paper hold; forks close to each other are joined, so that no strip between two veins is
too thin for its ties.

Source:
    L. Mündermann et al., Modeling lobed leaves, section 3.2, the criteria; E. W. Dijkstra, A note on two problems in
    connexion with graphs, 1959. The costs: our own.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from usdfoliage.leaf.lobed.medial_axis import MedialAxis

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

_AROUND = np.array([(0, 1), (1, 0), (1, 1), (1, -1)])  # steps to neighbours, down and right; others are their reverse
_SHORTCUT = 0.02  # cost of a pixel on the clearest vein, where one between veins costs 1
_RIM = 3.0  # cost at the silhouette beside that inside, since a path along it leaves no room for ties
_OFF_TIP = 0.3  # cost of a pixel between the tip of a lobe and the end of its vein
_FOLLOWED = 0.05  # cost of a pixel of a path, above twice the cheapest, that still follows a vein
_HIDDEN = 0.15  # how clear a vein under the petiole counts
_RAYS = 48


@dataclass(frozen=True, kw_only=True)
class VeinSettings:
    """How veins are followed. Lengths are parts of the root of the leaf's area."""

    grain_px: float = 320.0  # The root of the leaf's area where paths are looked for. Unit: pixels. Range: 50 or more.
    width: float = 0.006  # of a vein in the picture
    join: float = 0.06  # Forks nearer to each other are joined.
    clear: float = 0.02  # of the silhouette, in which a path is dear
    hub: float = 0.03  # from the base to where veins part
    shortest: float = 0.25  # from where veins part to the end of one, where ends are found by veins alone
    apart: float = 0.3  # between two such ends
    tip: float = 0.09  # from the tip of the medial axis to where the vein of that lobe ends

    def __post_init__(self) -> None:
        if not (self.grain_px >= 50 and self.width > 0 and self.join >= 0 and min(self.clear, self.hub, self.tip) > 0):
            raise ValueError(
                f"grain_px must be at least 50, width, clear, hub and tip above 0, and join not below 0, not {self}"
            )


def measure_veins(
    srgb: NDArray[np.uint8], blade: Mask, petiole: Mask | None = None, settings: VeinSettings = VeinSettings()
) -> NDArray[np.float32]:
    """(H, W) how clearly each pixel of a blade is on a vein, 0 to 1, from the ridges of its colours.

    Veins may be lighter or darker than the blade, or have another hue: each of the three channels of Lab counts by how
    much its ridges stand out, in the direction in which these are longer.

    Args:
        srgb: (H, W, 3), of the picture.
        blade: (H, W).
        petiole: (H, W), where it lies over the blade and hides veins: these may go on there. None for no petiole.
        settings: How wide veins are.
    """
    size = float(np.sqrt(blade.sum()))
    lab = cv2.cvtColor(srgb, cv2.COLOR_RGB2LAB).astype(np.float32)
    inside = cv2.erode(blade.astype(np.uint8), np.ones((5, 5), np.uint8)).astype(bool)
    total: NDArray[np.float32] = np.zeros(blade.shape, np.float32)
    if inside.sum() < 16:
        return total
    # Outside of the blade its own mean colour goes on, so that the silhouette is no ridge.
    lab = np.where(inside[..., None], lab, np.float32(0))
    weight = inside.astype(np.float32)
    spread = 0.03 * size
    known = np.maximum(cv2.GaussianBlur(weight, (0, 0), spread), 1e-3)
    around = cv2.GaussianBlur(lab, (0, 0), spread) / known[..., None]
    flat = np.where(inside[..., None], lab - around, 0)
    for channel in range(3):
        noise = float(np.median(np.abs(flat[..., channel][inside]))) + 0.5
        best, highest = np.zeros_like(total), -1.0
        for sign in (1, -1):
            ridge = np.maximum(
                _ridge(np.ascontiguousarray(sign * flat[..., channel]), max(1.0, settings.width * size / 2)),
                _ridge(np.ascontiguousarray(sign * flat[..., channel]), max(1.0, settings.width * size)),
            )
            ridge = np.where(inside, ridge, 0) / np.float32(noise)
            # Long ridges: those that a blur along all directions leaves high.
            strength = float(np.percentile(ridge[inside], 98) - np.percentile(ridge[inside], 60))
            if strength > highest:
                best, highest = np.asarray(ridge, np.float32), strength
        total = total + best
    top = float(np.percentile(total[inside], 98.5))
    clear = np.clip(total / max(top, 1e-6), 0, 1) * inside
    if petiole is not None and petiole.any():
        reach = max(1, round(2 * settings.width * size))
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
        clear[(cv2.dilate(petiole.astype(np.uint8), disc) > 0) & inside] = _HIDDEN
    return np.asarray(clear, np.float32)


def draw_veins(region: Mask, blade: Mask) -> NDArray[np.float32]:
    """(H, W) how clearly each pixel is on a vein, 0 to 1, of the region of all veins: more so in its middle."""
    deep = cv2.distanceTransform(region.astype(np.uint8), cv2.DIST_L2, 5)
    if not region.any():
        return deep
    wide = cv2.dilate(deep, np.ones((3, 3), np.uint8))
    return np.asarray(np.where(region & blade, 0.5 + 0.5 * np.minimum(deep / np.maximum(wide, 1), 1), 0), np.float32)


def choose_base(ends: Floats, veins: NDArray[np.float32], blade: Mask) -> Floats:
    """(2,) that of some places (N, 2) from which the clearest veins radiate, pixels, y down.

    Raises:
        ValueError: No place is given.
    """
    if not len(ends):
        raise ValueError("a base is chosen of one place at least")
    size = float(np.sqrt(blade.sum()))
    soft = cv2.GaussianBlur(veins, (0, 0), max(1.0, 0.006 * size))
    angle = np.arange(_RAYS) * 2 * np.pi / _RAYS
    away = np.linspace(0.08, 0.3, 40) * size
    scores = []
    for end in ends:
        place = end + away[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        column = np.clip(place[..., 0].astype(int), 0, veins.shape[1] - 1)
        row = np.clip(place[..., 1].astype(int), 0, veins.shape[0] - 1)
        along = soft[row, column].mean(axis=0)
        peak = along[(along >= np.roll(along, 1)) & (along >= np.roll(along, -1))]
        scores.append(float(np.sort(peak)[-5:].sum()))
    return np.asarray(ends[int(np.argmax(scores))])


@dataclass(frozen=True, kw_only=True, eq=False)
class VeinPaths:
    """The cheapest paths from the place where veins part to each pixel of a blade."""

    places: Floats  # (P, 2), pixels with y up
    away: Floats  # (P,), what it costs to get there
    before: Ints  # (P,), the pixel through which, below 0 at the first one
    deep: Floats  # (P,), how far it is from the outside, pixels of the picture
    rim: Ints  # those beside the outside
    hub: int  # the place where veins part
    base: Floats  # (2,), where the leaf begins
    size: float  # the root of the area of the blade, pixels


def find_paths(
    veins: NDArray[np.float32], blade: Mask, base_px: Floats, settings: VeinSettings = VeinSettings()
) -> VeinPaths:
    """The cheapest paths inside a blade, along its veins where there are any.

    Args:
        veins: (H, W), how clearly each pixel is on a vein, 0 to 1.
        blade: (H, W), which no path leaves.
        base_px: (2,), where the leaf begins, pixels with y up.
        settings: How veins are followed.

    Raises:
        ValueError: The blade is empty, or veins are of another size.
    """
    if veins.shape != blade.shape or not blade.any():
        raise ValueError(f"veins {veins.shape} and a blade {blade.shape} of {int(blade.sum())} pixels do not match")
    scale = min(1.0, settings.grain_px / float(np.sqrt(blade.sum())))
    size = max(2, round(blade.shape[1] * scale)), max(2, round(blade.shape[0] * scale))
    step = np.array([blade.shape[1] / size[0], -blade.shape[0] / size[1]])
    # A thin neck of the blade must not part: what has any part of a pixel counts.
    room = cv2.resize(blade.astype(np.float32), size, interpolation=cv2.INTER_AREA) > 0.25
    if not room.any():
        raise ValueError("the blade is too thin for a path")
    deep = cv2.distanceTransform(np.pad(room, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]
    clear = cv2.resize(veins, size, interpolation=cv2.INTER_AREA)
    clearest = np.asarray(np.clip(clear / max(float(clear.max()), 1e-6), 0, 1), np.float64)
    dear = 1 + (_RIM - 1) * np.clip(1 - deep / (settings.clear * settings.grain_px), 0, 1)
    cost = dear * _SHORTCUT / (_SHORTCUT + (1 - _SHORTCUT) * clearest)
    number = np.full(room.shape, -1, np.int64)
    number[room] = np.arange(room.sum())
    places = np.argwhere(room)[:, ::-1].astype(np.float64) + 0.5
    hub = _find_hub(places, deep[room].astype(np.float64), clearest[room], base_px / step, settings)
    away, before = dijkstra(
        _join_pixels(number, cost), directed=False, indices=np.array([hub]), return_predecessors=True
    )
    return VeinPaths(
        places=places * step,
        away=away[0],
        before=before[0].astype(np.int64),
        deep=deep[room].astype(np.float64) * step[0],
        rim=np.flatnonzero((deep[room] < 2) & np.isfinite(away[0])),
        hub=hub,
        base=base_px,
        size=float(np.sqrt(blade.sum())),
    )


def find_vein_ends(paths: VeinPaths, outline: Floats, settings: VeinSettings = VeinSettings()) -> Floats:
    """(N, 2) where the clearest veins arrive at an outline (K, 2), y up: one place in each part of it.

    A path along a vein costs little for its length; of the outline's places close to each other the cheapest is taken.
    """
    if not len(paths.rim):
        return np.empty((0, 2))
    nearest = paths.rim[cKDTree(paths.places[paths.rim]).query(outline)[1]]
    far = np.linalg.norm(paths.places[nearest] - paths.places[paths.hub], axis=1)
    mean = paths.away[nearest] / np.maximum(far, 1e-9)
    ends: list[Floats] = []
    for place in np.argsort(mean, kind="stable").tolist():
        if mean[place] > 2 * mean.min() + _FOLLOWED:
            break
        point = outline[place]
        if far[place] < settings.shortest * paths.size:
            continue
        if all(float(np.linalg.norm(point - end)) > settings.apart * paths.size for end in ends):
            ends.append(point)
    return np.array(ends).reshape(-1, 2)


def follow_veins(paths: VeinPaths, tips: Floats, settings: VeinSettings = VeinSettings()) -> MedialAxis:
    """The tree of the cheapest paths to the tips (N, 2) of lobes, y up, in the form of a medial axis.

    Raises:
        ValueError: No tip can be reached inside the blade.
    """
    ends = {_find_end(paths, tip, settings.tip * paths.size) for tip in tips} - {paths.hub}
    routes = []
    for end in sorted(ends, key=lambda place: (-paths.away[place], place)):
        if np.isfinite(paths.away[end]):
            route = [end]
            while route[-1] != paths.hub:
                route.append(int(paths.before[route[-1]]))
            routes.append(route[::-1])
    if not routes:
        raise ValueError("no tip of a lobe is reached from the base")
    chains = _join_forks(routes, paths.places, settings.join * paths.size)
    return _add_petiole(_as_axis(chains, paths.places, paths.deep), paths.places[paths.hub], paths.base)


def _find_hub(places: Floats, deep: Floats, clear: Floats, base: Floats, settings: VeinSettings) -> int:
    """Where veins part: close to the base, with room around it for ties, on the clearest vein there is."""
    room = settings.hub * settings.grain_px
    away = np.linalg.norm(places - base, axis=1)
    worth = clear + np.minimum(deep / room, 1) - 0.5 * np.maximum(away / room - 1, 0)
    worth[away > 3 * room] = -np.inf
    near = int(np.argmax(worth))
    return near if np.isfinite(worth[near]) else int(np.argmin(away))


def _find_end(paths: VeinPaths, tip: Floats, reach: float) -> int:
    """The place of the rim near the tip of a lobe at which its vein arrives."""
    apart = np.linalg.norm(paths.places[paths.rim] - tip, axis=1)
    near = apart <= reach
    if not near.any():
        return int(np.argmin(((paths.places - tip) ** 2).sum(axis=1)))
    # Costs are those of pixels of the reduced picture, as distances must be.
    grain = float(np.abs(np.diff(np.unique(paths.places[:, 0]))).min(initial=1.0))
    return int(paths.rim[near][np.argmin(paths.away[paths.rim[near]] + _OFF_TIP / grain * apart[near])])


def _add_petiole(axis: MedialAxis, hub: Floats, base: Floats) -> MedialAxis:
    """A tree that begins in a tip: from the place where its veins part a limb goes to the base."""
    place = int(np.argmin(((axis.places - hub) ** 2).sum(axis=1)))
    out = base - axis.places[place]
    steps = max(2, int(np.linalg.norm(out)))
    first = len(axis.places)
    part = np.arange(1, steps + 1)[:, None] / steps
    neighbors = [*axis.neighbors, *((first + step - 1, first + step + 1) for step in range(steps))]
    neighbors[place] = (*axis.neighbors[place], first)
    neighbors[first] = (place, first + 1)
    neighbors[-1] = (first + steps - 2,)
    return MedialAxis(
        places=np.concatenate([axis.places, axis.places[place] + part * out]),
        radius=np.concatenate([axis.radius, np.full(steps, axis.radius[place])]),
        neighbors=tuple(neighbors),
    )


def _ridge(channel: NDArray[np.float32], sigma: float) -> NDArray[np.float32]:
    """How much more a picture bends across than along, where it is brighter than beside it."""
    soft = cv2.GaussianBlur(channel, (0, 0), sigma)
    across, down = (cv2.Sobel(soft, cv2.CV_32F, *order, ksize=3) for order in ((1, 0), (0, 1)))
    xx, xy = (cv2.Sobel(across, cv2.CV_32F, *order, ksize=3) for order in ((1, 0), (0, 1)))
    yy = cv2.Sobel(down, cv2.CV_32F, 0, 1, ksize=3)
    apart = np.sqrt(((xx - yy) / 2) ** 2 + xy**2)
    sharp, blunt = -((xx + yy) / 2 - apart), -((xx + yy) / 2 + apart)
    return np.asarray(np.maximum(sharp - np.maximum(np.abs(blunt), 0), 0) * np.float32(sigma**2 / 64))


def _join_pixels(number: Ints, cost: Floats) -> csr_array:
    """The graph of pixels and what it costs to go from one to another."""
    height, width = number.shape
    one, other, weights = [], [], []
    for down, right in _AROUND.tolist():
        here = number[: height - down, max(0, -right) : width - max(0, right)]
        there = number[down:, max(0, right) : width + min(0, right)]
        both = (here >= 0) & (there >= 0)
        mean = (
            cost[: height - down, max(0, -right) : width - max(0, right)]
            + cost[down:, max(0, right) : width + min(0, right)]
        ) / 2
        one.append(here[both])
        other.append(there[both])
        weights.append(mean[both] * np.hypot(down, right))
    count = int(number.max()) + 1
    return coo_array(
        (np.concatenate(weights), (np.concatenate(one), np.concatenate(other))), shape=(count, count)
    ).tocsr()


def _join_forks(paths: Sequence[Sequence[int]], places: Floats, join: float) -> list[tuple[int, ...]]:
    """Chains of places that make a tree: the first path, and of each other one what is its own.

    Where a path would leave the tree close to a fork, to the base or to a tip, it leaves it there.
    """
    chains = [tuple(paths[0])]
    at = {place: (0, index) for index, place in enumerate(paths[0])}
    forks = {0: [0, len(paths[0]) - 1]}  # of each chain, where others leave it and where it ends
    for path in paths[1:]:
        split = max(index for index, place in enumerate(path) if place in at)
        if split == len(path) - 1:
            continue  # another path goes through this tip
        chain, index = at[path[split]]
        own = places[list(chains[chain])]
        leave = min(forks[chain], key=lambda fork: (abs(fork - index), fork))
        if np.linalg.norm(own[leave] - own[index]) > join or leave == len(chains[chain]) - 1:
            leave = index
        rest = list(path[split + 1 :])
        begin = chains[chain][leave]
        if leave != index:
            # What is near the fork would lie on the other limb, or go back along it.
            gone = np.linalg.norm(places[rest] - places[begin], axis=1) > 1.5 * np.linalg.norm(own[leave] - own[index])
            rest = rest[int(np.argmax(gone)) :] if gone.any() else rest[-1:]
        new = len(chains)
        chains.append((begin, *rest))
        forks[chain].append(leave)
        forks[new] = [0, len(rest)]
        at.update({place: (new, 1 + along) for along, place in enumerate(rest)})
    return chains


def _as_axis(chains: Sequence[Sequence[int]], places: Floats, radius: Floats) -> MedialAxis:
    """Chains as a tree of places."""
    used = sorted({place for chain in chains for place in chain})
    number = {place: index for index, place in enumerate(used)}
    neighbors: list[list[int]] = [[] for _ in used]
    for chain in chains:
        for one, other in itertools.pairwise(chain):
            neighbors[number[one]].append(number[other])
            neighbors[number[other]].append(number[one])
    kept = places[used]
    return MedialAxis(places=kept, radius=radius[used], neighbors=tuple(map(tuple, neighbors)))
