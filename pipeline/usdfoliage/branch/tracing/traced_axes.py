"""Axes through the sections of a cloud, with radii, and the skeleton that they make."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.tracing.axes import Axes, find_axes
from usdfoliage.branch.tracing.fairing import fair_axes
from usdfoliage.branch.tracing.radii import Radii, RadiusSettings, estimate_radii
from usdfoliage.branch.tracing.sections import SectionTree
from usdfoliage.branch.tracing.stem_sections import StemSectionSettings, fit_stem_sections
from usdfoliage.geometry.point_cells import cell_means

_OF_WINDOW = 0.13  # of the window, that a node is moved for its axis to be fair,
_OF_SPREAD = 0.5  # and of the spread of its points: the middle of a few points on a thick stem may be far off
_THICK_STIFFNESS = 10.0  # of the axes of branches thicker than the window, once they have radii,
_OF_RADIUS = 0.3  # of which their nodes move at most
_FIXED = 1e6  # weight of nodes that stay
_MAX_MOVED = 0.7  # of the radius, that a node is moved to the middle of its circle


@dataclass(frozen=True, kw_only=True, eq=False)
class TracedAxes:
    """Sections as nodes of axes, those on none of them included."""

    sections: SectionTree
    axes: Axes
    center_m: NDArray[np.float64]  # (S, 3), fair, and in the middle of circles
    parent: NDArray[np.int32]  # (S,), the node before on the axis, -1 where there is none
    radii: Radii


def trace_axes(
    points_m: NDArray[np.float64],
    sections: SectionTree,
    min_m: NDArray[np.floating] | float,
    window_m: float,
    stiffness: float,
    settings: RadiusSettings,
) -> TracedAxes:
    """Axes through sections, made fair, with radii; nodes that are on no axis keep their place and no parent.

    Args:
        points_m: (N, 3).
        sections: Of the points.
        min_m: At a section (S,) or everywhere, length that a branch springing there must have.
        window_m: Along the axis to both sides, of the points that a circle is fitted to.
        stiffness: Of the axes.
        settings: Of the radii.
    """
    axes = find_axes(sections.center_m, sections.parent, min_m)
    away = np.square(points_m - sections.center_m[sections.section])
    spread_m = np.sqrt(cell_means(away, sections.section).sum(axis=1))
    max_moved_m = _OF_WINDOW * window_m + _OF_SPREAD * spread_m
    center_m = fair_axes(sections.center_m, axes, sections.points, stiffness, max_moved_m)
    parent = axes.parent_node(len(sections))
    circles = fit_stem_sections(points_m, sections.section, center_m, axes, StemSectionSettings(window_m=window_m))
    on_axis = np.zeros(len(sections), bool)
    on_axis[axes.nodes] = True
    number = np.cumsum(on_axis) - 1
    radii = estimate_radii(
        center_m[on_axis],
        np.where(parent[on_axis] >= 0, number[parent[on_axis]], -1).astype(np.int32),
        circles.take(on_axis),
        settings,
    )
    radius_m, believed = np.full(len(sections), settings.min_radius_m), np.zeros(len(sections), bool)
    radius_m[on_axis], believed[on_axis] = radii.radius_m, radii.believed
    away_m = np.linalg.norm(circles.offset_m, axis=1)
    share = np.minimum(1, _MAX_MOVED * radius_m / np.maximum(away_m, 1e-12))
    center_m = np.where(believed[:, None], center_m + share[:, None] * circles.offset_m, center_m)
    # Circles of a few points are off their middle by chance, one to this side and the next to the other: a lumpy stem.
    thick = radius_m > window_m
    center_m = fair_axes(
        center_m,
        axes,
        np.where(thick, 1.0, _FIXED),
        _THICK_STIFFNESS,
        np.where(thick, _OF_RADIUS * radius_m, np.inf),
    )
    return TracedAxes(
        sections=sections,
        axes=axes,
        center_m=center_m,
        parent=parent,
        radii=replace(radii, radius_m=radius_m, believed=believed),
    )


def as_skeleton(traced: TracedAxes) -> Skeleton:
    """The axes as polylines, those of a single node left out; a branch begins as thick as it goes on."""
    axes = traced.axes
    long = np.diff(axes.first) >= 2
    if not long[axes.parent[long & (axes.parent >= 0)]].all():
        raise AssertionError("a branch springs from a single node")
    number = np.cumsum(long) - 1
    keep = long[axes.axis_of]
    nodes, axis_of, own = axes.nodes[keep], axes.axis_of[keep], axes.own[keep]
    radius_m = traced.radii.radius_m[nodes]
    shared = np.flatnonzero(~own)
    radius_m[shared] = radius_m[shared + 1]
    place = np.full(len(traced.center_m), -1, np.int64)
    place[nodes[own]] = np.flatnonzero(own)
    parent = axes.parent[long]
    return Skeleton(
        points_m=traced.center_m[nodes],
        radius_m=radius_m,
        counts=np.bincount(number[axis_of], minlength=int(long.sum())).astype(np.int32),
        parent_curve=np.where(parent < 0, -1, number[parent]).astype(np.int32),
        parent_vertex=np.where(parent < 0, -1, place[axes.nodes[axes.first[:-1][long]]]).astype(np.int32),
        order=axes.order[long].astype(np.int32),
    )
