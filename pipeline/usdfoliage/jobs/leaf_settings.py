"""What a user says of how an asset of leaves is written, checked."""

import hashlib
from collections.abc import Iterable, Sequence
from pathlib import Path

from usdfoliage.asset.jitter_map import read_jitter_map
from usdfoliage.asset.package import REPRESENTATIONS, LeafAssetSettings
from usdfoliage.errors import CaptureError, FoliageError
from usdfoliage.leaf.mesh import LeafMeshSettings


def read_representations(names: Sequence[str]) -> tuple[str, ...]:
    """Representations in the order of an asset, bezier always among them: without it nothing could be edited.

    Raises:
        FoliageError: There is no such representation.
    """
    unknown = [name for name in names if name not in REPRESENTATIONS]
    if unknown:
        raise FoliageError(f"there is no representation {unknown[0]!r}; there are {', '.join(REPRESENTATIONS)}")
    return tuple(name for name in REPRESENTATIONS if name in names or name == "bezier")


def read_settings(representations: Sequence[str], resolution: Sequence[int] | None) -> LeafAssetSettings:
    """How an asset is written; FoliageError for a mesh that cannot be."""
    try:
        mesh = LeafMeshSettings(across=resolution[0], along=resolution[1]) if resolution else LeafMeshSettings()
        return LeafAssetSettings(representations=tuple(representations), mesh=mesh)
    except ValueError as error:
        raise FoliageError(f"--resolution: {error}" if resolution else str(error)) from error


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
        raise CaptureError(f"{path} does not exist; name a picture of a leaf")
    source = oiio.ImageInput.open(str(path))
    if source is None:
        reason = (oiio.geterror() or "no reason given").splitlines()[0]
        raise CaptureError(f"{path} is no image that can be read ({reason}); use PNG, JPEG, TIFF or EXR")
    source.close()


def fingerprint(files: Iterable[Path | None]) -> str:
    """SHA-256 of files' bytes, one after the other."""
    digest = hashlib.sha256()
    for path in files:
        if path is not None:
            digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()
