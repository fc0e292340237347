"""The files that an export names: copied beside it, or converted, and named from there."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from pxr import Sdf, Usd, UsdShade

from usdfoliage.asset.own_files import copy_own, may_hand_on
from usdfoliage.errors import AssetError
from usdfoliage.files.library_text import library_text
from usdfoliage.files.unwritten import describe_failed
from usdfoliage.geometry.color import encode_srgb

TEXTURES = "textures"  # the folder of an export
PACKED = (".png", ".jpg", ".jpeg")  # pictures that AR reads


def gather_files(stage: Usd.Stage, own: Path, out: Path, *, for_ar: bool, only_shading: bool) -> list[str]:
    """Copy what a flat stage names into out/textures, and name it from out.

    Args:
        stage: Its asset paths are absolute; they are changed.
        own: The folder of the asset, from which alone files are handed on.
        out: The folder of the export.
        for_ar: Pictures that are neither PNG nor JPEG become PNG, 8 bit, sRGB.
        only_shading: Paths that no shading node reads go, as those of cubemaps of data.

    Returns:
        The names of the files, from out.

    Raises:
        AssetError: A file lies outside the asset's folder, is no picture, or cannot be read.
        WriteError: One cannot be written.
    """
    written: dict[Path, str] = {}
    for prim in list(stage.Traverse()):
        shader = UsdShade.Shader(prim)
        for attribute in list(prim.GetAuthoredAttributes()):
            if attribute.GetTypeName() != Sdf.ValueTypeNames.Asset:
                continue
            value = attribute.Get()
            if value is None or not value.path:
                continue
            if only_shading and not shader:
                prim.RemoveProperty(attribute.GetName())
                continue
            source = Path(value.resolvedPath or value.path)
            if source not in written:
                if not may_hand_on(source, own):
                    raise AssetError(
                        f"<{attribute.GetPath()}> names {source}, which is no picture in the asset's folder",
                        "put a picture there, and name that",
                    )
                written[source] = _write(source, out, set(written.values()), for_ar=for_ar)
            attribute.Set(Sdf.AssetPath(f"./{written[source]}"))
            if for_ar and source.suffix.lower() not in PACKED and shader:
                space = shader.GetInput("sourceColorSpace") or shader.CreateInput(
                    "sourceColorSpace", Sdf.ValueTypeNames.Token
                )
                space.Set("sRGB")
    return sorted(written.values())


def _write(source: Path, out: Path, taken: set[str], *, for_ar: bool) -> str:
    """Copy or convert one file; returns its name from out."""
    converts = for_ar and source.suffix.lower() not in PACKED
    suffix = ".png" if converts else source.suffix.lower()
    stem, number = source.stem, 1
    name = f"{TEXTURES}/{stem}{suffix}"
    while name in taken:
        number += 1
        name = f"{TEXTURES}/{stem}_{number}{suffix}"
    target = out / name
    target.parent.mkdir(exist_ok=True)
    write: Callable[[Path, Path], None] = _convert if converts else copy_own
    write(source, target)
    return name


def _convert(source: Path, target: Path) -> None:
    """Write a picture of linear or encoded colour as PNG of 8 bit, sRGB."""
    picture = oiio.ImageBuf(str(source))
    pixels = picture.get_pixels(oiio.FLOAT)
    if pixels is None or picture.has_error:
        raise AssetError(f"{source} cannot be read ({library_text(picture.geterror)})", "write the asset again")
    pixels = np.asarray(pixels, np.float32)
    if pixels.shape[2] == 2 or pixels.shape[2] > 4:
        pixels = pixels[:, :, :1]
    if str(picture.spec().getattribute("oiio:ColorSpace") or "").lower() not in ("srgb", "srgb_rec709_scene"):
        pixels[:, :, :3] = encode_srgb(np.nan_to_num(pixels[:, :, :3]))  # of the channels alpha stays
    bytes_ = np.rint(255 * np.clip(pixels, 0, 1)).astype(np.uint8)
    spec = oiio.ImageSpec(bytes_.shape[1], bytes_.shape[0], bytes_.shape[2], oiio.UINT8)
    spec.attribute("oiio:ColorSpace", "sRGB")
    output = oiio.ImageOutput.create(str(target))
    if output is None or not output.open(str(target), spec):
        raise describe_failed(target, library_text(oiio.geterror) or "no reason given")
    written = output.write_image(bytes_) and output.close()
    if not written:
        raise describe_failed(target, library_text(output.geterror) or "no reason given")
