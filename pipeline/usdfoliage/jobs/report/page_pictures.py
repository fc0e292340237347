"""Pictures within a page: files and arrays as data URIs, so that the page is one file."""

import base64
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.jobs.report.pictures import shrink_to, shrunk_size

QUALITY = 82  # of WebP; photographs of foliage show no fault at it


@dataclass(frozen=True, kw_only=True)
class PagePicture:
    """A picture as a page holds it."""

    uri: str  # empty where the picture is missing
    width: int
    height: int
    name: str  # of the file, for who looks for a missing one


def embed_picture(image: Path | NDArray[np.uint8], longest_px: int, quality: int = QUALITY) -> PagePicture:
    """A file that OpenCV reads, or an sRGB array (H, W, 3) or (H, W, 4), no side longer than this, as WebP.

    A picture that is missing or damaged has no address: a report is written of what is there.
    """
    name = image.name if isinstance(image, Path) else ""
    pixels = read_picture(image) if isinstance(image, Path) else image
    if pixels is None:
        return PagePicture(uri="", width=0, height=0, name=name)
    if pixels.dtype != np.uint8 or pixels.ndim != 3 or pixels.shape[2] not in (3, 4):
        raise ValueError(f"a picture must be (H, W, 3) or (H, W, 4) of uint8, not {pixels.shape} of {pixels.dtype}")
    small = _shrink(pixels, longest_px)
    order = cv2.COLOR_RGB2BGR if small.shape[2] == 3 else cv2.COLOR_RGBA2BGRA
    good, encoded = cv2.imencode(".webp", cv2.cvtColor(small, order), [cv2.IMWRITE_WEBP_QUALITY, quality])
    if not good:
        return PagePicture(uri="", width=0, height=0, name=name)
    data = base64.b64encode(encoded.tobytes()).decode("ascii")
    return PagePicture(uri=f"data:image/webp;base64,{data}", width=small.shape[1], height=small.shape[0], name=name)


def read_picture(path: Path) -> NDArray[np.uint8] | None:
    """(H, W, 3) or (H, W, 4) sRGB of a PNG, JPEG or WebP of 8 bits a channel; None where there is none to be read."""
    try:
        data = np.frombuffer(path.read_bytes(), np.uint8)
    except (OSError, ValueError):  # the latter where the name is none that a file can have
        return None
    try:
        read = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if len(data) else None
    except cv2.error:
        return None
    if read is None or read.dtype != np.uint8:
        return None
    orders = {2: cv2.COLOR_GRAY2RGB, 3: cv2.COLOR_BGR2RGB, 4: cv2.COLOR_BGRA2RGBA}
    order = orders.get(2 if read.ndim == 2 or read.shape[2] == 1 else read.shape[2])
    return None if order is None else np.asarray(cv2.cvtColor(read, order), np.uint8)


def _shrink(pixels: NDArray[np.uint8], longest_px: int) -> NDArray[np.uint8]:
    """Shrunk; colours weigh as much as they are opaque, else those of nothing would fringe a silhouette."""
    if pixels.shape[2] == 3:
        return shrink_to(pixels, longest_px)
    alpha = pixels[..., 3:].astype(np.float32) / 255
    covered = np.concatenate([pixels[..., :3] * alpha, 255 * alpha], axis=2)
    height, width = shrunk_size(pixels.shape[:2], longest_px)
    small = cv2.resize(covered, (width, height), interpolation=cv2.INTER_AREA)
    straight = small[..., :3] / np.maximum(small[..., 3:] / 255, 1e-6)
    return np.asarray(np.rint(np.clip(np.concatenate([straight, small[..., 3:]], axis=2), 0, 255)), np.uint8)
