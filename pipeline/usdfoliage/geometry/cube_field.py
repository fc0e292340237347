"""Smoothing and Poisson problems for a field on a cubemap, across the borders of its faces.

The cubemap's distinct texels (shared border texels once) are the vertices of a graph, neighbours along rows and columns
its edges; nothing here knows of faces, so that nothing can show a seam.
"""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, cg, splu

from usdfoliage.geometry.cubemap import face_directions, sample_cubemap, texel_identity

COARSE_SIZE = 40  # below this a direct solution is cheapest
ENLARGING_VARIANCE = 1.45  # square texels of the larger cubemap that reducing and enlarging blur
SMOOTHING_STEPS = 40  # of conjugate gradients on each finer cubemap: the coarse solution already holds what is smooth


@lru_cache(maxsize=4)
def _graph(size: int) -> tuple[NDArray[np.int64], NDArray[np.int64], sparse.csr_array]:
    """Identity of each texel, one texel of each identity, adjacency of the distinct texels."""
    identity = texel_identity(size)
    flat = identity.ravel()
    representative = np.empty(flat.max() + 1, np.int64)
    representative[flat[::-1]] = np.arange(len(flat))[::-1]
    along_row = np.stack([identity[:, :, :-1].ravel(), identity[:, :, 1:].ravel()])
    along_column = np.stack([identity[:, :-1].ravel(), identity[:, 1:].ravel()])
    count = len(representative)
    low, high = np.sort(np.concatenate([along_row, along_column], axis=1), axis=0)
    once = np.sort(low * count + high)
    once = once[np.append(True, np.diff(once) > 0)]  # an edge on a border is seen by two faces
    pairs = np.stack([once // count, once % count])
    both = np.concatenate([pairs, pairs[::-1]], axis=1)
    adjacency = sparse.csr_array((np.ones(both.shape[1]), (both[0], both[1])), shape=(count, count))
    return identity, representative, adjacency


def distinct_texels(field: NDArray[np.floating]) -> NDArray[np.float64]:
    """Values (M,) of a cubemap (6, N, N), shared border texels once."""
    _, representative, _ = _graph(field.shape[1])
    return np.asarray(field.reshape(-1)[representative], dtype=np.float64)


def cubemap_from_distinct(values: NDArray[np.float64], size: int) -> NDArray[np.float64]:
    """The cubemap (6, N, N) of distinct values (M,)."""
    identity, _, _ = _graph(size)
    return np.asarray(values[identity])


def blur_cubemap(field: NDArray[np.floating], sigma: float) -> NDArray[np.float64]:
    """A cubemap (6, N, N) blurred by a Gaussian of sigma texels, by diffusion on the cube.

    Raises:
        ValueError: sigma is negative or not finite.
    """
    if not (np.isfinite(sigma) and sigma >= 0):
        raise ValueError(f"sigma must be zero or positive, not {sigma}")
    return weighted_blurs(field, (sigma,), (1.0,))


def weighted_blurs(
    field: NDArray[np.floating], sigmas: Sequence[float], weights: Sequence[float]
) -> NDArray[np.float64]:
    """Σ weights_k · (field blurred by sigmas_k): the levels of a Gaussian pyramid added up, (6, N, N).

    Each level is blurred on from the one before, on a reduced cubemap as soon as that shows nothing of it, and what is
    wide is added up before it is enlarged, so that the full size is worked on only for what is fine.

    Args:
        field: (6, N, N).
        sigmas: in texels, ascending.
        weights: one a level.

    Raises:
        ValueError: sigmas do not ascend from zero.
    """
    if len(sigmas) != len(weights) or np.any(np.diff(sigmas) < 0) or min(sigmas) < 0:
        raise ValueError(f"sigmas must ascend from zero, with a weight each, not {sigmas} and {weights}")
    size = field.shape[1]
    levels = []  # (cubemap, weight), each smaller than or as large as the one before
    current, variance = np.asarray(field, dtype=np.float64), 0.0  # variance in texels of current
    texel = 1.0  # of current, in texels of field
    for sigma, weight in zip(sigmas, weights, strict=True):
        wanted = (sigma / texel) ** 2
        while wanted - variance > 6 and current.shape[1] >= 2 * COARSE_SIZE:
            before = max(0.0, 1.2**2 - variance)  # against aliasing
            half = current.shape[1] // 2
            ratio = (current.shape[1] - 1) / (half - 1)
            current = sample_cubemap(_diffuse(current, float(np.sqrt(before))), face_directions(half))
            variance = (variance + before + ENLARGING_VARIANCE) / ratio**2
            texel *= ratio
            wanted = (sigma / texel) ** 2
        current = _diffuse(current, float(np.sqrt(max(wanted - variance, 0))))
        variance = max(variance, wanted)
        levels.append((current, weight))
    total = np.zeros_like(levels[-1][0])
    for level, weight in reversed(levels):
        while total.shape[1] < level.shape[1]:
            larger = _next_larger(size, total.shape[1])
            total = _diffuse(sample_cubemap(total, face_directions(larger)), 0.8)
        total = total + weight * level
    while total.shape[1] < size:
        larger = _next_larger(size, total.shape[1])
        total = _diffuse(sample_cubemap(total, face_directions(larger)), 0.8)
    return total


def _next_larger(size: int, smaller: int) -> int:
    """The one of size, size // 2, … whose half is smaller."""
    while size // 2 > smaller:
        size //= 2
    return size


def _diffuse(field: NDArray[np.floating], sigma: float) -> NDArray[np.float64]:
    """Explicit steps of the heat equation: n steps of weight t add a variance of 2 n t a direction."""
    size = field.shape[1]
    _, _, adjacency = _graph(size)
    steps = int(np.ceil(sigma**2 / (2 * 0.2)))
    values = distinct_texels(field)
    if steps == 0:
        return cubemap_from_distinct(values, size)
    weight = sigma**2 / (2 * steps)
    degree = np.asarray(adjacency.sum(axis=1)).ravel()
    for _ in range(steps):
        values += weight * (adjacency @ values - degree * values)
    return cubemap_from_distinct(values, size)


@lru_cache(maxsize=4)
def _neighbors(size: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Four neighbours (M, 4) of every distinct texel, itself where it has three, and the angles between, radians."""
    _, representative, adjacency = _graph(size)
    degree = np.diff(adjacency.indptr)
    neighbors = np.repeat(np.arange(len(degree))[:, None], 4, axis=1)
    owner = np.repeat(np.arange(len(degree)), degree)
    neighbors[owner, np.arange(len(owner)) - adjacency.indptr[owner]] = adjacency.indices
    directions = face_directions(size).reshape(-1, 3)[representative]
    chord = np.linalg.norm(directions[:, None] - directions[neighbors], axis=-1)
    return neighbors, 2 * np.arcsin(chord / 2)


def close_pits(field: NDArray[np.floating], width_rad: float) -> NDArray[np.float64]:
    """A cubemap (6, N, N) without pits narrower than width_rad: the grey closing on the cube.

    The opening, which takes peaks away, is that of the negative field, and negative.
    """
    size = field.shape[1]
    neighbors, angle = _neighbors(size)
    values = distinct_texels(field)
    steps = round(width_rad / 2 / float(np.median(angle)))
    for _ in range(steps):
        values = np.maximum(values, values[neighbors].max(axis=1))
    for _ in range(steps):
        values = np.minimum(values, values[neighbors].min(axis=1))
    return cubemap_from_distinct(values, size)


def limit_falloff(field: NDArray[np.floating], rate: float) -> NDArray[np.float64]:
    """The least cubemap (6, N, N), nowhere below a positive one, that falls by no more than exp(−rate · radian)."""
    size = field.shape[1]
    neighbors, angle = _neighbors(size)
    values, left = distinct_texels(field), np.exp(-rate * angle)
    while True:
        raised = np.maximum(values, (values[neighbors] * left).max(axis=1))
        if np.array_equal(raised, values):
            return cubemap_from_distinct(values, size)
        values = raised


def solve_dirichlet(
    source: NDArray[np.floating], fixed: NDArray[np.bool_], value: NDArray[np.floating], tolerance: float = 1e-3
) -> NDArray[np.float64]:
    """Solve Σ_q (x_p − x_q) = source_p over the neighbours q of every free texel p, with x = value where fixed.

    A coarse cubemap is solved directly and starts conjugate gradients on the next finer one.

    Args:
        source: (6, N, N), in units of the field per square texel.
        fixed: (6, N, N), where value holds; at least one texel.
        value: (6, N, N).
        tolerance: of the residual, relative to that of the starting values' scale.

    Raises:
        ValueError: Nothing is fixed.
    """
    if not fixed.any():
        raise ValueError("a Poisson problem on a closed surface needs at least one fixed texel")
    size = source.shape[1]
    identity, _, adjacency = _graph(size)
    # A texel is fixed on every face that shows it.
    is_fixed = np.zeros(adjacency.shape[0], bool)
    is_fixed[identity[fixed]] = True
    values = np.zeros(adjacency.shape[0])
    values[identity[fixed]] = value[fixed]
    free = np.nonzero(~is_fixed)[0]
    degree = np.asarray(adjacency.sum(axis=1)).ravel()
    laplacian = (sparse.diags_array(degree) - adjacency).tocsr()
    matrix = laplacian[free][:, free]
    right = distinct_texels(source)[free] - laplacian[free][:, np.nonzero(is_fixed)[0]] @ values[is_fixed]
    half = (size + 1) // 2
    if half < COARSE_SIZE:
        lu = splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        values[free] = lu.solve(right)
        return cubemap_from_distinct(values, size)
    directions = face_directions(half)
    ratio = (size - 1) / (half - 1)
    # A coarse texel is fixed when a fixed one lies within it, so that a thin fixed line has no gaps.
    near = sample_cubemap(_diffuse(fixed.astype(np.float64), 0.7), directions)
    amount = sample_cubemap(_diffuse(np.where(fixed, value, 0.0), 0.7), directions)
    coarse_fixed = near > 0.15
    if not coarse_fixed.any():
        coarse_fixed = near >= near.max()
    coarse_value = np.where(coarse_fixed, amount / np.maximum(near, 1e-12), 0.0)
    coarse = solve_dirichlet(sample_cubemap(source, directions) * ratio**2, coarse_fixed, coarse_value, tolerance)
    start = distinct_texels(sample_cubemap(coarse, face_directions(size)))[free]
    inverse_diagonal = 1 / degree[free]
    precondition = LinearOperator(matrix.shape, matvec=lambda v: inverse_diagonal * v, dtype=np.float64)
    scale = float(np.linalg.norm(right)) or 1.0
    solution, _ = cg(matrix, right, x0=start, rtol=0.0, atol=tolerance * scale, maxiter=SMOOTHING_STEPS, M=precondition)
    values[free] = solution
    return cubemap_from_distinct(values, size)
