"""Best seam between two overlapping images: a minimum cut of the pixel grid."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import breadth_first_order, maximum_flow

# Added to the gradients that divide a cost, in units of the images (0..1): where both images are flat, a step between
# them counts as that many times more visible than in texture.
_GRADIENT_FLOOR = 0.02


def cut_seam(
    first: NDArray[np.floating],
    second: NDArray[np.floating],
    keep_first: NDArray[np.bool_],
    keep_second: NDArray[np.bool_],
    *,
    wrap: tuple[bool, bool] = (False, False),
    allowed: NDArray[np.bool_] | None = None,
) -> NDArray[np.bool_]:
    """Choose for every pixel of an overlap the image it comes from, so that the seam shows least.

    Args:
        first: (H, W, C) float, about 0..1, in the encoding in which differences are to be judged (sRGB, say).
        second: (H, W, C) float, laid over first.
        keep_first: (H, W) pixels that must come from first.
        keep_second: (H, W) pixels that must come from second.
        wrap: whether the last row touches the first row, and the last column the first column.
        allowed: (H, W) pixels that take part; the seam costs nothing where it passes between others, whose values
            are not looked at. All where None.

    Returns:
        (H, W) bool, True where second is taken; False outside allowed. Among equal cuts the one that takes most of
        second, so that a part of allowed that touches no constraint comes from second.

    Raises:
        ValueError: shapes disagree, values are not finite, a pixel is to be kept of both images, or an image has no
            pixel to keep (then there is no seam to find).

    Source:
        V. Kwatra et al., Graphcut Textures, SIGGRAPH 2003, sections 3 and 3.2 (costs divided by gradients).
    """
    part = np.ones(first.shape[:2], dtype=np.bool_) if allowed is None else allowed
    _check_overlap(first, second, keep_first, keep_second, part)

    # Nodes: 0 is all that first keeps, 1 all that second keeps, then the free pixels.
    node = np.zeros(part.shape, dtype=np.int64)
    free = part & ~keep_first & ~keep_second
    node[free] = np.arange(2, 2 + np.count_nonzero(free))
    node[keep_second] = 1

    sources, targets, costs = [], [], []
    for axis, cost in enumerate(seam_costs(first, second, wrap=wrap, allowed=part)):
        joined = _joined(part, axis, wrap[axis])
        sources.append(node[joined])
        targets.append(np.roll(node, -1, axis)[joined])
        costs.append(cost[joined])
    source, target = np.concatenate(sources), np.concatenate(targets)
    capacity = _integer_capacities(np.concatenate(costs), source, target)
    inner = source != target
    graph = _symmetric(source[inner], target[inner], capacity[inner], 2 + int(np.count_nonzero(free)))

    residual = csr_array(graph - maximum_flow(graph, 0, 1).flow)
    residual.eliminate_zeros()
    taken = np.ones(graph.shape[0], dtype=np.bool_)
    taken[breadth_first_order(residual, 0, return_predecessors=False)] = False
    return np.asarray(taken[node] & part)


def seam_costs(
    first: NDArray[np.floating],
    second: NDArray[np.floating],
    *,
    wrap: tuple[bool, bool] = (False, False),
    allowed: NDArray[np.bool_] | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What a seam pays to pass between a pixel and the next one down, and between it and the next one to the right.

    Returns:
        Two (H, W) arrays, (|A(s)−B(s)| + |A(t)−B(t)|) / (|∇A(s)| + |∇A(t)| + |∇B(s)| + |∇B(t)|) with ∇ along the step
        from s to t; 0 where there is no next pixel. Arguments as for cut_seam.
    """
    part = np.ones(first.shape[:2], dtype=np.bool_) if allowed is None else allowed
    a, b = (np.where(part[..., None], image, 0).astype(np.float64) for image in (first, second))
    difference = np.linalg.norm(a - b, axis=-1)
    down, right = (
        np.where(
            _joined(part, axis, wrap[axis]),
            (difference + np.roll(difference, -1, axis))
            / (_steps(a, part, axis, wrap[axis]) + _steps(b, part, axis, wrap[axis]) + _GRADIENT_FLOOR),
            0,
        )
        for axis in (0, 1)
    )
    return down, right


def _steps(image: NDArray[np.float64], part: NDArray[np.bool_], axis: int, wrap: bool) -> NDArray[np.float64]:
    """|∇(s)| + |∇(t)| of each step s, t along an axis; ∇ is the mean of the steps to both sides, so lines count."""
    step = np.linalg.norm(np.roll(image, -1, axis) - image, axis=-1) * _joined(part, axis, wrap)
    gradient = (step + np.roll(step, 1, axis)) / 2
    return np.asarray(gradient + np.roll(gradient, -1, axis))


def _joined(part: NDArray[np.bool_], axis: int, wrap: bool) -> NDArray[np.bool_]:
    """Pixels that have a next pixel along an axis."""
    joined = part & np.roll(part, -1, axis)
    if not wrap or part.shape[axis] == 1:
        joined[(slice(None), -1) if axis else (-1,)] = False
    return np.asarray(joined)


def _integer_capacities(
    cost: NDArray[np.float64], source: NDArray[np.int64], target: NDArray[np.int64]
) -> NDArray[np.int32]:
    """Costs as the integers that scipy's flow wants, as fine as 31 bits allow for one edge and for the whole flow."""
    at_ends = [float(cost[(source == end) != (target == end)].sum()) for end in (0, 1)]
    largest = max(min(at_ends), 4 * float(cost.max(initial=0)))  # four edges of a pixel may lead to the same end
    scale = min(2.0**24, 2.0**30 / largest) if largest > 0 else 1.0
    return np.asarray(np.rint(cost * scale), dtype=np.int32)


def _symmetric(
    source: NDArray[np.int64], target: NDArray[np.int64], capacity: NDArray[np.int32], n_nodes: int
) -> csr_array:
    rows, columns = np.concatenate([source, target]), np.concatenate([target, source])
    # Between the two ends lies no choice, and their sum could be too large for an integer.
    choice = (rows > 1) | (columns > 1)
    entries = (np.concatenate([capacity, capacity])[choice], (rows[choice], columns[choice]))
    graph = csr_array(coo_array(entries, shape=(n_nodes, n_nodes)))  # sums what runs between the same two nodes
    graph.indices, graph.indptr = graph.indices.astype(np.int32), graph.indptr.astype(np.int32)
    return graph


def _check_overlap(
    first: NDArray[np.floating],
    second: NDArray[np.floating],
    keep_first: NDArray[np.bool_],
    keep_second: NDArray[np.bool_],
    part: NDArray[np.bool_],
) -> None:
    if first.ndim != 3 or first.shape != second.shape:
        raise ValueError(f"first and second must be (H, W, C) alike, not {first.shape} and {second.shape}")
    for name, mask in (("keep_first", keep_first), ("keep_second", keep_second), ("allowed", part)):
        if mask.shape != first.shape[:2] or mask.dtype != np.bool_:
            raise ValueError(f"{name} must be bool {first.shape[:2]}, not {mask.dtype} {mask.shape}")
    if not (np.isfinite(first[part]).all() and np.isfinite(second[part]).all()):
        raise ValueError("the images of a seam must be finite")
    both = np.count_nonzero(keep_first & keep_second)
    if both:
        raise ValueError(f"{both} pixels are to be kept of both images")
    for name, mask in (("first", keep_first), ("second", keep_second)):
        if not (mask & part).any():
            raise ValueError(f"no pixel is to be kept of the {name} image, so there is no seam")
