"""Best seam between two overlapping images: a minimum cut of the pixel grid."""

import numpy as np
from numpy.typing import NDArray

from usdfoliage import _native

# Added to the gradients that divide a cost, in units of the images (0..1): where both images are flat, a step between
# them counts as that many times more visible than in texture.
_GRADIENT_FLOOR = 0.02
# The dearest edge as an integer; eight of them still are one.
_MAX_FLOW = 2**26


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
        first: (H, W, C) float, about 0..1, in the encoding in which differences are to be judged (such as sRGB).
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

    down, right = seam_costs(first, second, wrap=wrap, allowed=part)
    scale = _MAX_FLOW / max(float(down.max()), float(right.max()), 1e-12)
    # More than all edges of a pixel together, so that no cut parts a pixel from the image that keeps it.
    terminal = np.where(part & keep_first, 8 * _MAX_FLOW, 0) - np.where(part & keep_second, 8 * _MAX_FLOW, 0)
    taken = _native.cut_grid(
        np.rint(down * scale).astype(np.int32), np.rint(right * scale).astype(np.int32), terminal.astype(np.int32)
    )
    return np.asarray((taken != 0) & part)


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


def _check_overlap(
    first: NDArray[np.floating],
    second: NDArray[np.floating],
    keep_first: NDArray[np.bool_],
    keep_second: NDArray[np.bool_],
    part: NDArray[np.bool_],
) -> None:
    if first.ndim != 3 or first.shape != second.shape:
        raise ValueError(f"first and second must both be (H, W, C), not {first.shape} and {second.shape}")
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
