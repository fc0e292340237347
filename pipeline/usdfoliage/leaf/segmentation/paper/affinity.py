"""Which superpixels belong together.

Source: G. Chaurasia, P. Beardsley, Editable Parametric Dense Foliage from 3D Capture, 2017, section 4.1, eq. 7 and 8.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from usdfoliage.leaf.segmentation.paper.planes import SuperpixelPlanes


@dataclass(frozen=True, kw_only=True)
class AffinitySettings:
    """When two neighbours are joined."""

    sigma: float = 0.2  # This is the parameter σ of equation 8. Range: above 0.
    threshold: float = 0.85  # Neighbours are joined at this affinity and above. Range: above 0, below 1.

    def __post_init__(self) -> None:
        if self.sigma <= 0 or not 0 < self.threshold < 1:
            raise ValueError(f"sigma must be above 0 and threshold in (0, 1), not {self}")

    @property
    def reach(self) -> float:
        """The distance in units of δ_plane beyond which even coplanar neighbours are not joined."""
        return float(self.sigma * np.sqrt(-2 * np.log(self.threshold)))


@dataclass(frozen=True, kw_only=True, eq=False)
class SuperpixelGraph:
    """Neighbours that share a boundary and both have a plane."""

    edges: NDArray[np.int32]  # (E, 2), numbers of superpixels, the lower first, in rising order
    affinity: NDArray[np.float64]  # (E,), D of eq. 8


def measure_affinity(
    points_m: NDArray[np.floating],
    labels: NDArray[np.int32],
    planes: SuperpixelPlanes,
    plane_threshold_m: float,
    settings: AffinitySettings = AffinitySettings(),
    *,
    reach_px: int = 3,
) -> SuperpixelGraph:
    """The graph of superpixels with the affinity of eq. 8.

    The least distance between two neighbours is taken over pairs of pixels at most reach_px apart. Points of pixels
    farther apart than that are also farther apart in space than settings.reach allows, as long as δ_plane is not more
    than reach_px / settings.reach footprints of a pixel: what falls short of the threshold may, the rest is exact.

    Args:
        points_m: (H, W, 3), NaN where there is none.
        labels: (H, W), superpixels from 0, -1 for none.
        planes: Of these superpixels.
        plane_threshold_m: δ_plane.
        settings: σ of eq. 8.
        reach_px: Pixels between which distances are looked for.

    Raises:
        ValueError: The shapes differ.
    """
    if points_m.shape != (*labels.shape, 3) or planes.inliers.shape != labels.shape:
        raise ValueError(f"points {points_m.shape}, labels {labels.shape}, inliers {planes.inliers.shape} do not match")
    count = len(planes.valid)
    allowed = np.append(planes.valid, False)  # the last for label -1
    used = allowed[labels]
    known = planes.inliers & used

    bordering: list[NDArray[np.int64]] = []
    keys: list[NDArray[np.int64]] = []
    distances: list[NDArray[np.float64]] = []
    for down, right in _half_disc(reach_px):
        here, there = _shifted(labels.shape, down, right)
        differ = labels[here] != labels[there]
        if abs(down) + abs(right) == 1:
            touch = differ & used[here] & used[there]
            bordering.append(_key(labels[here][touch], labels[there][touch], count))
        pairs = differ & known[here] & known[there]
        keys.append(_key(labels[here][pairs], labels[there][pairs], count))
        distances.append(np.linalg.norm(points_m[here][pairs] - points_m[there][pairs], axis=1))

    edges_key = np.unique(np.concatenate(bordering))
    key, distance = np.concatenate(keys), np.concatenate(distances)
    place = np.searchsorted(edges_key, key)
    place = np.minimum(place, max(len(edges_key) - 1, 0))
    belongs = edges_key[place] == key if len(edges_key) else np.zeros(len(key), np.bool_)
    nearest = np.full(len(edges_key), np.inf)
    np.minimum.at(nearest, place[belongs], distance[belongs])

    low, high = edges_key // count if count else edges_key, edges_key % max(count, 1)
    cosine = np.einsum("ij,ij->i", planes.normals[low], planes.normals[high])
    d_n, d_p = 1 - np.minimum(cosine, 1.0), nearest / plane_threshold_m  # eq. 7
    affinity = np.exp(-(d_n**2 + d_p**2) / (2 * settings.sigma**2))  # eq. 8
    return SuperpixelGraph(edges=np.column_stack([low, high]).astype(np.int32), affinity=affinity)


def join_superpixels(
    graph: SuperpixelGraph, valid: NDArray[np.bool_], settings: AffinitySettings = AffinitySettings()
) -> NDArray[np.int32]:
    """(S,): the connected component of each superpixel, numbered from 0; -1 where not valid."""
    joined = graph.edges[graph.affinity >= settings.threshold]
    adjacency = coo_array((np.ones(len(joined), np.int8), (joined[:, 0], joined[:, 1])), shape=(len(valid), len(valid)))
    _, component = connected_components(adjacency, directed=False)
    result = np.full(len(valid), -1, np.int32)
    _, result[valid] = np.unique(component[valid], return_inverse=True)
    return result


def _half_disc(radius: int) -> list[tuple[int, int]]:
    """Steps (down, right) to the pixels within the radius, one of every two opposite ones."""
    return [
        (down, right)
        for down in range(radius + 1)
        for right in range(-radius, radius + 1)
        if (down, right) > (0, 0) and down**2 + right**2 <= radius**2
    ]


def _shifted(shape: tuple[int, ...], down: int, right: int) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    height, width = shape
    here = slice(0, max(0, height - down)), slice(max(0, -right), max(0, width - max(0, right)))
    there = slice(down, height), slice(max(0, right), width + min(0, right))
    return here, there


def _key(one: NDArray[np.int32], other: NDArray[np.int32], count: int) -> NDArray[np.int64]:
    low, high = np.minimum(one, other).astype(np.int64), np.maximum(one, other)
    return np.asarray(low * count + high)
