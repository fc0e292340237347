"""Leaves of the whole scene: the template laid on every candidate, and the points of all views near it.

Source: G. Chaurasia, P. Beardsley, Editable Parametric Dense Foliage from 3D Capture, 2017, section 4.2. The paper
does not explain how its template, which has no scale, gets one in a rigid ICP; here it is scaled once a candidate,
before ICP, to the longest ellipse of the template's proportions that is neither longer nor wider than the candidate's
enclosing ellipse. A candidate of two leaves end to end or side by side so gets a template of one leaf, which is then
started at either end or side as well as in the middle, and stays where it covers most.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import find_objects
from scipy.spatial import KDTree

from usdfoliage.capture.view import View
from usdfoliage.geometry.enclosing_ellipse import enclosing_ellipses
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.leaf.points import FREE_EDGE, HIDDEN_EDGE, INTERIOR, LeafPoints, no_points
from usdfoliage.leaf.segmentation.paper.candidates import ViewCandidates, plane_frames
from usdfoliage.leaf.segmentation.paper.icp import Alignment, IcpSettings, register_points
from usdfoliage.progress import Progress

_EXCESS = 1.25  # a candidate longer or wider than the template by this factor may be more leaves than one
_CLOUD = 300  # points of a candidate that ICP sees


@dataclass(frozen=True, kw_only=True)
class RefinementSettings:
    """Which candidates become leaves."""

    # Candidates are sorted into this many bins of confidence; within a bin, large ones come first. Range: 1 or more.
    bins: int = 25
    min_confidence: float = 0.0  # Candidates of lower confidence are dropped. Range: 0 to 1.
    # A candidate of which less than this share is free of earlier leaves is a duplicate. Range: 0 to 1.
    min_unclaimed: float = 0.5
    min_points: int = 30  # A leaf with fewer points is dropped. Range: 3 or more.
    min_matched: float = 0.5  # At least this share of the template must lie on the candidate. Range: 0 to 1.
    # A leaf claims points up to this distance from the template. Unit: δ_plane. Range: above 0.
    claim_distance: float = 1.0
    icp: IcpSettings = field(default_factory=IcpSettings)

    def __post_init__(self) -> None:
        if self.bins < 1 or self.min_points < 3 or self.claim_distance <= 0:
            raise ValueError(f"bins at least 1, min_points at least 3, claim_distance above 0, not {self}")
        for name in ("min_confidence", "min_unclaimed", "min_matched"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} must be in [0, 1], not {getattr(self, name)}")


@dataclass(frozen=True, kw_only=True, eq=False)
class RefinedLeaves:
    """Leaves and the templates that found them."""

    leaves: LeafPoints
    world_from_template: NDArray[np.float64]  # (M, 3, 4), rigid; the template has its length along x
    length_m: NDArray[np.float64]  # (M,), of the templates
    dropped: Counter[str]  # candidates, by reason


def refine_leaves(
    views: Sequence[View],
    found: Sequence[ViewCandidates | None],
    template: NDArray[np.float64],
    plane_threshold_m: float,
    settings: RefinementSettings = RefinementSettings(),
    *,
    progress: Progress | None = None,
) -> RefinedLeaves:
    """Lay the template on the candidates of all views, the surest first, and let each claim the points near it.

    Args:
        views: With or without depth.
        found: What each view shows; None for a view without depth.
        template: (N, 3), of length 1 along x, z 0.
        plane_threshold_m: δ_plane: longest correspondence, and how far from the template points are claimed.
        settings: Which candidates become leaves.
        progress: Called with the candidates done and all.
    """
    ratio = float(np.ptp(template[:, 0]) / np.ptp(template[:, 1]))
    # Points of candidates, near the plane of their superpixel, may be claimed: -1 not yet, else the leaf; -2 never.
    owner = [
        None if one is None else np.where(one.planes.inliers & (one.candidates.labels > 0), -1, -2).astype(np.int32)
        for one in found
    ]
    queue = _order(found, settings)
    boxes = [[] if one is None else _boxes(one.candidates.labels) for one in found]
    dropped: Counter[str] = Counter()
    motions: list[NDArray[np.float64]] = []
    lengths: list[float] = []
    confidence: list[float] = []

    for done, (view_number, number, sure) in enumerate(queue):
        if progress is not None:
            progress(done, len(queue))
        one, free = found[view_number], owner[view_number]
        if one is None or free is None:  # such a view is not in the queue
            continue
        if sure < settings.min_confidence:
            dropped["candidates of little confidence"] += 1
            continue
        box = boxes[view_number][number]
        member = (one.candidates.labels[box] == number + 1) & (free[box] != -2)
        unclaimed = member & (free[box] == -1)
        remaining = int(np.count_nonzero(unclaimed))
        if remaining < max(settings.min_points, settings.min_unclaimed * np.count_nonzero(member)):
            dropped["duplicates and candidates of few points"] += 1
            continue
        cloud = _points(views[view_number], box)[unclaimed]
        placed = _place(template, ratio, cloud, views[view_number].camera, plane_threshold_m, settings)
        if placed is None or placed[0].matched < settings.min_matched:
            dropped["candidates unlike the template"] += 1
            continue
        alignment, length_m = placed
        reach_m = plane_threshold_m * settings.claim_distance
        claims = [
            _claim(view, free_there, alignment.target_from_source, length_m, ratio, reach_m)
            for view, free_there in zip(views, owner, strict=True)
        ]
        if sum(len(claim) for claim in claims) < settings.min_points:
            dropped["duplicates and candidates of few points"] += 1
            continue
        for claim, there in zip(claims, owner, strict=True):
            if there is not None:
                there.ravel()[claim] = len(motions)
        motions.append(alignment.target_from_source)
        lengths.append(length_m)
        confidence.append(sure)
    if progress is not None:
        progress(len(queue), len(queue))
    return RefinedLeaves(
        leaves=_gather(views, found, owner, np.array(confidence)),
        world_from_template=np.array(motions).reshape(-1, 3, 4),
        length_m=np.array(lengths),
        dropped=dropped,
    )


def _order(found: Sequence[ViewCandidates | None], settings: RefinementSettings) -> list[tuple[int, int, float]]:
    """View, number and confidence of all candidates: by bins of confidence, then by area."""
    listed = [
        (int(min(sure * settings.bins, settings.bins - 1)), float(area), view, number, float(sure))
        for view, one in enumerate(found)
        if one is not None
        for number, (sure, area) in enumerate(zip(one.shapes.confidence, one.shapes.areas_m2, strict=True))
    ]
    listed.sort(key=lambda item: (-item[0], -item[1], item[2], item[3]))
    return [(view, number, sure) for _, _, view, number, sure in listed]


def _boxes(labels: NDArray[np.int32]) -> list[tuple[slice, slice]]:
    """Where in the picture each label from 1 lies."""
    return [(slice(0, 0), slice(0, 0)) if box is None else (box[0], box[1]) for box in find_objects(labels)]


def _points(view: View, box: tuple[slice, slice]) -> NDArray[np.float64]:
    """(h, w, 3) of a part of the picture, in the world; wrong where no depth is known."""
    rows, columns = np.mgrid[box]
    places = np.column_stack([columns.ravel() + 0.5, rows.ravel() + 0.5])
    points = view.camera.unproject(places, view.depth_m[box].ravel().astype(np.float64))
    return points.reshape(*rows.shape, 3)


def _place(
    template: NDArray[np.float64],
    ratio: float,
    cloud: NDArray[np.float64],
    camera: Pinhole,
    plane_threshold_m: float,
    settings: RefinementSettings,
) -> tuple[Alignment, float] | None:
    """The template on a candidate, and its length; None where the candidate has no width."""
    offsets = np.array([0, len(cloud)])
    means, frames = plane_frames(cloud, offsets, camera.position_m)
    frame = frames[0]
    ellipse = enclosing_ellipses((cloud - means[0]) @ frame[:2].T, offsets)
    half_length, half_width = ellipse.half_axes[0]
    if not half_width > 0:
        return None
    length_m = 2 * min(half_length, half_width * ratio)
    cosine, sine = np.cos(ellipse.angles[0]), np.sin(ellipse.angles[0])
    along = cosine * frame[0] + sine * frame[1]
    rotation = np.column_stack([along, np.cross(frame[2], along), frame[2]])
    center = means[0] + ellipse.centers[0] @ frame[:2]

    starts = [center]
    for axis, half, own in ((0, half_length, length_m / 2), (1, half_width, length_m / ratio / 2)):
        if half > _EXCESS * own:
            starts += [center + (half - own) * rotation[:, axis], center - (half - own) * rotation[:, axis]]
    tree = KDTree(cloud[:: -(-len(cloud) // _CLOUD)])
    spacing = np.sqrt(np.pi * half_length * half_width / len(tree.data))
    shape = template * length_m @ rotation.T
    distance, _ = tree.query(
        (np.array(starts)[:, None] + shape).reshape(-1, 3), distance_upper_bound=min(2 * spacing, plane_threshold_m)
    )
    cover = np.count_nonzero(np.isfinite(distance).reshape(len(starts), -1), axis=1)
    motion = np.column_stack([rotation, starts[int(np.argmax(cover))]])
    return register_points(template * length_m, tree, motion, plane_threshold_m, settings.icp), length_m


def _claim(
    view: View,
    free: NDArray[np.int32] | None,
    world_from_template: NDArray[np.float64],
    length_m: float,
    ratio: float,
    reach_m: float,
) -> NDArray[np.intp]:
    """Numbers of the pixels whose unclaimed points lie within reach of the template."""
    none = np.empty(0, np.intp)
    if free is None:
        return none
    half = np.array([length_m / 2, length_m / 2 / ratio])
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)
    corners *= np.append(half + reach_m, reach_m)
    places, depth = view.camera.project(corners @ world_from_template[:, :3].T + world_from_template[:, 3])
    height, width = free.shape
    if (depth <= 0).all():
        return none
    if (depth <= 0).any():
        low, high = np.zeros(2), np.array([width, height], np.float64)
    else:
        low, high = places.min(axis=0), places.max(axis=0)
    left, top = (int(x) for x in np.clip(np.floor(low), 0, [width, height]))
    right, bottom = (int(x) for x in np.clip(np.ceil(high), 0, [width, height]))
    box = slice(top, bottom), slice(left, right)
    rows, columns = np.nonzero(free[box] == -1)
    if not len(rows):
        return none
    rows, columns = rows + top, columns + left
    points = view.camera.unproject(
        np.column_stack([columns + 0.5, rows + 0.5]), view.depth_m[rows, columns].astype(np.float64)
    )
    local = (points - world_from_template[:, 3]) @ world_from_template[:, :3]
    near = np.flatnonzero((np.abs(local) <= np.append(half + reach_m, reach_m)).all(axis=1))
    near = near[distance_to_ellipse(local[near, :2], half) ** 2 + local[near, 2] ** 2 <= reach_m**2]
    return np.asarray(rows[near] * width + columns[near])


def distance_to_ellipse(points: NDArray[np.float64], half_axes: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,): how far points (N, 2) lie outside an ellipse around the origin along the axes; 0 inside.

    Source: C. Chatfield, A Simple Method for Distance to Ellipse, 2017, by circles of curvature.
    """
    a, b = float(half_axes[0]), float(half_axes[1])
    p = np.abs(points)
    outside = (p[:, 0] / a) ** 2 + (p[:, 1] / b) ** 2 > 1
    p = p[outside]
    t = np.full((len(p), 2), np.sqrt(0.5))
    for _ in range(4):
        on = t * half_axes
        evolute = np.column_stack([(a**2 - b**2) * t[:, 0] ** 3 / a, (b**2 - a**2) * t[:, 1] ** 3 / b])
        radius = np.linalg.norm(on - evolute, axis=1)
        away = p - evolute
        stretch = radius / np.maximum(np.linalg.norm(away, axis=1), 1e-300)
        t = np.clip((away * stretch[:, None] + evolute) / half_axes, 0, 1)
        t /= np.maximum(np.linalg.norm(t, axis=1), 1e-300)[:, None]
    result = np.zeros(len(points))
    result[outside] = np.linalg.norm(p - t * half_axes, axis=1)
    return result


def _gather(
    views: Sequence[View],
    found: Sequence[ViewCandidates | None],
    owner: Sequence[NDArray[np.int32] | None],
    confidence: NDArray[np.float64],
) -> LeafPoints:
    """The points of all leaves, leaf after leaf and view after view."""
    count = len(confidence)
    leaf, points, normals, kinds, seen = [], [], [], [], []
    for number, (view, one, claimed) in enumerate(zip(views, found, owner, strict=True)):
        if one is None or claimed is None or one.candidates.superpixels is None:
            continue
        rows, columns = np.nonzero(claimed >= 0)
        leaf.append(claimed[rows, columns])
        places = np.column_stack([columns + 0.5, rows + 0.5])
        points.append(view.camera.unproject(places, view.depth_m[rows, columns].astype(np.float64)))
        normals.append(one.planes.normals[one.candidates.superpixels[rows, columns]])
        kinds.append(find_edges(claimed, view.depth_m)[rows, columns])
        seen.append(np.full(len(rows), number, np.int32))
    if not leaf:
        return no_points()
    leaf_of = np.concatenate(leaf)
    order = np.argsort(leaf_of, kind="stable")
    point_view = np.concatenate(seen)
    votes = np.bincount(leaf_of.astype(np.int64) * len(views) + point_view, minlength=count * len(views))
    return LeafPoints(
        points_m=np.concatenate(points)[order],
        normals=np.concatenate(normals)[order],
        kind=np.concatenate(kinds)[order],
        point_view=point_view[order],
        offsets=np.concatenate([[0], np.cumsum(np.bincount(leaf_of, minlength=count))]).astype(np.int64),
        confidence=confidence,
        view=votes.reshape(count, len(views)).argmax(axis=1).astype(np.int32),
    )


def find_edges(owner: NDArray[np.int32], depth_m: NDArray[np.float32]) -> NDArray[np.uint8]:
    """(H, W): what kind of point each pixel of a leaf is; owner is below 0 where there is no leaf.

    A pixel beside one of another owner is at an edge: hidden if what is there stands nearer, or nothing is known of it.
    """
    kind = np.full(owner.shape, INTERIOR, np.uint8)
    wide_owner = cv2.copyMakeBorder(owner, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=-3)
    wide_depth = cv2.copyMakeBorder(depth_m, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
    height, width = owner.shape
    for down, right in ((0, 1), (1, 0), (1, 2), (2, 1)):
        there = slice(down, down + height), slice(right, right + width)
        edge = (owner >= 0) & (wide_owner[there] != owner)
        behind = wide_depth[there] > depth_m
        kind[edge & behind & (kind == INTERIOR)] = FREE_EDGE
        kind[edge & ~behind] = HIDDEN_EDGE
    return kind
