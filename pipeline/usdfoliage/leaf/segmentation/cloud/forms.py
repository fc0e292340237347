"""What regions of a cloud look like: by it leaves, stems, parts of leaves and several leaves differ."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usdfoliage.leaf.segmentation.cloud.merge_tree import Links, MergeTree
from usdfoliage.leaf.segmentation.cloud.working_cloud import WorkingCloud

_BATCH = 1 << 19  # points that are measured at once
_LITTLE = 1.05  # times as many points as before, up to which a region is the one that it was
_MUCH = 1.1
_PART = 0.2  # of a region's points, from which what it is joined with is a part and no crumb
_DIRECTIONS = 12  # in which the width of a region is taken
_OFF = 2.0  # mean distances from the surface beyond which points count little
_RIDGE = 1e-5  # of the normal equations, so that few points have a surface too


class _Groups(NamedTuple):
    """P points, region after region."""

    begin: NDArray[np.int64]  # (R,), where the points of each region begin
    size: NDArray[np.int64]  # (R,), how many they are

    @property
    def of_point(self) -> NDArray[np.int64]:
        """(P,), the region of each point."""
        return np.repeat(np.arange(len(self.size)), self.size)

    def total(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """(R, ...), sums of values (P, ...)."""
        return np.asarray(np.add.reduceat(values, self.begin, axis=0))

    def mean(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """(R, ...), means of values (P, ...)."""
        return np.asarray(self.total(values) / self.size.reshape(-1, *[1] * (values.ndim - 1)))


@dataclass(frozen=True, kw_only=True, eq=False)
class RegionForms:
    """R regions, nodes of a tree."""

    node: NDArray[np.int64]  # (R,), rising
    count: NDArray[np.int64]  # (R,), points
    open: NDArray[np.float64]  # (R,), links that lead out, in the root of its points: small where it stands free
    joint: NDArray[np.float64]  # (R,), linkage of the last two large parts that it was joined of: small at a neck
    beyond: NDArray[np.float64]  # (R,), linkage with the next large part that it is joined with
    roughness: NDArray[np.float64]  # (R,), distance of points from a bent surface, in the typical thickness
    fill: NDArray[np.float64]  # (R,), area of the points to that of their convex hull
    slimness: NDArray[np.float64]  # (R,), width to length
    depth: NDArray[np.float64]  # (R,), thickness to width, bends included
    turning: NDArray[np.float64]  # (R,), 0 where all normals are parallel to 2/3 where they point anywhere
    straightness: NDArray[np.float64]  # (R,), mean of the points': near 1 of thin stems
    roundness: NDArray[np.float64]  # (R,), strongest bend times width: 2 pi of a whole cylinder
    length_m: NDArray[np.float64]  # (R,), four standard deviations of the points along the longest axis
    width_m: NDArray[np.float64]  # (R,), likewise across it
    area_m2: NDArray[np.float64]  # (R,), of the convex hull

    def __len__(self) -> int:
        return len(self.node)


def measure_regions(cloud: WorkingCloud, links: Links, tree: MergeTree, min_points: int) -> RegionForms:
    """Measure every region that could be a leaf: those that grow by crumbs alone are measured where they have grown."""
    node = _measured(tree, min_points)
    joint, beyond = _linkages(tree)
    parts = [_measure(cloud, tree, batch) for batch in _batches(tree, node)]
    shapes = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]} if parts else _no_shapes()
    count = tree.count[node]
    return RegionForms(
        node=node,
        count=count,
        open=_links_out(links, tree)[node] / np.sqrt(np.maximum(count, 1)),
        joint=joint[node],
        beyond=beyond[node],
        **shapes,
    )


def _measured(tree: MergeTree, min_points: int) -> NDArray[np.int64]:
    """Nodes (R,) that differ from those that were measured before them."""
    chosen = np.zeros(len(tree), bool)
    last = np.zeros(len(tree))  # points of the last one that was measured within each
    grows = np.where(tree.parent >= 0, tree.count[tree.parent], np.inf) > _LITTLE * tree.count
    for span in tree.spans():
        before = last[tree.children[span]].max(axis=1)
        count = tree.count[span]
        now = (count >= min_points) & (grows[span] | (count > _MUCH * before))
        chosen[span] = now
        last[span] = np.where(now, count, before)
    return np.flatnonzero(chosen)


def _linkages(tree: MergeTree) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(M,) linkage of the last large parts of each node, and that with the next large part that it is joined with."""
    joint, beyond = np.full(len(tree), np.inf), np.zeros(len(tree))
    for span in tree.spans():
        larger, smaller = tree.children[span].T
        is_part = tree.count[smaller] >= _PART * tree.count[span]
        joint[span] = np.where(is_part, tree.linkage[span], joint[larger])
    for span in tree.spans()[::-1]:
        made = np.arange(span.start, span.stop)
        larger, smaller = tree.children[span].T
        beyond[smaller] = tree.linkage[span]
        is_part = tree.count[smaller] >= _PART * tree.count[larger]
        beyond[larger] = np.where(is_part, tree.linkage[span], beyond[made])
    return joint, beyond


def _links_out(links: Links, tree: MergeTree) -> NDArray[np.float64]:
    """(M,), sum of the links from each node to points that are not in it."""
    out = np.zeros(len(tree))
    for end in (links.first, links.second):
        out[: tree.points] += np.bincount(end, links.weight, tree.points)
    for span in tree.spans():
        out[span] = out[tree.children[span]].sum(axis=1) - 2 * tree.across[span]
    return out


def _batches(tree: MergeTree, node: NDArray[np.int64]) -> Iterator[NDArray[np.int64]]:
    ends = np.cumsum(tree.count[node])
    begin = 0
    while begin < len(node):
        before = ends[begin - 1] if begin else 0
        end = max(int(np.searchsorted(ends, before + _BATCH, side="right")), begin + 1)
        yield node[begin:end]
        begin = end


def _measure(cloud: WorkingCloud, tree: MergeTree, node: NDArray[np.int64]) -> dict[str, NDArray[np.float64]]:
    """The shapes of some nodes."""
    count = tree.count[node]
    groups = _Groups(begin=np.cumsum(count) - count, size=count)
    region, total, mean = groups.of_point, groups.total, groups.mean
    point = tree.order[np.arange(len(region)) - (groups.begin - tree.start[node])[region]]
    local = cloud.points_m[point]
    local = local - mean(local)[region]
    variance, axes = np.linalg.eigh(_moments(local, groups))
    variance = np.maximum(variance, 1e-30)
    placed = np.einsum("ni,nij->nj", local, axes[region])  # height, across, along
    size_m = np.sqrt(variance[:, 2])
    roughness_m, bend = _bent_surfaces(placed / size_m[region, None], groups)
    directions = np.arange(_DIRECTIONS) * np.pi / _DIRECTIONS
    turned = placed[:, 1:] @ np.array([np.sin(directions), np.cos(directions)])
    reach = np.concatenate(
        [np.maximum.reduceat(turned, groups.begin), -np.minimum.reduceat(turned, groups.begin)], axis=1
    )
    extent_m = reach[:, :_DIRECTIONS] + reach[:, _DIRECTIONS:]
    along_m, across_m = extent_m[:, 0], extent_m[:, _DIRECTIONS // 2]
    step = np.pi / _DIRECTIONS
    sides = (np.roll(reach, 1, axis=1) + np.roll(reach, -1, axis=1) - 2 * reach * np.cos(step)) / np.sin(step)
    hull_m2 = np.maximum(0.5 * np.einsum("rk,rk->r", reach, sides), 1e-30)
    normals = cloud.normals[point]
    return {
        "roughness": roughness_m * size_m / cloud.thickness_m,
        "fill": total(cloud.area_m2[point]) / hull_m2,
        "slimness": across_m / np.maximum(along_m, 1e-30),
        "depth": np.sqrt(variance[:, 0] / variance[:, 1]),
        "turning": 1 - np.linalg.eigvalsh(_moments(normals, groups))[:, 2],
        "straightness": mean(cloud.straightness[point]),
        "roundness": bend * across_m / size_m,
        "length_m": 4 * size_m,
        "width_m": 4 * np.sqrt(variance[:, 1]),
        "area_m2": hull_m2,
    }


def _moments(vectors: NDArray[np.float64], groups: _Groups) -> NDArray[np.float64]:
    """(R, 3, 3), mean outer products of vectors (P, 3)."""
    return groups.mean(np.einsum("ni,nj->nij", vectors, vectors))


def _bent_surfaces(placed: NDArray[np.float64], groups: _Groups) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(R,) distance of points from the surface z = quadratic in x and y of each region, and its strongest bend.

    Args:
        placed: (P, 3), z, y and x of the points, about their middle.
        groups: Which region they are of.
    """
    region, total, mean = groups.of_point, groups.total, groups.mean
    z, y, x = placed.T
    powers = np.column_stack([np.ones(len(x)), x, y, x * x, x * y, y * y])
    products = np.einsum("ni,nj->nij", powers, powers)
    weights = np.ones(len(x))
    for number in range(2):
        left = total(weights[:, None, None] * products)
        left += _RIDGE * np.einsum("rii->r", left)[:, None, None] / 6 * np.eye(6)
        surface = np.linalg.solve(left, total((weights * z)[:, None] * powers)[..., None])[..., 0]
        off = np.abs(z - np.einsum("ni,ni->n", powers, surface[region]))
        if number == 0:
            weights = 1 / np.square(1 + np.square(off / (_OFF * np.maximum(mean(off), 1e-12))[region]))
    roughness = np.sqrt(mean(np.square(np.minimum(off, (5 * np.maximum(mean(off), 1e-12))[region]))))
    straight, twisted, crossed = surface[:, 3], surface[:, 4] / 2, surface[:, 5]
    middle, half = straight + crossed, np.hypot(straight - crossed, 2 * twisted)
    return roughness, np.maximum(np.abs(middle + half), np.abs(middle - half))


def _no_shapes() -> dict[str, NDArray[np.float64]]:
    of_nodes = {"node", "count", "open", "joint", "beyond"}
    return {name: np.zeros(0) for name in RegionForms.__dataclass_fields__ if name not in of_nodes}
