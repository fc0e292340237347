"""Example-based texture synthesis: an image of any size that looks like an exemplar.

Patches of the exemplar are laid along minimum-cut seams on the coarsest level of a pyramid; every finer level takes
over where each pixel comes from and mends the seams, pixel by pixel, until neighbourhoods look like the exemplar's.
Unlike the thesis, which searches all of the exemplar for every pixel, each pixel only looks where its neighbours point.

Source: the thesis on semi-procedural crowns, sections 4.5 and 4.5.1; V. Kwatra et al., Graphcut Textures, 2003;
S. Lefebvre and H. Hoppe, Parallel Controllable Texture Synthesis, 2005.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from usdfoliage import _native
from usdfoliage.errors import FitError
from usdfoliage.native_settings import native_settings
from usdfoliage.progress import Progress

_WHITE = 1023  # the kernels' integer colours
# Random places a pixel and pass: found ones break pieces up and score no better, so none.
_TRIES = 0
# To look for known pixels in the exemplar: passes on the coarsest level, random places a pixel and pass, and how far
# from what is free.
_KNOWN_PASSES, _KNOWN_TRIES, _KNOWN_REACH_PX = 4, 8, 24
_MIN_PATCH_PX = 8  # a smaller patch shows nothing of the texture's structure


@dataclass(frozen=True, kw_only=True)
class TextureSettings:
    """Size of what is copied, and how hard seams are worked on."""

    levels: int = 2  # of the pyramid; patches are laid on the coarsest one
    patch_px: int = 68  # side of a patch on the finest level
    patch_share: float = 0.33  # largest side of a patch, of the root of the exemplar's area
    overlap_share: float = 0.22  # of a patch, in which the seam to its neighbour is sought
    radius: int = 4  # of the neighbourhoods that are compared
    guide_weight: int = 2  # of the coarser level's colour in a comparison, in pixels
    passes: int = 2  # a level
    usage_weight: float = 2.0  # how much dearer a place of the exemplar gets by every use
    near_weight: float = 2.0  # and by every use within two patches
    candidate_share: float = 1.0  # of all places, how many are tried for a patch
    # Places on a grid that are tried for a patch at most, and then all around the best. A larger exemplar has a coarser
    # grid, so that the time of a patch does not grow with it.
    max_places: int = 4096
    cuts: int = 8  # of the places that match best, how many are compared by their seam
    threads: int = 0  # 0: one per core; the result does not depend on it

    def __post_init__(self) -> None:
        minima = (
            ("levels", 1),
            ("patch_px", _MIN_PATCH_PX),
            ("radius", 1),
            ("guide_weight", 0),
            ("passes", 1),
            ("usage_weight", 0),
            ("near_weight", 0),
            ("max_places", 1),
            ("cuts", 1),
            ("threads", 0),
        )
        for name, low in minima:
            if getattr(self, name) < low:
                raise ValueError(f"{name} must be at least {low}, not {getattr(self, name)}")
        for name, high in (("patch_share", 1.0), ("overlap_share", 0.5), ("candidate_share", 1.0)):
            if not 0 < getattr(self, name) <= high:
                raise ValueError(f"{name} must be in (0, {high}], not {getattr(self, name)}")


@dataclass(frozen=True, kw_only=True, eq=False)
class _Level:
    """One level of a pyramid."""

    color: NDArray[np.int16]  # (H, W, 4), 0.._WHITE
    mask: NDArray[np.uint8]  # (H, W), 1 where all pixels below are in the mask


def synthesize_texture(
    exemplar: NDArray[np.float32],
    shape: tuple[int, int],
    rng: np.random.Generator,
    *,
    exemplar_mask: NDArray[np.bool_] | None = None,
    known: NDArray[np.float32] | None = None,
    known_mask: NDArray[np.bool_] | None = None,
    settings: TextureSettings = TextureSettings(),
    progress: Progress | None = None,
) -> NDArray[np.float32]:
    """Make an image that looks like an exemplar and continues what is known of it.

    Every pixel made is a pixel of the exemplar, and all parts of the exemplar are used about equally often.

    Args:
        exemplar: (h, w, 3) in [0, 1], perceptual (sRGB-encoded).
        shape: (H, W) of the result.
        rng: the choice of patches.
        exemplar_mask: (h, w) pixels that may be copied; all where None.
        known: (H, W, 3) in [0, 1], what the result must be where known_mask is true.
        known_mask: (H, W); None with known.
        settings: sizes and efforts.
        progress: called with (done, total) steps.

    Returns:
        (H, W, 3) float32.

    Raises:
        ValueError: shapes do not fit each other, or colours are not finite.
        FitError: no patch fits into exemplar_mask.
    """
    source = synthesize_sources(
        exemplar,
        shape,
        rng,
        exemplar_mask=exemplar_mask,
        known=known,
        known_mask=known_mask,
        settings=settings,
        progress=progress,
    )
    image = exemplar[source[..., 0], source[..., 1]].astype(np.float32)
    if known is not None and known_mask is not None:
        image[known_mask] = known[known_mask]
    return image


def synthesize_sources(
    exemplar: NDArray[np.float32],
    shape: tuple[int, int],
    rng: np.random.Generator,
    *,
    exemplar_mask: NDArray[np.bool_] | None = None,
    known: NDArray[np.float32] | None = None,
    known_mask: NDArray[np.bool_] | None = None,
    settings: TextureSettings = TextureSettings(),
    progress: Progress | None = None,
) -> NDArray[np.int32]:
    """Row and column in the exemplar that each pixel of synthesize_texture copies, (H, W, 2).

    Where the image is known, the place that looks most like it. Arguments and errors as for synthesize_texture.
    """
    if (known is None) != (known_mask is None):
        raise ValueError("known and known_mask belong together")
    valid = np.ones(exemplar.shape[:2], np.bool_) if exemplar_mask is None else exemplar_mask
    fixed = np.zeros((*shape, 3), np.float32) if known is None else known
    fixed_mask = np.zeros(shape, np.bool_) if known_mask is None else known_mask
    _check(exemplar, valid, shape, fixed, fixed_mask)
    patch, levels = _fit_patch(valid, settings)

    sources = _build_pyramid(_to_integers(_extend(exemplar, valid)), valid, levels)
    targets = _build_pyramid(_to_integers(fixed), fixed_mask, levels)
    steps = 1 + levels * settings.passes
    seeds = rng.integers(0, 2**32, size=steps, dtype=np.uint32).tolist()

    source, color = _lay_patches(sources[-1], targets[-1], patch >> (levels - 1), seeds[0], settings)
    guide_of_source, guide, guide_weight = sources[-1].color, color, 0
    for step in range(1, steps):
        if progress is not None:
            progress(step, steps)
        level = levels - 1 - (step - 1) // settings.passes
        if (step - 1) % settings.passes == 0 and level < levels - 1:
            guide_of_source = _enlarge(sources[level + 1].color, sources[level].mask.shape)
            guide, guide_weight = _enlarge(color, targets[level].mask.shape), settings.guide_weight
            source, color = _refine_level(source, sources[level], targets[level])
            _find_known(sources[level], targets[level], source, 1, seeds[step], settings)
        _native.refine_sources(
            _native.Exemplar(color=sources[level].color, valid=sources[level].mask, guide=guide_of_source),
            _native.Synthesis(source=source, color=color, known=targets[level].mask, guide=guide),
            settings=native_settings(
                _native.RefineSettings, settings, guide_weight=guide_weight, random_tries=_TRIES, seed=seeds[step]
            ),
            threads=settings.threads,
        )
    if progress is not None:
        progress(steps, steps)
    return source


def _lay_patches(
    exemplar: _Level, target: _Level, patch: int, seed: int, settings: TextureSettings
) -> tuple[NDArray[np.int32], NDArray[np.int16]]:
    """Source and colour of the coarsest level, grown from what is known."""
    places = np.argwhere(exemplar.mask).astype(np.int32)
    source = places[np.random.default_rng(seed).integers(0, len(places), target.mask.shape)]
    _find_known(exemplar, target, source, _KNOWN_PASSES, seed, settings)
    source[target.mask == 0] = -1
    color = target.color.copy()
    _native.place_patches(
        _native.Exemplar(color=exemplar.color, valid=exemplar.mask),
        _native.Synthesis(source=source, color=color, known=target.mask),
        settings=native_settings(
            _native.PlaceSettings,
            settings,
            patch_px=patch,
            overlap_px=max(2, round(settings.overlap_share * patch)),
            seed=seed,
        ),
        threads=settings.threads,
    )
    return source, color


def _find_known(
    exemplar: _Level, target: _Level, source: NDArray[np.int32], passes: int, seed: int, settings: TextureSettings
) -> None:
    """Look up where in the exemplar the known pixels look most at home, so that the synthesis can continue them."""
    known = target.mask != 0
    if not known.any():
        return
    searched = known & (distance_transform_edt(known) <= _KNOWN_REACH_PX)
    for k in range(passes):
        _native.refine_sources(
            _native.Exemplar(color=exemplar.color, valid=exemplar.mask, guide=exemplar.color),
            _native.Synthesis(
                source=source,
                color=target.color.copy(),
                known=np.where(searched, 1, 2).astype(np.uint8),
                guide=target.color,
            ),
            settings=native_settings(
                _native.RefineSettings,
                settings,
                guide_weight=0,
                random_tries=_KNOWN_TRIES,
                seed=(seed + k) % 2**32,
            ),
            threads=settings.threads,
        )


def _refine_level(
    coarse: NDArray[np.int32], exemplar: _Level, target: _Level
) -> tuple[NDArray[np.int32], NDArray[np.int16]]:
    """Source and colour of the next finer level: 2×2 pixels copy what one pixel did."""
    rows, columns = np.indices(target.mask.shape, dtype=np.int32)
    source = 2 * coarse[rows // 2, columns // 2] + np.stack([rows % 2, columns % 2], axis=-1)
    color = exemplar.color[source[..., 0], source[..., 1]]
    known = target.mask != 0
    color[known] = target.color[known]
    return np.ascontiguousarray(source), color


def _fit_patch(valid: NDArray[np.bool_], settings: TextureSettings) -> tuple[int, int]:
    """Side of a patch and number of levels that the exemplar has room for."""
    share_px = round(settings.patch_share * float(np.sqrt(np.count_nonzero(valid))))
    patch = max(min(settings.patch_px, share_px), _MIN_PATCH_PX)
    while True:
        levels = min(settings.levels, (patch // _MIN_PATCH_PX).bit_length())
        coarse = _build_pyramid(np.zeros((*valid.shape, 4), np.int16), valid, levels)[-1].mask != 0
        if _largest_square(coarse) >= patch >> (levels - 1):
            return patch, levels
        if patch == _MIN_PATCH_PX:
            break
        patch = max(patch * 3 // 4, _MIN_PATCH_PX)
    h, w = valid.shape
    raise FitError(
        f"the exemplar is too small: {np.count_nonzero(valid)} pixels of {w}×{h} may be copied, and no square of "
        f"{_MIN_PATCH_PX} pixels fits into them",
        "give a larger picture or a fuller mask",
    )


def _largest_square(mask: NDArray[np.bool_]) -> int:
    """Side of the largest square inside a mask."""
    sums = np.zeros((mask.shape[0] + 1, mask.shape[1] + 1), np.int64)
    sums[1:, 1:] = mask.cumsum(0).cumsum(1)
    low, high = 0, min(mask.shape)
    while low < high:
        side = (low + high + 1) // 2
        inside = sums[side:, side:] - sums[:-side, side:] - sums[side:, :-side] + sums[:-side, :-side]
        low, high = (side, high) if inside.max() == side * side else (low, side - 1)
    return low


def _extend(exemplar: NDArray[np.float32], valid: NDArray[np.bool_]) -> NDArray[np.float32]:
    """The exemplar with the nearest valid colour where it is not valid."""
    if valid.all():
        return exemplar
    nearest = distance_transform_edt(~valid, return_distances=False, return_indices=True)
    return np.asarray(exemplar[tuple(nearest)])


def _to_integers(color: NDArray[np.float32]) -> NDArray[np.int16]:
    integers = np.zeros((*color.shape[:2], 4), np.int16)
    integers[..., :3] = np.rint(np.clip(color, 0, 1) * _WHITE)
    return integers


def _build_pyramid(color: NDArray[np.int16], mask: NDArray[np.bool_], levels: int) -> list[_Level]:
    """Means of 2×2 pixels, finest first; a pixel beyond an odd border counts as its neighbour."""
    pyramid = [_Level(color=color, mask=mask.astype(np.uint8))]
    for _ in range(levels - 1):
        fine = pyramid[-1]
        odd = ((0, fine.mask.shape[0] % 2), (0, fine.mask.shape[1] % 2))
        c = np.pad(fine.color, (*odd, (0, 0)), mode="edge")
        m = np.pad(fine.mask, odd, mode="edge")
        c = (c[::2, ::2] + c[1::2, ::2] + c[::2, 1::2] + c[1::2, 1::2] + 2) >> 2
        pyramid.append(_Level(color=c, mask=m[::2, ::2] & m[1::2, ::2] & m[::2, 1::2] & m[1::2, 1::2]))
    return pyramid


def _enlarge(color: NDArray[np.int16], shape: tuple[int, ...]) -> NDArray[np.int16]:
    return np.ascontiguousarray(color.repeat(2, axis=0).repeat(2, axis=1)[: shape[0], : shape[1]])


def _check(
    exemplar: NDArray[np.float32],
    valid: NDArray[np.bool_],
    shape: tuple[int, int],
    fixed: NDArray[np.float32],
    fixed_mask: NDArray[np.bool_],
) -> None:
    if exemplar.ndim != 3 or exemplar.shape[2] != 3 or valid.shape != exemplar.shape[:2]:
        raise ValueError(f"exemplar must be (h, w, 3) and its mask (h, w), not {exemplar.shape} and {valid.shape}")
    if min(shape) < 1:
        raise ValueError(f"shape must be positive, not {shape}")
    if fixed.shape != (*shape, 3) or fixed_mask.shape != tuple(shape):
        raise ValueError(
            f"known must be {(*shape, 3)} and known_mask {tuple(shape)}, not {fixed.shape} and {fixed_mask.shape}"
        )
    if not (np.isfinite(exemplar[valid]).all() and np.isfinite(fixed[fixed_mask]).all()):
        raise ValueError("colours must be finite")
