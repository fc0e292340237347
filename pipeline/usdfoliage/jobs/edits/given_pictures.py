"""The pictures that the user gives an asset of leaves, checked."""

from pathlib import Path

from usdfoliage.asset.materials.jitter_map import read_jitter_map
from usdfoliage.errors import CaptureError
from usdfoliage.files.library_text import library_text


def check_pictures(texture: Path | None, jitter_map: Path | None) -> None:
    """Raises CaptureError for a picture that cannot be read."""
    if texture is not None:
        check_texture(texture)
    if jitter_map is not None:
        read_jitter_map(jitter_map)


def check_texture(path: Path) -> None:
    """Raises CaptureError for a file that is no image."""
    import OpenImageIO as oiio

    if not path.is_file():
        raise CaptureError(f"{path} does not exist", "name a picture of a leaf")
    try:
        source = oiio.ImageInput.open(str(path))
    except TypeError as error:  # a name that is not valid Unicode
        raise CaptureError(f"the file name of {path!r} is not valid Unicode", "rename it") from error
    if source is None:
        reason = library_text(oiio.geterror) or "no reason given"
        raise CaptureError(f"{path} is no image that can be read ({reason})", "use PNG, JPEG, TIFF or EXR")
    source.close()
