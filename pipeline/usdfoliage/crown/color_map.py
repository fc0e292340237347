"""Colour cubemap of a crown from one photograph: what the camera saw in front, synthesised foliage everywhere else.

Lateral faces are synthesised as one strip, top and bottom as squares, and the three are merged along graph cuts.
Beyond the thesis, the photograph itself is laid on the front, the synthesis grows from it, and a cut through the texels
that it sees at a grazing angle decides where the one becomes the other.

Faces are seen from the centre of the cube, so a photograph appears mirrored on +Z and the exemplar is mirrored with it.

Source: the thesis on semi-procedural crowns, section 4.5.2 and figure 4.24.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion

from usdfoliage.crown.seam import cut_seam
from usdfoliage.crown.texture import TextureSettings, synthesize_texture
from usdfoliage.crown.tone import ColorStatistics, ToneSettings, blend_tone, match_statistics
from usdfoliage.geometry.color import encode_srgb
from usdfoliage.geometry.cubemap import FACES, share_borders
from usdfoliage.progress import PartCounter, Progress

_FRONT, _TOP, _BOTTOM = FACES.index("+Z"), FACES.index("+Y"), FACES.index("-Y")
# Each face's right border is the next one's left border; the front is second so that it can lie in the strip's middle.
_LATERAL = tuple(FACES.index(name) for name in ("+X", "+Z", "-X", "-Z"))
# Quarter turns, counter-clockwise, after which the top face's last row is the border that it shares with that lateral
# face, in the same order. The bottom face follows from it: turned upside down, the cube is a cube again.
_TURNS = (3, 2, 1, 0)


@dataclass(frozen=True, kw_only=True)
class ColorMapSettings:
    """Where the photograph is kept, and how faces are merged."""

    band: float = 1 / 8  # overlap of the merges, as a fraction of a face
    keep_weight: float = 0.65  # a texel seen at least this squarely is the photograph's, wherever it lies
    reach_weight: float = 0.55  # beside the front face, a texel seen less squarely never is; it would show as a smear
    front_weight: float = 0.55  # on the front face, a texel seen at least this squarely always is
    texture: TextureSettings = field(default_factory=TextureSettings)
    tone: ToneSettings = field(default_factory=ToneSettings)

    def __post_init__(self) -> None:
        if not 0 < self.band <= 0.25:
            raise ValueError(f"band must be in (0, 0.25], not {self.band}")
        for name in ("reach_weight", "front_weight"):
            if not 0 < getattr(self, name) <= self.keep_weight <= 1:
                raise ValueError(
                    f"0 < {name} <= keep_weight <= 1 is needed, not {getattr(self, name)} and {self.keep_weight}"
                )


def build_color_map(
    exemplar: NDArray[np.float32],
    exemplar_mask: NDArray[np.bool_],
    photo_on_cube: NDArray[np.float32],
    photo_weight: NDArray[np.floating],
    target: ColorStatistics,
    rng: np.random.Generator,
    settings: ColorMapSettings = ColorMapSettings(),
    progress: Progress | None = None,
) -> NDArray[np.float32]:
    """Colour cubemap of a crown.

    Args:
        exemplar: (h, w, 3) linear Rec.709, the photograph's crown with one pixel as large as a texel in the middle of
            the +Z face, as photographed (x to the right).
        exemplar_mask: (h, w), where it is crown.
        photo_on_cube: (6, N, N, 3) linear, the photograph as every texel's surface point appears in it.
        photo_weight: (6, N, N), the cosine between surface normal and viewing direction; 0 where it is not seen.
        target: statistics of the crown in the photograph at its own resolution.
        rng: the synthesis' choices.
        settings: where the photograph is kept, and how faces are merged.
        progress: (done, total) of the synthesised texels.

    Returns:
        (6, N, N, 3) linear Rec.709, not negative; border texels shared by faces are equal.

    Raises:
        ValueError: shapes do not fit each other, or N is below 8.
    """
    size = photo_on_cube.shape[1]
    if photo_on_cube.shape != (6, size, size, 3) or photo_weight.shape != (6, size, size) or size < 8:
        raise ValueError(
            f"photo_on_cube and photo_weight must be (6, N, N, 3) and (6, N, N), N at least 8, not "
            f"{photo_on_cube.shape} and {photo_weight.shape}"
        )
    if exemplar.ndim != 3 or exemplar.shape[2] != 3 or exemplar_mask.shape != exemplar.shape[:2]:
        raise ValueError(f"exemplar must be (h, w, 3) and its mask (h, w), not {exemplar.shape}, {exemplar_mask.shape}")

    peak = max(1.0, float(exemplar[exemplar_mask].max(initial=0)))  # an EXR may be brighter than white
    source = np.ascontiguousarray(_encode(exemplar, peak)[:, ::-1])
    source_mask = np.ascontiguousarray(exemplar_mask[:, ::-1])
    photo, weight, front = _share_photo(_encode(photo_on_cube, peak), photo_weight)
    reached = (weight >= settings.reach_weight) | (front & (weight > 0))
    kept = (weight >= settings.keep_weight) | (front & (weight >= settings.front_weight))

    band = max(2, round(settings.band * size))
    strip_shape = (size + 2 * band, 4 * (size - 1) + band)
    counter = PartCounter(progress, strip_shape[0] * strip_shape[1] + 2 * size * size)

    def synthesize(shape: tuple[int, int], net: Callable[[NDArray[Any]], NDArray[Any]]) -> NDArray[np.float32]:
        known, must, may = net(photo), net(kept), net(reached)
        # What the synthesis knows ends before the cut can begin: where both images are the same a cut costs nothing,
        # and it would follow that border.
        known_mask = binary_erosion(must, iterations=band // 2, border_value=1)
        image = synthesize_texture(
            source,
            shape,
            rng,
            exemplar_mask=source_mask,
            known=known,
            known_mask=known_mask,
            settings=settings.texture,
            progress=counter.next_piece(shape[0] * shape[1]),
        )
        return _lay_photo(image, known, must, may)

    def strip_net(cubemap: NDArray[Any]) -> NDArray[Any]:
        strip = np.roll(cut_strip(cubemap, band), size // 2, axis=1)  # the front comes to the middle
        return np.concatenate([strip, strip[:, :band]], axis=1)

    strip = np.roll(_merge_ends(synthesize(strip_shape, strip_net), band), -(size // 2), axis=1)
    cubemap = np.empty((6, size, size, 3), np.float32)
    for k, face in enumerate(_LATERAL):
        cubemap[face] = _side(strip[band : band + size], k)
    # Half a turn puts the top above the front and the bottom below it, as the camera sees them.
    top = np.rot90(synthesize((size, size), lambda cubemap: np.rot90(cubemap[_TOP], 2)), 2)
    bottom = np.rot90(synthesize((size, size), lambda cubemap: np.rot90(cubemap[_BOTTOM], 2)), 2)
    cubemap[_TOP] = _merge_cap(top, strip[: band + 1])
    cubemap[_BOTTOM] = _merge_cap(bottom[::-1], strip[::-1][: band + 1])[::-1]

    unseen = 1 - np.clip(weight / min(settings.reach_weight, settings.front_weight), 0, 1)
    merged = np.asarray(share_borders(cubemap), np.float32)
    merged = blend_tone(merged, np.all(merged == photo, axis=-1), settings.tone)
    linear = match_statistics(merged, unseen, target, peak, settings.tone)
    return np.asarray(share_borders(linear), np.float32)


def _share_photo(
    photo: NDArray[np.float32], weight: NDArray[np.floating]
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_]]:
    """Photograph and weight, equal in shared border texels, and which texels are the front face's."""
    front = np.zeros(weight.shape, np.float32)
    front[_FRONT] = 1
    shared = share_borders(np.concatenate([photo, np.stack([weight, front], axis=-1)], axis=-1, dtype=np.float32))
    return np.asarray(shared[..., :3], np.float32), np.asarray(shared[..., 3], np.float32), shared[..., 4] > 0


def cut_strip(cubemap: NDArray[Any], band: int) -> NDArray[Any]:
    """The cubemap's lateral faces side by side, with band rows of the top and bottom face folded up and down.

    Args:
        cubemap: (6, N, N[, C]).
        band: rows of the top and bottom face, at most N − 1.

    Returns:
        (N + 2 band, 4 (N − 1)[, C]), periodic to the right: +X, +Z, −X, −Z, each without its right border, which is the
        next one's left border.
    """
    lateral = np.concatenate([cubemap[face, :, :-1] for face in _LATERAL], axis=1)
    above = _fold_up(cubemap[_TOP], band)
    below = _fold_up(cubemap[_BOTTOM, ::-1], band)[::-1]  # the cube upside down is a cube
    return np.asarray(np.concatenate([above, lateral, below], axis=0))


def _fold_up(top: NDArray[Any], band: int) -> NDArray[Any]:
    """Rows of the top face next to each lateral face, its border row not included."""
    sides = [np.rot90(top, turns)[-1 - band : -1, :-1] for turns in _TURNS]
    return np.asarray(np.concatenate(sides, axis=1))


def _side(strip: NDArray[Any], k: int) -> NDArray[Any]:
    """Columns of the k-th lateral face in a strip, both borders included."""
    size = strip.shape[1] // 4 + 1
    return np.asarray(np.take(strip, np.arange(size) + k * (size - 1), axis=1, mode="wrap"))


def _lay_photo(
    image: NDArray[np.float32], photo: NDArray[np.float32], kept: NDArray[np.bool_], reached: NDArray[np.bool_]
) -> NDArray[np.float32]:
    """The image with the photograph where kept, and as much of where it reaches as the least visible cut takes."""
    if not kept.any():
        return image
    rows, columns = (np.flatnonzero(reached.any(axis=axis)) for axis in (1, 0))
    part = np.s_[max(rows[0] - 1, 0) : rows[-1] + 2, max(columns[0] - 1, 0) : columns[-1] + 2]
    taken = reached.copy()
    if not reached[part].all():
        taken[part] = cut_seam(image[part], photo[part], ~reached[part], kept[part])
    return np.where(taken[..., None], photo, image)


def _merge_ends(strip: NDArray[np.float32], band: int) -> NDArray[np.float32]:
    """Merge 1: (H, W + band, 3) to a strip (H, W, 3) that is periodic to the right."""
    start, end = strip[:, :band], strip[:, -band:]
    keep_end, keep_start = np.zeros((2, len(strip), band), bool)
    keep_end[:, 0] = True
    keep_start[:, -1] = True
    merged = np.where(cut_seam(end, start, keep_end, keep_start)[..., None], start, end)
    return np.concatenate([merged, strip[:, band:-band]], axis=1)


def _merge_cap(top: NDArray[np.float32], edge: NDArray[np.float32]) -> NDArray[np.float32]:
    """Merges 2 and 3: the top face, continuous with the strip around it.

    Args:
        top: (N, N, 3), synthesised.
        edge: (band + 1, 4 (N − 1), 3), the strip's rows above its lateral faces and, last, their topmost row.
    """
    size, depth = len(top), len(edge)
    ring = np.zeros_like(top)
    for k, turns in enumerate(_TURNS):
        view = np.rot90(ring, turns)  # this side below, the next one on the right
        this, following = _side(edge, k), np.rot90(_side(edge, (k + 1) % 4)[:, :depth], 1)
        view[-depth:, depth:-depth] = this[:, depth:-depth]
        # The strip has a quarter turn less than the corner: both sides cover it, and a cut from its tip divides it.
        keep_this, keep_following = np.zeros((2, depth, depth), bool)
        keep_this[-1, :-1] = keep_this[1:, 0] = True
        keep_following[:-1, -1] = keep_following[0, 1:] = True
        keep_this[-1, -1] = True  # the tip itself is the same texel in both
        taken = cut_seam(this[:, -depth:], following, keep_this, keep_following)
        view[-depth:, -depth:] = np.where(taken[..., None], following, this[:, -depth:])
    index = np.minimum(np.arange(size), np.arange(size)[::-1])
    distance = np.minimum(index[:, None], index)  # from the border
    overlap = distance < depth
    taken = cut_seam(ring, top, distance == 0, distance == depth - 1, allowed=overlap)
    return np.where((taken | ~overlap)[..., None], top, ring)


def _encode(linear: NDArray[np.floating], peak: float) -> NDArray[np.float32]:
    """sRGB-encoded values in [0, 1] of linear ones in [0, peak]."""
    return np.asarray(np.clip(encode_srgb(np.asarray(linear, np.float32) / np.float32(peak)), 0, 1), np.float32)
