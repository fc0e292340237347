"""Files that lie in a usdz package, which USD names package.usdz[file within]."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pxr import Ar

from usdfoliage.errors import AssetError
from usdfoliage.files.temporary_folder import temporary_folder


def is_package(path: Path) -> bool:
    """Whether a file is a package by its name; it is an asset by itself, and its folder is the user's."""
    return path.suffix.lower() == ".usdz"


def is_packed(path: Path) -> bool:
    """Whether a path leads into a package."""
    return bool(Ar.IsPackageRelativePath(str(path)))


def display_name(path: Path, folder: Path) -> str:
    """A file's name in messages: from folder, or from the package that holds it."""
    if is_packed(path):
        return str(Ar.SplitPackageRelativePathOuter(str(path))[1])
    return path.relative_to(folder).as_posix() if path.is_relative_to(folder) else str(path)


def file_name(path: Path) -> str:
    """The name of a file, wherever it lies."""
    return Path(str(Ar.SplitPackageRelativePathInner(str(path))[1])).name if is_packed(path) else path.name


def file_of(interface: Path, name: str) -> Path:
    """The file that display_name names, of the asset of that interface layer or package."""
    return Path(f"{interface}[{name}]") if is_package(interface) else interface.parent / name


def size_bytes(path: Path) -> int:
    """Of a file, wherever it lies.

    Raises:
        AssetError: It is not in its package.
    """
    return int(_open(path).GetSize()) if is_packed(path) else path.stat().st_size


@contextmanager
def unpacked(path: Path) -> Iterator[Path]:
    """The file itself, or for so long a copy of what lies in a package, for readers that know no packages.

    Raises:
        AssetError: It is not in its package.
    """
    if not is_packed(path):
        yield path
        return
    with temporary_folder("unpacked", AssetError) as folder:
        copy = folder / file_name(path)
        copy.write_bytes(_open(path).GetBuffer())
        yield copy


def _open(path: Path) -> Ar.Ar_PyAsset:
    opened = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(str(path)))
    if opened is None:
        raise AssetError(f"{path} cannot be read", "pack the asset again")
    return opened
