"""Which files an asset may hand on: those in its own folder. What its layers name elsewhere is never copied.

A path in a layer can lead anywhere: it may be absolute, go up by "..", or through a symbolic link. So the place where
it ends is compared, with all links followed.
"""

import os
from collections.abc import Iterable
from pathlib import Path

from pxr import Usd

from usdfoliage.asset.asset_record import is_asset_folder
from usdfoliage.asset.materials.picture import copy_picture, why_no_picture
from usdfoliage.errors import AssetError
from usdfoliage.files.atomic import copy_whole

_MAX_DEPTH = 3  # of a layer below the folder of its asset
_SHADERS = frozenset((".glslfx", ".osl"))  # by their suffixes


def own_folders(interface: Path, look: Path | None = None, leaves: Usd.Prim | None = None) -> tuple[Path, ...]:
    """The folders whose files belong to an asset, a look of it, or a scene.

    Args:
        interface: The interface layer, or the scene.
        look: The look's file; what it names may lie beside it.
        leaves: The prim of the leaves: what it is composed of in a scene are assets too.
    """
    folders = [interface.parent, *([] if look is None else [look.parent])]
    if leaves is not None and not is_asset_folder(interface.parent):
        layers = [Path(spec.layer.realPath) for spec in leaves.GetPrimStack() if spec.layer.realPath]
        above = [folder for layer in layers for folder in [*layer.parents][:_MAX_DEPTH]]
        folders += [folder for folder in dict.fromkeys(above) if folder.is_dir() and is_asset_folder(folder)]
    return tuple(dict.fromkeys(folders))


def is_own(path: Path, folders: Iterable[Path]) -> bool:
    """Whether a file lies in one of the folders, wherever its name and links lead."""
    real = Path(os.path.realpath(path))
    return any(real.is_relative_to(os.path.realpath(folder)) for folder in folders)


def require_own(path: Path, folders: Iterable[Path], what: str) -> None:
    """Refuse a file that lies elsewhere; what: the file in a message.

    Raises:
        AssetError: It does.
    """
    if not is_own(path, folders):
        raise AssetError(
            f"{what} lies outside the asset's folder, and is never copied from there",
            "put a copy of it into that folder, and name that",
        )


def may_hand_on(path: Path, folder: Path) -> bool:
    """Whether a file that a layer names is copied with the layer: a picture or a shader in the asset's folder."""
    if not is_own(path, [folder]) or not path.is_file():
        return False
    return path.suffix.lower() in _SHADERS or not why_no_picture(path)


def copy_own(source: Path, target: Path) -> None:
    """Copy a file that may be handed on.

    Raises:
        AssetError: It cannot be read.
        WriteError: target cannot be written.
    """
    if source.suffix.lower() in _SHADERS:
        copy_whole(source, target)
    else:
        copy_picture(source, target)
