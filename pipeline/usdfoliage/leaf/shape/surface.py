"""The leaf as a surface: points, tangents, normals and derivatives from the 21 parameters.

The algebra is written down once in the native extension (leaf/curves.h) and once in usdFoliageLeaf.glslfx for Storm.
Every function takes leaves as (N, 7, 3), zero leaves too, uses at most `threads` threads, 0 for one per core, and gives
the same numbers for any number of them.

Source:
    Chaurasia and Beardsley, Editable Parametric Dense Foliage from 3D Capture, section 3, equations 3 to 6.
"""

from dataclasses import dataclass
from typing import Any, TypeVar, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from usdfoliage import _native
from usdfoliage.leaf.shape.jitter import NO_JITTER, WAVES, Jitter
from usdfoliage.leaf.shape.native_arguments import (
    checked_axis_places,
    checked_leaves,
    checked_placements,
    checked_places,
)

LEFT_OF_AXIS = -1e-12  # u at which the left half's tangents and normals hold, and no coordinate differs

Real = TypeVar("Real", np.float32, np.float64)


@dataclass(frozen=True, kw_only=True, eq=False)
class LeafGrid:
    """N leaves at every (u, v) of a grid; V rows from base to apex, U columns from left to right."""

    points: NDArray[np.float64]  # (N, V, U, 3)
    tangents_u: NDArray[np.float64]  # (N, V, U, 3), derivatives by u; those of the right half at u = 0
    tangents_v: NDArray[np.float64]  # (N, V, U, 3), derivatives by v
    normals: NDArray[np.float64]  # (N, V, U, 3), unit, towards +z for a flat leaf; at base and apex the limit


def axis_points(parameters: NDArray[np.floating], v: ArrayLike, *, threads: int = 0) -> NDArray[np.float64]:
    """A(v): (N, P, 3) from parameters (N, 7, 3) and v (P,) or (N, P)."""
    leaves, places = checked_leaves(parameters), checked_axis_places(parameters, v)
    points = np.empty((len(leaves), places.shape[1], 3))
    _native.leaf_axes(leaves, places, shared=np.ndim(v) == 1, points=points, threads=threads)
    return points


def axis_normals(parameters: NDArray[np.floating], v: ArrayLike, *, threads: int = 0) -> NDArray[np.float64]:
    """n(v): unit normals of the axis in the leaf's plane, +x for a straight axis; (0, 0, 0) where it stands upright."""
    leaves, places = checked_leaves(parameters), checked_axis_places(parameters, v)
    normals = np.empty((len(leaves), places.shape[1], 3))
    _native.leaf_axes(leaves, places, shared=np.ndim(v) == 1, normals=normals, threads=threads)
    return normals


def leaf_nets(parameters: NDArray[np.floating], *, threads: int = 0) -> NDArray[np.float64]:
    """Control nets of the leaves: (N, 5, 7, 3) from parameters (N, 7, 3), in leaf space.

    Rows are the quartic along v from base to apex, columns from left to right: the silhouette, outer and inner curve of
    the left half, the axis raised to degree four, and those of the right half. The surface is a cubic in |u| over the
    columns of either half.
    """
    leaves = checked_leaves(parameters)
    nets = np.empty((len(leaves), 5, 7, 3))
    _native.leaf_nets(leaves, nets=nets, threads=threads)
    return nets


def grid_places(u: ArrayLike, v: ArrayLike) -> NDArray[np.float64]:
    """The (u, v) of a grid as a list: (V * U, 2) from u (U,) and v (V,), row by row from base to apex."""
    across, along = np.meshgrid(np.asarray(u, np.float64), np.asarray(v, np.float64))
    return np.stack([across.ravel(), along.ravel()], axis=-1)


def evaluate_grid(
    parameters: NDArray[np.floating],
    u: ArrayLike,
    v: ArrayLike,
    jitter: Jitter = NO_JITTER,
    phase: ArrayLike | None = None,
    *,
    placements: NDArray[np.floating] | None = None,
    threads: int = 0,
) -> LeafGrid:
    """Evaluate leaves (N, 7, 3) at u (U,) in [-1, 1] and v (V,) in [0, 1]; evaluate_points does less and is faster.

    Args:
        phase: (N,), where on the jitter's wave each leaf begins, in cycles; 0 by default.
        placements: (N, 3, 4), for column vectors, as Leaves.asset_from_leaf gives; leaf space without.

    Raises:
        ValueError: A shape is wrong.
    """
    leaves, places = checked_leaves(parameters), grid_places(u, v)
    shape = (len(leaves), np.size(v), np.size(u), 3)
    points, tangents_u, tangents_v, normals = (np.empty(shape) for _ in range(4))
    outputs = (points, tangents_u, tangents_v, normals, None)
    _fill_samples(leaves, places, jitter, phase, placements, outputs, threads)
    return LeafGrid(points=points, tangents_u=tangents_u, tangents_v=tangents_v, normals=normals)


@overload
def evaluate_points(
    parameters: NDArray[np.floating],
    uv: ArrayLike,
    jitter: Jitter = ...,
    phase: ArrayLike | None = ...,
    *,
    placements: NDArray[np.floating] | None = ...,
    threads: int = ...,
) -> NDArray[np.float64]: ...


@overload
def evaluate_points(
    parameters: NDArray[np.floating],
    uv: ArrayLike,
    jitter: Jitter = ...,
    phase: ArrayLike | None = ...,
    *,
    placements: NDArray[np.floating] | None = ...,
    threads: int = ...,
    dtype: type[Real],
) -> NDArray[Real]: ...


def evaluate_points(
    parameters: NDArray[np.floating],
    uv: ArrayLike,
    jitter: Jitter = NO_JITTER,
    phase: ArrayLike | None = None,
    *,
    placements: NDArray[np.floating] | None = None,
    threads: int = 0,
    dtype: type[np.floating] = np.float64,
) -> NDArray[Any]:
    """Points (N, P, 3) of leaves (N, 7, 3) at uv (P, 2), the same for all leaves, or (N, P, 2).

    Places that follow each other at one v cost less. The arithmetic is in double precision for either dtype.

    Args:
        phase: (N,), where on the jitter's wave each leaf begins, in cycles; 0 by default.
        placements: (N, 3, 4), for column vectors, as Leaves.asset_from_leaf gives; leaf space without.

    Raises:
        ValueError: A shape is wrong.
    """
    leaves, places = checked_leaves(parameters), np.asarray(uv, np.float64)
    points = np.empty((len(leaves), *places.shape[-2:-1], 3), dtype)
    _fill_samples(leaves, places, jitter, phase, placements, (points, None, None, None, None), threads)
    return points


@overload
def evaluate_normals(
    parameters: NDArray[np.floating],
    uv: ArrayLike,
    jitter: Jitter = ...,
    phase: ArrayLike | None = ...,
    *,
    placements: NDArray[np.floating] | None = ...,
    threads: int = ...,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...


@overload
def evaluate_normals(
    parameters: NDArray[np.floating],
    uv: ArrayLike,
    jitter: Jitter = ...,
    phase: ArrayLike | None = ...,
    *,
    placements: NDArray[np.floating] | None = ...,
    threads: int = ...,
    dtype: type[Real],
) -> tuple[NDArray[Real], NDArray[Real]]: ...


def evaluate_normals(
    parameters: NDArray[np.floating],
    uv: ArrayLike,
    jitter: Jitter = NO_JITTER,
    phase: ArrayLike | None = None,
    *,
    placements: NDArray[np.floating] | None = None,
    threads: int = 0,
    dtype: type[np.floating] = np.float64,
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Points and unit normals, (N, P, 3) each, with the arguments of evaluate_points.

    Normals look towards +z for a flat leaf; at base and apex they are the limit.
    """
    leaves, places = checked_leaves(parameters), np.asarray(uv, np.float64)
    points, normals = (np.empty((len(leaves), *places.shape[-2:-1], 3), dtype) for _ in range(2))
    _fill_samples(leaves, places, jitter, phase, placements, (points, None, None, normals, None), threads)
    return points, normals


def evaluate_area_elements(parameters: NDArray[np.floating], uv: ArrayLike, *, threads: int = 0) -> NDArray[np.float64]:
    """|dL/du x dL/dv|, area a unit of (u, v): (N, P) of leaves (N, 7, 3) at uv (P, 2) or (N, P, 2)."""
    leaves, places = checked_leaves(parameters), np.asarray(uv, np.float64)
    areas = np.empty((len(leaves), *places.shape[-2:-1]))
    _fill_samples(leaves, places, NO_JITTER, None, None, (None, None, None, None, areas), threads)
    return areas


def evaluate_jacobian(
    parameters: NDArray[np.floating], uv: ArrayLike, *, threads: int = 0
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points (N, P, 3) and their derivatives (N, P, 3, 21) by the parameters.

    The last axis is parameters.reshape(N, 21): row after row of usdfoliage.leaf.model.PARAMETERS. Where the axis stands
    upright its normal has no derivative and is kept fixed.

    Args:
        uv: (P, 2), the same for all leaves, or (N, P, 2).

    Raises:
        ValueError: A shape is wrong.
    """
    leaves = checked_leaves(parameters)
    places = checked_places(leaves, np.asarray(uv, np.float64))
    points = np.empty((len(leaves), places.shape[1], 3))
    jacobian = np.empty((len(leaves), places.shape[1], 3, 21))
    _native.leaf_jacobians(leaves, places, shared=np.ndim(uv) == 2, points=points, jacobians=jacobian, threads=threads)
    return points, jacobian


_Output = NDArray[np.float32] | NDArray[np.float64] | None


def _fill_samples(
    leaves: NDArray[np.float64],
    places: NDArray[np.float64],
    jitter: Jitter,
    phase: ArrayLike | None,
    placements: NDArray[np.floating] | None,
    outputs: tuple[_Output, _Output, _Output, _Output, _Output],
    threads: int,
) -> None:
    """Write points, tangents by u, tangents by v, normals and areas, those that are given."""
    phases = None if phase is None else np.ascontiguousarray(phase, np.float64)
    if phases is not None and phases.shape != (len(leaves),):
        raise ValueError(f"phase must be ({len(leaves)},), not {phases.shape}")
    matrices = checked_placements(leaves, placements)
    wave = None if jitter.map is None else np.ascontiguousarray(jitter.map, np.float64)
    points, tangents_u, tangents_v, normals, areas = outputs
    _native.leaf_samples(
        leaves,
        checked_places(leaves, places),
        shared=places.ndim == 2,
        jitter=_native.LeafJitter(
            amplitude=jitter.amplitude, frequency=jitter.frequency, waves=np.array(WAVES), map=wave, phases=phases
        ),
        placements=matrices,
        points=points,
        tangents_u=tangents_u,
        tangents_v=tangents_v,
        normals=normals,
        areas=areas,
        threads=threads,
    )
