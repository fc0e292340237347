"""The picture of a leaf that a crown's leaves have: a file, or the average leaf of leaves that were found."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.folder.images import read_photo
from usdfoliage.capture.folder.raster import read_image_spec
from usdfoliage.crown.leaf_picture import LeafPicture, clean_leaf_picture
from usdfoliage.errors import CaptureError, FitError
from usdfoliage.jobs.fitted_leaves import FittedLeaves, read_fitted_leaves
from usdfoliage.leaf.model import Leaves, mean_leaf
from usdfoliage.leaf.shape.fold import find_folds
from usdfoliage.leaf.shape.picture import draw_leaf_picture

MAX_PX = 64_000_000  # of a picture of one leaf
USD_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")


def read_leaf_picture(source: Path, output: Path) -> LeafPicture:
    """The picture of a leaf for a crown.

    Args:
        source: A picture with alpha, the base of the leaf below; or an asset with leaves, whose average leaf is drawn.
        output: The folder that will be replaced.

    Raises:
        CaptureError: The picture cannot be read, is too large, or has no alpha.
        FitError: It shows no leaf.
        AssetError: The asset cannot be read, or has no leaves.
    """
    if source.is_dir() or source.suffix.lower() in USD_SUFFIXES:
        return picture_of_leaves(read_fitted_leaves(source, output))
    try:
        return clean_leaf_picture(_read_with_alpha(source))
    except FitError as error:
        raise FitError(f"{error.text} ({source})", error.remedy) from error


def picture_of_leaves(fitted: FittedLeaves) -> LeafPicture:
    """The average leaf of leaves, in their texture; without one it has a form and no pattern.

    Raises:
        CaptureError: The texture cannot be read, or is too large.
        FitError: There is no leaf that has a form.
    """
    texture = fitted.appearance.texture
    texels = np.ones((2, 2, 4), np.float32) if texture is None else _read_texture(texture)
    try:
        drawn = draw_leaf_picture(average_of(fitted.leaves), texels)
    except ValueError as error:
        raise FitError(f"the average leaf has no picture: {error}") from error
    try:
        return clean_leaf_picture(drawn)
    except FitError as error:
        raise FitError(f"the average leaf has no picture: {error.text}", error.remedy) from error


def describe_leaf(source: Path | None) -> dict[str, str]:
    """The setting of the picture of a leaf, by the name of its option; none without one."""
    return {} if source is None else {"leaf": source.name}


def average_of(leaves: Leaves) -> NDArray[np.float64]:
    """(7, 3), the mean of the leaves that do not fold over themselves, those that are surer counting more."""
    sound = (leaves.parameters[:, 2:5, 1] > 0).all(axis=1) & ~find_folds(leaves.parameters)
    trust = sound.astype(np.float64) if leaves.confidence is None else sound * leaves.confidence
    return mean_leaf(leaves.parameters, trust if trust.sum() > 0 else None)


def _read_with_alpha(path: Path) -> NDArray[np.float32]:
    """(H, W, 4), linear, not multiplied by opacity."""
    linear, alpha = _read_picture(path)
    if alpha is None:
        raise CaptureError(
            f"{path} is nowhere transparent, or everywhere: it has no alpha that cuts out a leaf",
            "give a picture of one leaf that is transparent beside it, such as a PNG",
        )
    return np.dstack([linear, alpha])


def _read_texture(path: Path) -> NDArray[np.float32]:
    """(H, W, 4) of the texture of leaves, opaque where it states nothing."""
    linear, alpha = _read_picture(path)
    return np.dstack([linear, np.ones(linear.shape[:2], np.float32) if alpha is None else alpha])


def _read_picture(path: Path) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    spec = read_image_spec(path)
    if spec is not None and spec.width * spec.height > MAX_PX:
        raise CaptureError(
            f"{path} states {spec.width} x {spec.height} pixels; a picture of a leaf has at most {MAX_PX // 10**6} "
            "million",
            "reduce it: a thousand pixels along the leaf are enough",
        )
    photo = read_photo(path)
    return photo.linear, photo.alpha
