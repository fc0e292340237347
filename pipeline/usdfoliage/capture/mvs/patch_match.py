"""Planes through the pixels of posed photographs by PatchMatch stereo with slanted windows.

Section 4 of J. Guo et al., Realistic procedural plant modeling from multiple view images, 2020: planes that fit the
photographs through the homographies they induce (equation 1), then planes that agree with what the other photographs
found (equation 3). Planes spread as in Q. Xu and W. Tao, Multi-scale geometric consistency guided multi-view stereo,
2019, from coarse pictures to fine ones.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage import _native
from usdfoliage.capture.view import View
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.native_settings import native_settings

MAX_SOURCES, _MAX_SAMPLES = 16, 64  # as native code takes them
_MIN_SIDE_PX = 32  # of a coarse picture; below it there is nothing to match


@dataclass(frozen=True, kw_only=True)
class PatchMatchSettings:
    """How windows are compared, and how planes spread."""

    # A matching window reaches this far from its middle to its sides. Unit: pixels. Range: 1 or more.
    window_px: int = 3
    # The pixels of a window that are compared are this far apart. Unit: pixels. Range: a divisor of 2 window_px; at
    # most 64 pixels a window.
    window_step_px: int = 2
    # A window's pixel weighs 1/e where the differences of its three channels to the middle sum up to this. Unit: of
    # 765. Range: above 0.
    color_scale: float = 80.0
    # A window's pixel weighs 1/e at this distance from the middle. Unit: pixels. Range: above 0.
    distance_scale_px: float = 4.0
    # A window whose brightness has this standard deviation is taken for noise. Unit: of 255. Range: above 0.
    noise: float = 2.0
    # A difference in mean brightness of brightness_scale or more costs this. Range: 0 or more.
    brightness_weight: float = 0.5
    # A difference in mean brightness of this size has the full cost brightness_weight. Unit: of 255. Range: above 0.
    brightness_scale: float = 40.0
    # A difference in the colour of the window's middle of tint_scale or more costs this. Range: 0 or more.
    tint_weight: float = 0.25
    # A difference in colour of this size has the full cost tint_weight. Unit: of 765. Range: above 0.
    tint_scale: float = 60.0
    # The cost of a pixel is that of this many sources that match best, because the others may not see it. Range: 1 to
    # 16.
    best_sources: int = 3
    # One pixel of disagreement with the depth of another photograph costs this. Range: 0 or more.
    geometric_weight: float = 0.15
    # Disagreement beyond this costs no more, because that photograph may see something else. Unit: pixels. Range:
    # above 0.
    geometric_limit_px: float = 3.0
    # Each source that sees nothing, such as sky, where the plane is costs this. Range: 0 or more.
    open_weight: float = 0.4
    open_margin_px: int = 1  # Masks may be wrong by this distance. Unit: pixels. Range: 0 or more.
    # Depth away from the plane of the pixel's segment costs up to this (equation 2), where the window has no texture.
    # Range: 0 or more.
    segment_weight: float = 0.2
    # At this standard deviation of brightness a window counts as half textured, and segment_weight as half. Unit: of
    # 255. Range: above 0.
    segment_texture: float = 5.0
    # Depth away from the segment's plane has its full cost where it moves the pixel by this much in the source that
    # moves most. Unit: pixels. Range: above 0.
    segment_limit_px: float = 2.0
    # The first random changes of depth are this share of the range of inverse depth. Range: above 0.
    step: float = 0.03
    # A plane's normal is turned away from the line of sight by this angle at most. Unit: degrees. Range: above 0,
    # below 90.
    max_slant_deg: float = 80.0

    def __post_init__(self) -> None:
        if self.window_px < 1 or self.window_step_px < 1 or not 1 <= self.best_sources <= MAX_SOURCES:
            raise ValueError(
                f"window_px and window_step_px must be at least 1 and best_sources 1 to {MAX_SOURCES}, not {self}"
            )
        if 2 * self.window_px % self.window_step_px:
            raise ValueError(
                f"window_step_px must divide the window's side {2 * self.window_px}, not {self.window_step_px}"
            )
        if len(self.window_offsets()) > _MAX_SAMPLES:
            raise ValueError(f"the window may have {_MAX_SAMPLES} pixels, not {len(self.window_offsets())}")
        scales = [self.color_scale, self.distance_scale_px, self.noise, self.step, self.geometric_limit_px]
        scales += [self.brightness_scale, self.tint_scale, self.segment_limit_px, self.segment_texture]
        if not all(np.isfinite(value) and value > 0 for value in scales):
            raise ValueError("scales, distance_scale_px, noise, step and geometric_limit_px must be above 0")
        weights = [self.geometric_weight, self.brightness_weight, self.tint_weight]
        weights += [self.segment_weight, self.open_weight]
        if not all(np.isfinite(value) and value >= 0 for value in weights):
            raise ValueError("weights must not be below 0")
        if not 0 < self.max_slant_deg < 90:
            raise ValueError(f"max_slant_deg must be in (0, 90), not {self.max_slant_deg:g}")

    def window_offsets(self) -> NDArray[np.int32]:
        """(N, 2), right and down, of the pixels that a window compares."""
        line = np.arange(-self.window_px, self.window_px + 1, self.window_step_px, dtype=np.int32)
        return np.stack(np.meshgrid(line, line), -1).reshape(-1, 2)


@dataclass(frozen=True, kw_only=True, eq=False)
class MatchedPlanes:
    """The plane of every pixel of a photograph, believed or not."""

    camera: Pinhole  # at the size of matching
    planes: NDArray[np.float32]  # (h, w, 3): inverse depth, its change to the next pixel right and down; 0 for none
    cost: NDArray[np.float32]  # (h, w): mean of one minus the correlation, and of the disagreement with other views

    @property
    def depth_m(self) -> NDArray[np.float32]:
        """(h, w), along the optical axis, 0 where there is none."""
        inverse = self.planes[..., 0]
        return np.divide(1, inverse, out=np.zeros_like(inverse), where=inverse > 0)

    def at_size(self, size: tuple[int, ...]) -> "MatchedPlanes":
        """The same for pictures (h, w) of another size."""
        if self.cost.shape == size:
            return self
        height, width = size
        return MatchedPlanes(
            camera=self.camera.resized(width, height),
            planes=enlarge_planes(self.planes, size),
            cost=cv2.resize(self.cost, (width, height), interpolation=cv2.INTER_NEAREST),
        )

    def normals(self) -> NDArray[np.float32]:
        """(h, w, 3), in camera axes, of length 1, toward the camera; 0 where there is no plane."""
        inverse, right, down = np.moveaxis(self.planes, -1, 0)
        (focal_x, focal_y), (center_x, center_y) = self.camera.focal_px, self.camera.center_px
        rows, columns = np.indices(inverse.shape, np.float32)
        normal = np.empty(self.planes.shape, np.float32)  # inverse depth is normal · ray, normal · point 1
        normal[..., 0], normal[..., 1] = -right * focal_x, -down * focal_y
        normal[..., 2] = -(inverse - right * (columns + 0.5 - center_x) - down * (rows + 0.5 - center_y))
        length = np.linalg.norm(normal, axis=-1, keepdims=True)
        return np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)


def match_view(
    reference: View,
    sources: Sequence[View],
    range_m: tuple[float, float],
    level: int,
    iterations: int,
    settings: PatchMatchSettings = PatchMatchSettings(),
    *,
    start: MatchedPlanes | None = None,
    source_planes: Sequence[MatchedPlanes | None] | None = None,
    segment_planes: NDArray[np.float32] | None = None,
    max_side_px: int = 1200,
    seed: int = 0,
    threads: int = 0,
) -> MatchedPlanes:
    """The planes of one view that fit its sources best, at one size of the pictures.

    Args:
        reference: The view; its depth is not looked at, pixels outside its mask get no plane.
        sources: With which it is matched, at least one.
        range_m: Nearest and farthest depth.
        level: How often the pictures are halved.
        iterations: How often every pixel is visited.
        settings: How windows are compared.
        start: Its planes so far, of any size; None: guessed.
        source_planes: Those of the sources so far, of any size, which then count as well (equation 3).
        segment_planes: (H, W, 3), the plane of each pixel's segment, 0 for none, at the size of matching (equation 2).
        max_side_px: Size of the pictures at level 0 at most.
        seed: Of the guesses.
        threads: 0: one per core.

    Raises:
        ValueError: The range is none, or there are too many sources or none.
    """
    near_m, far_m = range_m
    if not 0 < near_m < far_m:
        raise ValueError(f"the range must be 0 < near < far, not {near_m:g}, {far_m:g}")
    if not 1 <= len(sources) <= MAX_SOURCES:
        raise ValueError(f"1 to {MAX_SOURCES} sources can be matched, not {len(sources)}")
    if source_planes is not None and len(source_planes) != len(sources):
        raise ValueError(f"{len(sources)} sources need as many planes, not {len(source_planes)}")
    own, *others = [Picture.of(view, max_side_px, level) for view in (reference, *sources)]
    size = own.gray.shape
    matched = _native.match_planes(
        _native.MatchReference(
            srgb=own.srgb,
            tint=smooth_tint(own.srgb),
            pixel_from_ray=own.camera.pixel_from_ray(),
            mask=own.mask,
            segment_planes=segment_planes,
            proposals=None if source_planes is None else propose_planes(own.camera, source_planes),
        ),
        _match_sources(own, others, settings.open_margin_px, source_planes),
        np.zeros((*size, 3), np.float32) if start is None else enlarge_planes(start.planes, size),
        offsets=settings.window_offsets(),
        settings=native_settings(
            _native.PatchMatchSettings,
            settings,
            iterations=iterations,
            nearest_inverse=1 / near_m,
            farthest_inverse=1 / far_m,
            step=settings.step if start is None else settings.step / 4,
            max_slant=float(np.tan(np.radians(settings.max_slant_deg))),
            seed=seed,
        ),
        threads=threads,
    )
    return MatchedPlanes(camera=own.camera, planes=matched.planes, cost=matched.cost)


def _match_sources(
    own: "Picture",
    others: "Sequence[Picture]",
    open_margin_px: int,
    source_planes: Sequence[MatchedPlanes | None] | None,
) -> list[_native.MatchSource]:
    """The other pictures as the native function takes them, with their depth if they have planes so far."""
    opens = open_maps(others, open_margin_px)
    depths = [] if source_planes is None else _depths_of(source_planes, others)
    return [
        _native.MatchSource(
            gray=other.gray,
            tint=smooth_tint(other.srgb),
            warps=warps(own.camera, other.camera),
            open=opens[k] if opens else None,
            depth_m=depths[k] if depths else None,
        )
        for k, other in enumerate(others)
    ]


def propose_planes(
    camera: Pinhole, source_planes: Sequence[MatchedPlanes | None], max_cost: float = 1.5
) -> NDArray[np.float32] | None:
    """The planes of sources as a camera sees them, (layers, H, W, 3), 0 for none; None where no source has any.

    A twig that one view has found is so suggested to the others, as in M. Bleyer et al., PatchMatch stereo, 2011
    (view propagation). Sources are taken by turns into two layers, so that a pixel hears of two of them.
    """
    known = [planes for planes in source_planes if planes is not None]
    layers = []
    for chosen in (known[0::2], known[1::2]):
        if chosen:
            seen = _native.show_planes(
                [
                    _native.PlaneSource(
                        planes=planes.planes,
                        cost=planes.cost,
                        warps=warps(planes.camera, camera),
                        pixel_from_ray=planes.camera.pixel_from_ray(),
                        turn=_turn(planes.camera, camera),
                    )
                    for planes in chosen
                ],
                pixel_from_ray=camera.pixel_from_ray(),
                width=camera.width_px,
                height=camera.height_px,
                max_cost=max_cost,
            )
            layers.append(seen.planes)
    return np.stack(layers) if layers else None


def open_maps(pictures: "Sequence[Picture]", margin_px: int) -> list[NDArray[np.uint8]]:
    """Where each picture (h, w) sees nothing, by its mask less a margin; no maps where none has a mask."""
    if all(picture.mask is None for picture in pictures):
        return []
    kernel = np.ones((2 * margin_px + 1, 2 * margin_px + 1), np.uint8)
    return [
        np.zeros(picture.gray.shape, np.uint8)
        if picture.mask is None
        else (cv2.dilate(picture.mask, kernel) == 0).astype(np.uint8)
        for picture in pictures
    ]


def warps(camera: Pinhole, other: Pinhole) -> NDArray[np.float64]:
    """(2, 3, 4): the homography of the plane at infinity and the epipole, to the other camera's pixels and back."""
    return np.stack([_warp(camera, other), _warp(other, camera)])


def _turn(camera: Pinhole, other: Pinhole) -> NDArray[np.float64]:
    """(3, 4), the other's camera axes from the camera's: rotation and translation."""
    rotation = other.cam_from_world[:, :3] @ camera.cam_from_world[:, :3].T
    translation = other.cam_from_world[:, 3] - rotation @ camera.cam_from_world[:, 3]
    return np.column_stack([rotation, translation])


def _warp(camera: Pinhole, other: Pinhole) -> NDArray[np.float64]:
    turn = _turn(camera, other)
    to = other.pixel_from_ray()
    return np.column_stack([to @ turn[:, :3] @ np.linalg.inv(camera.pixel_from_ray()), to @ turn[:, 3]])


def _depths_of(
    source_planes: Sequence[MatchedPlanes | None], pictures: Sequence["Picture"]
) -> list[NDArray[np.float32]]:
    """Depth (h, w) of every source, 0 everywhere for one that has none."""
    return [
        np.zeros(picture.gray.shape, np.float32) if planes is None else planes.at_size(picture.gray.shape).depth_m
        for planes, picture in zip(source_planes, pictures, strict=True)
    ]


class Picture(NamedTuple):
    """A photograph at a size of matching."""

    camera: Pinhole
    srgb: NDArray[np.uint8]  # (h, w, 3)
    gray: NDArray[np.uint8]  # (h, w)
    mask: NDArray[np.uint8] | None  # (h, w)

    @classmethod
    def of(cls, view: View, max_side_px: int, level: int) -> "Picture":
        """A view, not larger than max_side_px, then halved so many times but not to nothing."""
        mask = None if view.mask is None else view.mask.astype(np.uint8)
        whole = cls(view.camera, np.ascontiguousarray(view.srgb), cv2.cvtColor(view.srgb, cv2.COLOR_RGB2GRAY), mask)
        sides = view.camera.width_px, view.camera.height_px
        scale = min(1.0, max_side_px / max(sides))
        halved = 0.5**level
        smallest = min(1.0, _MIN_SIDE_PX / (min(sides) * scale))
        scale *= max(halved, smallest)
        return whole if scale >= 1 else whole.scaled(scale)

    def scaled(self, scale: float) -> "Picture":
        width, height = round(self.camera.width_px * scale), round(self.camera.height_px * scale)
        camera = self.camera.resized(width, height)
        srgb = cv2.resize(self.srgb, (width, height), interpolation=cv2.INTER_AREA)
        mask = None
        if self.mask is not None:  # a pixel counts if any of those it stands for does
            mask = (cv2.resize(self.mask.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA) > 0).astype(
                np.uint8
            )
        return Picture(camera, srgb, cv2.cvtColor(srgb, cv2.COLOR_RGB2GRAY), mask)


def enlarge_planes(planes: NDArray[np.float32], size: tuple[int, ...]) -> NDArray[np.float32]:
    """Planes (h, w, 3) at another size: every pixel takes the plane of the nearest one, seen from where it is."""
    height, width = planes.shape[:2]
    if (height, width) == size:
        return planes
    down, across = height / size[0], width / size[1]
    rows, columns = (np.arange(size[0]) + 0.5) * down - 0.5, (np.arange(size[1]) + 0.5) * across - 0.5
    near_rows = np.clip(np.rint(rows).astype(int), 0, height - 1)
    near_columns = np.clip(np.rint(columns).astype(int), 0, width - 1)
    large = planes[near_rows[:, None], near_columns[None, :]]
    large[..., 0] += large[..., 1] * (columns - near_columns)[None, :] + large[..., 2] * (rows - near_rows)[:, None]
    large[..., 1] *= across
    large[..., 2] *= down
    return np.ascontiguousarray(large, np.float32)


def smooth_tint(srgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(H, W, 3): colours without the noise of single pixels."""
    return np.ascontiguousarray(cv2.GaussianBlur(srgb, (3, 3), 0))
