"""Native kernels of usdfoliage; arrays in, arrays out, the interpreter lock released. Arguments are trusted."""

import numpy as np
from numpy.typing import NDArray

def refine_catmull_clark(
    points: NDArray[np.float64],
    face_counts: NDArray[np.int32],
    face_indices: NDArray[np.int32],
    crease_edges: NDArray[np.int32],
    crease_sharpness: NDArray[np.float32],
    corner_vertices: NDArray[np.int32],
    corner_sharpness: NDArray[np.float32],
    levels: int,
    limit: bool,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int32]]:
    """Refined points (V, 3), normals (V, 3; (0, 3) unless limit), quads (F, 4).

    Raises:
        ValueError: counts and indices do not fit, or OpenSubdiv refuses the topology.
    """

def radius_map(
    points: NDArray[np.float64], triangles: NDArray[np.int32], size: int, threads: int
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Farthest hit of each texel's ray from the origin: radius (6, N, N), 0 for none, and triangle, -1 for none."""

def cut_grid(down: NDArray[np.int32], right: NDArray[np.int32], terminal: NDArray[np.int32]) -> NDArray[np.uint8]:
    """Minimum cut of a grid: 0 for the first end, 1 for the second, which gets what either could have.

    Args:
        down: (H, W) capacity between a pixel and the next one below; from the last row to the first one.
        right: (H, W) the same to the right.
        terminal: (H, W) capacity to the first end where positive, to the second end where negative.
    """

def place_patches(
    exemplar: NDArray[np.int16],
    valid: NDArray[np.uint8],
    source: NDArray[np.int32],
    color: NDArray[np.int16],
    known: NDArray[np.uint8],
    patch: int,
    overlap: int,
    usage_weight: float,
    near_weight: float,
    candidate_share: float,
    cuts: int,
    seed: int,
    threads: int,
) -> int:
    """Fill source (H, W, 2) and color (H, W, 4) in place with patches of the exemplar (h, w, 4); their number."""

def refine_sources(
    exemplar: NDArray[np.int16],
    exemplar_guide: NDArray[np.int16],
    valid: NDArray[np.uint8],
    source: NDArray[np.int32],
    color: NDArray[np.int16],
    guide: NDArray[np.int16],
    known: NDArray[np.uint8],
    radius: int,
    guide_weight: int,
    random_tries: int,
    seed: int,
    threads: int,
) -> None:
    """One pass over source (H, W, 2) and color (H, W, 4), in place, towards neighbourhoods of the exemplar."""
