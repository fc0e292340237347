"""Whether the outlines of leaves lie on edges of the photographs.

Depth of photographs has its holes and its errors where leaves end, and there the photographs are sharpest: an
outline that is right falls on an edge of colour in every view that sees it. Our own.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.view import View
from usdfoliage.files.threads import map_threaded
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.surface import evaluate_grid

_LINE = 4096  # places in a line of a map: OpenCV takes no map that is longer than 32767 to one side
_SOBEL = 8  # what a Sobel operator of three pixels multiplies a slope with
_STEP = 1e-3  # leaf lengths, along an outline
_MAX_PLACES = 1000  # no photograph shows more of a leaf


@dataclass(frozen=True, kw_only=True)
class OutlineSettings:
    """How outlines are compared with the edges of photographs."""

    ring: int = 16  # Either half of the outline is compared at this many places. Range: 1 to 1000.
    blur_px: float = 1.0  # Edges are those of photographs blurred by this deviation. Unit: pixels. Range: above 0.
    # An edge counts by how much it exceeds the typical change of colour within this deviation. Unit: pixels. Range:
    # above 0.
    around_px: float = 12.0
    noise: float = 1.0  # Changes of colour of this size are noise. Unit: of 255, a pixel. Range: above 0.
    # An edge that exceeds the typical change by more than this factor counts as this. Range: above 0.
    limit: float = 2.0
    # At this many views a place of the outline must lie on an edge. Range: 1 or more.
    views: int = 2
    min_facing: float = 0.15  # Views that see a leaf under a smaller cosine do not count. Range: 0 to 1.
    # An outline whose edges exceed the typical change by this factor is no better than chance. Range: 0 or more.
    chance: float = 1.1
    # An outline that exceeds chance by this much is right. Range: above 0.
    sure: float = 0.3

    def __post_init__(self) -> None:
        if not 1 <= self.ring <= _MAX_PLACES or self.views < 1:
            raise ValueError(f"ring must be 1 to {_MAX_PLACES} and views at least 1, not {self.ring} and {self.views}")
        positive = (self.blur_px, self.around_px, self.noise, self.limit, self.sure)
        if not all(np.isfinite(value) and value > 0 for value in positive):
            raise ValueError(f"blur_px, around_px, noise, limit and sure must be above 0, not {positive}")
        if not (0 <= self.min_facing <= 1 and np.isfinite(self.chance) and self.chance >= 0):
            raise ValueError(
                f"min_facing must be 0 to 1 and chance not below 0, not {self.min_facing:g} and {self.chance:g}"
            )


class EdgePicture(NamedTuple):
    """How the colours of a photograph change."""

    right: NDArray[np.int16]  # (H, W, 3), of L*, a*, b* in 8-bit units, eight times the change a pixel to the right
    down: NDArray[np.int16]  # (H, W, 3), the same downwards
    typical: NDArray[np.float32]  # (H, W), length of both, the mean around each pixel, eight times


def find_edges(
    views: Sequence[View], settings: OutlineSettings = OutlineSettings(), *, threads: int = 0
) -> list[EdgePicture]:
    """The edges of photographs, view by view.

    Args:
        threads: At most so many, 0 for one per core; the result is the same.
    """

    def find(view: View) -> EdgePicture:
        lab = cv2.GaussianBlur(cv2.cvtColor(view.srgb, cv2.COLOR_RGB2LAB), (0, 0), settings.blur_px)
        right, down = (cv2.Sobel(lab, cv2.CV_16S, 1 - axis, axis, ksize=3) for axis in (0, 1))
        length = np.sqrt(np.square(right, dtype=np.float32).sum(-1) + np.square(down, dtype=np.float32).sum(-1))
        typical = cv2.GaussianBlur(length, (0, 0), settings.around_px)
        return EdgePicture(np.asarray(right, np.int16), np.asarray(down, np.int16), np.asarray(typical, np.float32))

    return list(map_threaded(find, views, threads=threads))


def measure_outlines(
    leaves: Leaves,
    cameras: Sequence[Pinhole],
    edges: Sequence[EdgePicture],
    settings: OutlineSettings = OutlineSettings(),
    *,
    threads: int = 0,
) -> NDArray[np.float64]:
    """(N,), 0 to settings.limit: by how much the edges that outlines lie on exceed the typical change of colour.

    0 where too few views see a leaf; see judge_outlines for what it means. At each place of an outline the change of
    colour across it is measured in every view, relative to what is typical around. A place counts as the view that is
    settings.views best shows it: one view alone sees edges of what stands before or behind the leaf.

    Args:
        leaves: In the world of the cameras.
        cameras: V.
        edges: V, as find_edges gives them.
        settings: How.
        threads: At most so many, 0 for one per core; the result is the same.
    """
    count = len(leaves)
    if not count or len(cameras) < settings.views:
        return np.zeros(count)
    v = (np.arange(settings.ring) + 0.5) / settings.ring
    grid = evaluate_grid(leaves.parameters, [-1.0, 1.0], v, placements=leaves.asset_from_leaf(), threads=threads)
    places_m, normals = grid.points.reshape(count, -1, 3), grid.normals.reshape(count, -1, 3)
    beside_m = places_m + _STEP * grid.tangents_v.reshape(count, -1, 3)

    def measure(number: int) -> NDArray[np.float32]:
        camera, edge = cameras[number], edges[number]
        rays = camera.position_m - places_m
        rays /= np.maximum(np.linalg.norm(rays, axis=-1, keepdims=True), 1e-300)
        facing = np.abs(np.einsum("nrc,nrc->nr", rays, normals)).mean(axis=1)
        places, _ = camera.project(places_m.reshape(-1, 3))
        along, _ = camera.project(beside_m.reshape(-1, 3))
        with np.errstate(invalid="ignore"):
            inside = ((places >= 0) & (places < (camera.width_px, camera.height_px))).all(axis=1)
            inside &= np.isfinite(along).all(axis=1)
        counted = np.flatnonzero(inside & np.repeat(facing > settings.min_facing, places_m.shape[1]))
        steps = along[counted] - places[counted]
        across = np.stack([-steps[:, 1], steps[:, 0]], -1)
        across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
        change = (
            _sample(edge.right, places[counted]) * across[:, :1] + _sample(edge.down, places[counted]) * across[:, 1:]
        )
        typical = _sample(edge.typical, places[counted])[:, 0] + _SOBEL * settings.noise
        measured = np.zeros(len(places), np.float32)
        measured[counted] = np.minimum(np.linalg.norm(change, axis=1) / typical, settings.limit)
        return measured

    measured = np.stack(list(map_threaded(measure, range(len(cameras)), threads=threads)))
    best = np.partition(measured, len(cameras) - settings.views, axis=0)[len(cameras) - settings.views]
    return np.asarray(best.reshape(count, -1).mean(axis=1, dtype=np.float64))


def judge_outlines(measured: NDArray[np.float64], settings: OutlineSettings = OutlineSettings()) -> NDArray[np.float64]:
    """(N,), 0 no better than chance to 1 right: whether outlines lie on edges, by what measure_outlines gives."""
    return np.asarray(np.clip((measured - settings.chance) / settings.sure, 0, 1))


def _sample(picture: NDArray[np.generic], places: NDArray[np.float64]) -> NDArray[np.float32]:
    """(P, C), a picture (H, W) or (H, W, C) between pixels at places (P, 2), where pixel centres lie at halves."""
    lines = -(-len(places) // _LINE)
    padded = np.zeros((lines * _LINE, 2), np.float32)
    padded[: len(places)] = places - 0.5
    if not lines:
        return np.zeros((0, 1 if picture.ndim == 2 else picture.shape[2]), np.float32)
    x, y = padded[:, 0].reshape(lines, _LINE), padded[:, 1].reshape(lines, _LINE)
    sampled = cv2.remap(picture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(sampled, np.float32).reshape(lines * _LINE, -1)[: len(places)]
