"""Whether depth and poses are in the same unit: metres taken for millimetres, or a reconstruction without scale."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.folder.listing import named
from usdfoliage.capture.view import View
from usdfoliage.remarks import Remark, Remedy, Setting, remark

_MIN_SAMPLES = 20  # 3-D points on depth that a median is worth
_AGREEMENT = 1.25  # factor that occlusion and noise leave between the depth and the 3-D points
_PLAUSIBLE = 30.0  # factor between the depth and the place that the cameras look at, which may be a tree before a hill
_PLAUSIBLE_SPREAD = 300.0  # factor between the depth and the spread of cameras that look one way
_NEAR_THOUSAND = 3.0  # factor around 1000 that is called millimetres
_NEAR_UNIT = 10**0.5  # factor around 100 or 1000 that is called centimetres or millimetres: half way between them
_UNITS = {1000: "millimetres", 100: "centimetres"}  # in a metre, that depth of some views may be in
_QUANTILES = (0.1, 0.5)  # of depth: both are off where the unit is, one where a view has more of what is far
_STRIDE = 7  # of pixels whose median is taken


def check_depth_scale(
    views: Sequence[View], points_m: NDArray[np.float64], metres_per_unit: float
) -> tuple[Remark, ...]:
    """Compare depth with the distances that the cameras give.

    By the points of the cameras' model where it has them, seen in the depth maps; else by the place that the cameras
    look at; else, for cameras that look one way, by their spread. Our own.

    Args:
        views: Those read, in metres.
        points_m: (N, 3), points of the model in the views' world; may be none.
        metres_per_unit: By which poses and points were multiplied, to name what it should be.

    Returns:
        A remark where they disagree, else nothing.
    """
    with_depth = [view for view in views if view.has_depth]
    if not with_depth:
        return ()
    ratios = np.concatenate([_depth_over_points(view, points_m) for view in with_depth])
    if len(ratios) >= _MIN_SAMPLES:
        return _compare(
            float(np.median(ratios)),
            _AGREEMENT,
            "the distance of the points in the cameras' model",
            metres_per_unit,
            True,
        )

    # From here on the scale is known to an order of magnitude only.
    expected, what, plausible = _expected_distance(views, with_depth)
    ratios = np.array([float(np.median(_samples(view))) for view in with_depth]) / expected
    ratios = ratios[np.isfinite(ratios) & (ratios > 0)]
    if not len(ratios):
        return ()
    return _compare(float(np.median(ratios)), plausible, what, metres_per_unit, False)


def leave_out_other_units(
    views: Sequence[View], points_m: NDArray[np.float64]
) -> tuple[tuple[View, ...], tuple[Remark, ...]]:
    """Take the depth from those views where it is in another unit than in most views.

    Two views are compared by the points of the cameras' model if both see enough of them, else by their depths. Our
    own.

    Args:
        views: Those read, in metres.
        points_m: (N, 3), points of the model in the views' world; may be none.

    Returns:
        The views in their order, the depth of the odd ones 0 everywhere; and a remark on each unit.
    """
    places = [place for place, view in enumerate(views) if view.has_depth]
    factors = _factors_between([views[place] for place in places], points_m)  # log
    agree = np.abs(factors) < np.log(_PLAUSIBLE)
    if agree.all():
        return tuple(views), ()
    largest = agree[agree.sum(axis=1).argmax()]
    if 2 * largest.sum() <= len(places):
        text = "the depth of the views is in different units, and no unit is that of most"
        return tuple(views), (remark("depth-units-mixed", text, remedy="give all depth in metres"),)

    kept = list(views)
    odd: dict[tuple[int, bool], list[str]] = {}
    for place, factor in zip(places, np.median(factors[:, largest], axis=1), strict=True):
        for unit in _UNITS:
            if abs(factor) >= np.log(_PLAUSIBLE) and abs(abs(factor) - np.log(unit)) < np.log(_NEAR_UNIT):
                odd.setdefault((unit, factor > 0), []).append(views[place].name)
                kept[place] = replace(views[place], depth_m=np.zeros_like(views[place].depth_m))
    remarks = []
    for (unit, larger), names in odd.items():
        times = f"{unit}" if larger else f"1/{unit}"
        whose = "it is" if larger else "that of the others is"
        text = (
            f"{named(names)}: the depth is about {times} times that of most views and is left out; "
            f"{whose} probably in {_UNITS[unit]}"
        )
        remarks.append(
            remark("depth-of-other-unit-left-out", text, subject=named(names), remedy="give all depth in metres")
        )
    return tuple(kept), tuple(remarks)


def _factors_between(views: Sequence[View], points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, N), logarithm of how many times the depth of a view (row) is that of another (column)."""
    by_points = np.full(len(views), np.nan)
    quantiles = np.zeros((len(views), len(_QUANTILES)))
    for place, view in enumerate(views):
        quantiles[place] = np.log(np.quantile(_samples(view), _QUANTILES))
        ratios = _depth_over_points(view, points_m)
        if len(ratios) >= _MIN_SAMPLES:
            by_points[place] = np.log(np.median(ratios))
    apart = quantiles[:, None] - quantiles[None]
    # The smaller of both where they have the same sign; else no other unit explains them.
    by_depth = np.where(np.prod(np.sign(apart), axis=2) > 0, np.abs(apart).min(axis=2), 0.0)
    by_depth *= np.sign(apart[..., 0])
    exact = by_points[:, None] - by_points[None]
    return np.where(np.isnan(exact), by_depth, exact)


def _samples(view: View) -> NDArray[np.float32]:
    """Some depths of a view, not 0."""
    depths = view.depth_m[::_STRIDE, ::_STRIDE]
    depths = depths[depths > 0]
    return depths if len(depths) else view.depth_m[view.depth_m > 0]


def _depth_over_points(view: View, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Depth where the model's points are seen, as a share of theirs."""
    if not len(points_m):
        return np.zeros(0)
    places, distance = view.camera.project(points_m)
    with np.errstate(invalid="ignore"):  # NaN behind the camera
        inside = (places >= 0).all(axis=1) & (places[:, 0] < view.camera.width_px)
        inside &= (places[:, 1] < view.camera.height_px) & (distance > 0)
    columns, rows = places[inside].astype(np.int64).T
    depths = view.depth_m[rows, columns]
    return np.asarray((depths / distance[inside])[depths > 0])


def _expected_distance(views: Sequence[View], chosen: Sequence[View]) -> tuple[NDArray[np.float64], str, float]:
    """How far away things should be in each chosen view (NaN: unknown), by what, and how far off that may be."""
    centers = np.array([view.camera.position_m for view in views])
    axes = np.array([view.camera.cam_from_world[2, :3] for view in views])
    # The place nearest to all optical axes: sum of (I - a aᵀ)(x - c) = 0.
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    normal = across.sum(axis=0)
    eigenvalues = np.linalg.eigvalsh(normal)
    if eigenvalues[0] > 1e-3 * eigenvalues[2]:  # the axes differ by some degrees
        place = np.linalg.solve(normal, np.einsum("nij,nj->i", across, centers))
        distance = np.array([view.camera.cam_from_world[2] @ (*place, 1.0) for view in chosen])
        if (distance > 0).mean() > 0.5:
            return (
                np.where(distance > 0, distance, np.nan),
                "the distance of the place that the cameras look at",
                _PLAUSIBLE,
            )
    spread = float(np.linalg.norm(centers.max(axis=0) - centers.min(axis=0)))
    known = np.nan if spread <= 1e-9 * float(np.abs(centers).max()) else spread
    return np.full(len(chosen), known), "the distance of the cameras from each other", _PLAUSIBLE_SPREAD


def _compare(ratio: float, plausible: float, what: str, metres_per_unit: float, exact: bool) -> tuple[Remark, ...]:
    """A remark where the ratio of depth to what the cameras give is not plausible."""
    if 1 / plausible < ratio < plausible:
        return ()
    likely = ""
    remedy: Remedy
    if 1000 / _NEAR_THOUSAND < ratio < 1000 * _NEAR_THOUSAND:
        likely = "; the depth is probably in millimetres, or the poses are in kilometres"
        remedy = ("give the depth in metres",)
    elif 1000 / _NEAR_THOUSAND < 1 / ratio < 1000 * _NEAR_THOUSAND:
        likely = "; the poses are probably in millimetres"
        remedy = "set ", Setting(name="capture.toml:metres_per_unit", value=f"{metres_per_unit / 1000:g}")
    elif exact:
        likely = "; the poses probably have another unit"
        remedy = "set ", Setting(name="capture.toml:metres_per_unit", value=f"{metres_per_unit * ratio:.4g}")
    else:
        remedy = (
            "give the depth in metres, and the unit of the poses as ",
            Setting(name="capture.toml:metres_per_unit"),
        )
    return (remark("depth-unit-differs", f"the depth is {ratio:.3g} times {what}{likely}", remedy=remedy),)
