"""Which representations an asset of leaves gets, and whether this machine has the memory to write them."""

import os
from collections.abc import Mapping, Sequence

from usdfoliage.asset.parts.leaf_part import LeafAssetSettings
from usdfoliage.asset.variants import REPRESENTATIONS
from usdfoliage.errors import FoliageError
from usdfoliage.leaf.shape.mesh import LeafMeshSettings
from usdfoliage.remarks import Remark, Setting, remark

MAX_LEAVES_OF_ALL = 2000  # up to here every representation is written unless others are asked for
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


def default_representations(count: int) -> tuple[str, ...]:
    """The representations of so many leaves where the user asks for none: all, or bezier alone for many leaves."""
    return tuple(REPRESENTATIONS) if count <= MAX_LEAVES_OF_ALL else ("bezier",)


def note_bezier_alone() -> Remark:
    """So many leaves are written in one representation unless others are asked for."""
    text = f"beyond {MAX_LEAVES_OF_ALL:,} leaves only bezier is written"
    remedy = ("name others with ", Setting(name="plant.representations"), " (nurbs has one prim a leaf)")
    return remark("bezier-alone", text, remedy=remedy)


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
