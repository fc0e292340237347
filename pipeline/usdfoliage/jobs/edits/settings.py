"""The user's settings of how an asset of leaves is written, checked."""

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from usdfoliage.asset.materials.jitter_map import read_jitter_map
from usdfoliage.asset.parts.leaf_part import LeafAssetSettings
from usdfoliage.asset.variants import REPRESENTATIONS
from usdfoliage.errors import CaptureError, FoliageError
from usdfoliage.files.hashing import hash_each, hash_file
from usdfoliage.leaf.shape.mesh import LeafMeshSettings

# Of memory, measured with tens of thousands of leaves; one representation is written after another.
BYTES_A_LEAF: Mapping[str, int] = {"bezier": 1100, "nurbs": 42_000, "subdiv": 7500, "mesh": 0}
BYTES_A_CELL = 180  # of a leaf of the mesh
MAX_CELLS = 512  # across or along a leaf


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
    if resolution and max(resolution) > MAX_CELLS:
        raise FoliageError(f"resolution: at most {MAX_CELLS} cells across and along a leaf, not {max(resolution)}")
    try:
        mesh = LeafMeshSettings(across=resolution[0], along=resolution[1]) if resolution else LeafMeshSettings()
        return LeafAssetSettings(representations=tuple(representations), mesh=mesh)
    except ValueError as error:
        raise FoliageError(f"resolution: {error}" if resolution else str(error)) from error


def needed_memory(count: int, settings: LeafAssetSettings) -> int:
    """About how many bytes of memory it takes to write so many leaves."""
    cells = settings.mesh.across * settings.mesh.along
    each = [BYTES_A_LEAF[name] + (cells * BYTES_A_CELL if name == "mesh" else 0) for name in settings.representations]
    return count * (BYTES_A_LEAF["bezier"] + max(each))


def check_memory(count: int, settings: LeafAssetSettings) -> None:
    """Raises FoliageError where this machine has less memory than writing takes: the system would end the run."""
    needed, there = needed_memory(count, settings), os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    if needed > there:
        raise FoliageError(
            f"{count:,} leaves as {', '.join(settings.representations)} need about {needed / 2**30:,.0f} GiB of "
            f"memory, this machine has {there / 2**30:,.0f}",
            "choose fewer representations, or a coarser resolution",
        )


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
        reason = (oiio.geterror() or "no reason given").splitlines()[0]
        raise CaptureError(f"{path} is no image that can be read ({reason})", "use PNG, JPEG, TIFF or EXR")
    source.close()


def fingerprint(files: Iterable[Path | None]) -> str:
    """SHA-256 of files' bytes, one after the other."""
    return hash_each(hash_file(path) for path in files if path is not None).hex()
