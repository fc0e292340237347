"""Arguments of the native leaf functions: checked, in double precision, one piece of memory."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def checked_leaves(parameters: NDArray[np.floating]) -> NDArray[np.float64]:
    """The parameters as the native functions take them.

    Raises:
        ValueError: They are not (N, 7, 3).
    """
    leaves = np.ascontiguousarray(parameters, np.float64)
    if leaves.ndim != 3 or leaves.shape[1:] != (7, 3):
        raise ValueError(f"parameters must be (N, 7, 3), not {leaves.shape}")
    return leaves


def checked_placements(
    leaves: NDArray[np.float64], placements: NDArray[np.floating] | None
) -> NDArray[np.float64] | None:
    """The placements of these leaves as the native functions take them.

    Raises:
        ValueError: They are not (N, 3, 4).
    """
    if placements is None:
        return None
    matrices = np.ascontiguousarray(placements, np.float64)
    if matrices.shape != (len(leaves), 3, 4):
        raise ValueError(f"placements must be ({len(leaves)}, 3, 4), not {matrices.shape}")
    return matrices


def checked_places(leaves: NDArray[np.float64], uv: NDArray[np.float64]) -> NDArray[np.float64]:
    """uv as (N, P, 2), or as (1, P, 2) for all leaves."""
    if uv.ndim not in (2, 3) or uv.shape[-1] != 2 or (uv.ndim == 3 and len(uv) != len(leaves)):
        raise ValueError(f"uv must be (P, 2) or ({len(leaves)}, P, 2), not {uv.shape}")
    return np.ascontiguousarray(uv if uv.ndim == 3 else uv[None])


def checked_axis_places(parameters: NDArray[np.floating], v: ArrayLike) -> NDArray[np.float64]:
    """v as (N, P), or as (1, P) for all leaves."""
    places = np.asarray(v, np.float64)
    if places.ndim not in (1, 2) or (places.ndim == 2 and len(places) != len(parameters)):
        raise ValueError(f"v must be (P,) or ({len(parameters)}, P), not {places.shape}")
    return np.ascontiguousarray(places if places.ndim == 2 else places[None])
