"""What is known of a photograph's pixels, as OpenEXR: depth, normals and confidence.

Every map lies on the pixels of the photograph as it was taken, lens distortion included, as those of a depth camera do:
read_view takes the distortion out of both photograph and depth. What was found in pictures without distortion is laid
back with Undistortion.distorted. Files are ZIP compressed and have no date: the same map, the same bytes.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from usdfoliage.capture.folder.depth_map import DEPTH_CHANNEL
from usdfoliage.errors import CaptureError
from usdfoliage.files.library_text import library_text
from usdfoliage.files.open_exr import write_open_exr

# A layer of its own: Z alone is depth, to read_depth as to any compositing program.
NORMAL_CHANNELS = ("N.X", "N.Y", "N.Z")
CONFIDENCE_CHANNEL = "Y"


def write_depth_map(path: Path, depth_m: NDArray[np.floating]) -> None:
    """Write metres along the optical axis (H, W), 0 where there is none, in float32.

    Raises:
        ValueError: A depth is negative or not finite, or they are not (H, W).
        WriteError: The file cannot be written; what was there is unchanged.
    """
    _check(depth_m, 2, "depth")
    if depth_m.min(initial=0) < 0:
        raise ValueError(f"the least depth is {depth_m.min():g} m; 0 is none")
    facts = {"foliage:quantity": "depth along the optical axis", "foliage:unit": "m, 0 is none"}
    _write(path, {DEPTH_CHANNEL: depth_m.astype(np.float32)}, facts)


def write_normal_map(path: Path, normals: NDArray[np.floating]) -> None:
    """Write unit normals (H, W, 3) in the axes of the capture's world, 0 where there are none, in half.

    Raises:
        ValueError: They are not unit, nor 0, or not (H, W, 3).
        WriteError: The file cannot be written; what was there is unchanged.
    """
    _check(normals, 3, "normals")
    length = np.linalg.norm(normals, axis=2)
    if normals.shape[2] != 3 or not ((length == 0) | (np.abs(length - 1) < 1e-2)).all():
        raise ValueError("normals must be (H, W, 3) of length 1, or 0 for none")
    facts = {"foliage:quantity": "normal", "foliage:frame": "axes of the capture's world; unit, 0 is none"}
    half = normals.astype(np.float16)
    _write(path, {name: half[..., axis] for axis, name in enumerate(NORMAL_CHANNELS)}, facts)


def write_confidence_map(path: Path, confidence: NDArray[np.floating]) -> None:
    """Write how much the depth (H, W) is trusted, 0 to 1, in half.

    Raises:
        ValueError: A value is outside [0, 1] or not finite, or they are not (H, W).
        WriteError: The file cannot be written; what was there is unchanged.
    """
    _check(confidence, 2, "confidence")
    if confidence.min(initial=0) < 0 or confidence.max(initial=0) > 1:
        raise ValueError(f"confidence must be in [0, 1], not {confidence.min():g} to {confidence.max():g}")
    facts = {"foliage:quantity": "confidence of the depth", "foliage:unit": "0 to 1"}
    _write(path, {CONFIDENCE_CHANNEL: confidence.astype(np.float16)}, facts)


def read_normal_map(path: Path) -> NDArray[np.float32]:
    """(H, W, 3), unit, in the axes of the capture's world; 0 where there are none.

    Raises:
        CaptureError: The file is missing or damaged, or has no normals.
    """
    channels = _read(path)
    names = next((names for names in (NORMAL_CHANNELS, ("X", "Y", "Z")) if channels.keys() >= set(names)), None)
    if names is None:
        raise CaptureError(f"{path} has the channels {_listed(channels)}, not {', '.join(NORMAL_CHANNELS)}")
    normals = np.stack([channels[name] for name in names], axis=-1)
    normals[~np.isfinite(normals).all(axis=2)] = 0
    length = np.linalg.norm(normals, axis=2, keepdims=True)
    return np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)


def read_confidence_map(path: Path) -> NDArray[np.float32]:
    """(H, W), 0 to 1.

    Raises:
        CaptureError: The file is missing or damaged, or has no confidence.
    """
    channels = _read(path)
    name = next((name for name in (CONFIDENCE_CHANNEL, "confidence") if name in channels), None)
    if name is None:
        raise CaptureError(f"{path} has the channels {_listed(channels)}, not {CONFIDENCE_CHANNEL}")
    return np.clip(np.nan_to_num(channels[name]), 0, 1)


def _check(values: NDArray[np.floating], dimensions: int, what: str) -> None:
    if values.ndim != dimensions or not values.size:
        raise ValueError(f"{what} must have {dimensions} dimensions and pixels, not {values.shape}")
    if not np.isfinite(values).all():
        raise ValueError(f"{np.count_nonzero(~np.isfinite(values))} values of the {what} are not finite")


def _write(path: Path, channels: Mapping[str, NDArray[np.floating]], facts: Mapping[str, str]) -> None:
    write_open_exr(path, {"colorInteropID": "data", **facts}, channels)


def _read(path: Path) -> dict[str, NDArray[np.float32]]:
    """The channels of an OpenEXR file by their names."""
    if not path.is_file():
        raise CaptureError(f"{path} does not exist or is no file", "give a map in OpenEXR")
    # By OpenImageIO: the OpenEXR module prints on stdout about what is damaged.
    source = oiio.ImageInput.open(str(path))
    if source is None or source.format_name() != "openexr":
        library_text(oiio.geterror)  # else it is printed at the end
        raise CaptureError(f"{path} is no OpenEXR file that can be read", "copy it again")
    try:
        spec = source.spec()
        names = [str(name) for name in spec.channelnames]
        pixels = None if spec.deep else source.read_image("float")
        if pixels is None or source.has_error:
            library_text(source.geterror)
            raise CaptureError(f"{path} is truncated or damaged", "copy it again")
    except UnicodeDecodeError as error:
        raise CaptureError(f"{path} has names that are not Unicode", "copy it again") from error
    finally:
        source.close()
    planes = np.array(pixels, np.float32).reshape(spec.height, spec.width, len(names))
    return {name: np.ascontiguousarray(planes[..., number]) for number, name in enumerate(names)}


def _listed(channels: Mapping[str, object]) -> str:
    return ", ".join(channels)[:80] or "none"
