"""A leaf that was given, a file or the average leaf of leaves that were found: its picture, its form, its texture."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage.asset.parts.leaf_part import LeafAppearance
from usdfoliage.capture.folder.images import read_photo
from usdfoliage.capture.folder.raster import read_image_spec
from usdfoliage.crown.leaf_picture import OPAQUE, LeafPicture, clean_leaf_picture
from usdfoliage.errors import CaptureError, FitError
from usdfoliage.jobs.fitted_leaves import FittedLeaves, read_fitted_leaves
from usdfoliage.leaf.model import Leaves, mean_leaf
from usdfoliage.leaf.shape.edits import NEUTRAL, LeafEdits
from usdfoliage.leaf.shape.fold import find_folds
from usdfoliage.leaf.shape.from_picture import leaf_from_picture
from usdfoliage.leaf.shape.picture import draw_leaf_picture

MAX_PX = 64_000_000  # of a picture of one leaf
USD_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
TEXTURE_PX = 512  # along a leaf, at most, of the texture that its picture gives
_DARKEST = 1e-4  # linear, of the colour that leaves are tinted against


@dataclass(frozen=True, kw_only=True, eq=False)
class GivenLeaf:
    """A leaf for the twigs of a plant and for its crown.

    Attributes:
        picture: For the crown.
        parameters: (7, 3), the form that leaves vary around.
        appearance: Of leaves on twigs. Its texture is a file of the leaf's asset; None where texels are the texture, or
            there is none.
        texels: (h, w, 4), the texture of a leaf that a picture shows: linear, with opacity, over the leaf's st.
        edits: Of the leaf's asset, what no parameter can carry.
        cover: Share of the leaf's area that its texture shows.
    """

    picture: LeafPicture
    parameters: NDArray[np.float64]
    appearance: LeafAppearance
    texels: NDArray[np.float32] | None = None
    edits: LeafEdits = NEUTRAL
    cover: float = 1.0


def read_given_leaf(source: Path, output: Path) -> GivenLeaf:
    """A leaf for a plant, from what read_leaf_picture takes.

    Raises:
        CaptureError: The picture cannot be read, is too large, or has no alpha.
        FitError: It shows no leaf.
        AssetError: The asset cannot be read, or has no leaves.
    """
    if _is_asset(source):
        return _average_leaf(read_fitted_leaves(source, output))
    rgba = _read_with_alpha(source)
    try:
        picture, fine = clean_leaf_picture(rgba), clean_leaf_picture(rgba, TEXTURE_PX)
    except FitError as error:
        raise FitError(f"{error.text} ({source})", error.remedy) from error
    leaf = leaf_from_picture(fine.rgba)
    own = np.nan_to_num(rgba[rgba[..., 3] >= OPAQUE][:, :3].astype(np.float64), posinf=0.0, neginf=0.0)
    texels = leaf.texture.copy()
    texels[..., :3] = np.clip(texels[..., :3] * np.maximum(own.mean(axis=0), 0), 0, 1)
    return GivenLeaf(
        picture=picture,
        parameters=leaf.parameters,
        appearance=LeafAppearance(texture_color=_mean_color(texels)),
        texels=texels,
        cover=leaf.cover,
    )


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
    if _is_asset(source):
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


def _average_leaf(fitted: FittedLeaves) -> GivenLeaf:
    """The average of an asset's leaves."""
    appearance = fitted.appearance
    if appearance.texture is not None and appearance.texture_color is None:
        # A texture without it would show its own colours in place of those of the leaves.
        appearance = replace(appearance, texture_color=_mean_color(_read_texture(appearance.texture)))
    return GivenLeaf(
        picture=picture_of_leaves(fitted),
        parameters=average_of(fitted.leaves),
        appearance=appearance,
        edits=fitted.edits,
    )


def _mean_color(texels: NDArray[np.float32]) -> tuple[float, float, float]:
    """The mean colour of a texture (h, w, 4) where it is opaque, linear, and above 0: leaves are divided by it."""
    inside = texels[texels[..., 3] >= OPAQUE]
    inside = inside if len(inside) else texels.reshape(-1, 4)
    red, green, blue = np.maximum(inside[:, :3].astype(np.float64).mean(axis=0), _DARKEST).tolist()
    return red, green, blue


def _is_asset(source: Path) -> bool:
    return source.is_dir() or source.suffix.lower() in USD_SUFFIXES


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
