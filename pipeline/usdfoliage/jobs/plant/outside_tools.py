"""What decides results and is not in the package: the validators of the place, and the interpreter that draws.

Where possible each is described by its content, not by its place, so that machines of a farm agree on a result's key.
"""

import glob
import importlib.util
import os
import re
from collections.abc import Iterator
from functools import cache, lru_cache
from itertools import islice
from pathlib import Path

from usdfoliage.asset.provenance import VALIDATION_PACKAGES, package_versions
from usdfoliage.asset.resources import plugin_path_folders
from usdfoliage.errors import PreviewError
from usdfoliage.files.hashing import hash_each, hash_file
from usdfoliage.jobs.preview.recorder import INTERPRETER_VARIABLE, find_interpreter

PLUGIN_VARIABLE = "PXR_PLUGINPATH_NAME"
_PLUGIN_INFO = "plugInfo.json"
_MAX_FILES = 2000  # of a place that plug-ins are in; what comes after them is not looked at
_MAX_FOLDERS = 2000  # of one
_MAX_BYTES = 4_000_000  # of a file; larger ones, and libraries, are described by size and time
_READ = (".py", ".json", ".usda")
_LIBRARIES = (".so", ".dylib", ".pyd", ".dll")
_DRAWS = re.compile(r"(bpy|usd_core|usd)-(.+)\.dist-info")


def describe_validators() -> tuple[tuple[tuple[str, str], ...], str]:
    """What an asset is validated by besides the package and the profile: packages, and a digest of the plug-ins that
    PXR_PLUGINPATH_NAME names. Looked at once in a process."""
    plugins = _digest_plugins(os.environ.get(PLUGIN_VARIABLE, ""))
    return _versions(VALIDATION_PACKAGES), plugins


def describe_interpreter() -> tuple[str, ...]:
    """Which interpreter draws: the installed versions of its Blender and USD, or the program where they are unknown.

    Nothing is started.
    """
    try:
        python = find_interpreter()
    except PreviewError:
        return ("none",)
    chosen = bool(os.environ.get(INTERPRETER_VARIABLE))
    return _describe_python(python, os.environ.get("PYTHONPATH", "") if chosen else "")


def forget() -> None:
    """Look at everything again."""
    for cached in (_describe_python, _versions, _digest_plugins, _places_of):
        cached.cache_clear()


@lru_cache(maxsize=8)
def _describe_python(python: Path, python_path: str) -> tuple[str, ...]:
    # Not resolved: a virtual environment's interpreter is a link to that of the system.
    folders = [*sorted(python.parent.parent.glob("lib*/python3*/site-packages")), *map(Path, _split(python_path))]
    versions = tuple(sorted({path.name for folder in folders for path in folder.glob("*.dist-info")}))
    found = tuple(name for name in versions if _DRAWS.fullmatch(name))
    # Another pxr comes before that which is installed.
    shadows = tuple(entry for entry in _split(python_path) if (Path(entry) / "pxr").is_dir())
    if found:
        return found + shadows
    try:
        seen = python.stat()
    except OSError:
        return (str(python), *shadows)
    return (str(python), str(seen.st_size), str(seen.st_mtime_ns), *shadows)


@lru_cache(maxsize=8)
def _versions(names: tuple[str, ...]) -> tuple[tuple[str, str], ...]:
    return tuple(sorted(package_versions(names).items()))


@lru_cache(maxsize=8)
def _digest_plugins(places: str) -> str:
    """Of the text of plug-ins, and of the Python modules that they name; "" where there are none."""
    ours = {str(folder) for folder in plugin_path_folders()}  # which the version of the code holds
    marks = [
        f"{name}\0".encode(errors="surrogateescape") + _mark(path)
        for entry in _split(places)
        for place in sorted(glob.glob(entry, recursive=True))  # noqa: PTH207 (of any path, as USD takes them)
        if str(Path(place)) not in ours
        for name, path in islice(_plugin_files(Path(place) if Path(place).is_dir() else Path(place).parent), _MAX_FILES)
    ]
    return hash_each(marks).hex() if marks else ""


def _split(paths: str) -> list[str]:
    return [entry for entry in paths.split(os.pathsep) if entry]


def _plugin_files(folder: Path) -> Iterator[tuple[str, Path]]:
    """The files of plug-ins below a folder by their names there, and those of the modules of which they are."""
    modules: set[str] = set()
    for name, path in _files_below(folder):
        yield name, path
        if path.name == _PLUGIN_INFO:
            modules |= _modules(path)
    for module in sorted(modules - {"usdfoliage", "pxr"}):
        for place in _places_of(module):
            if not place.is_relative_to(folder):
                yield from ((f"{module}/{name}", path) for name, path in _files_below(place))


def _files_below(folder: Path) -> Iterator[tuple[str, Path]]:
    for below, folders, names in islice(os.walk(folder), _MAX_FOLDERS):
        folders[:] = sorted(name for name in folders if not name.startswith((".", "__pycache__")))
        for name in sorted(names):
            path = Path(below) / name
            if path.suffix in _READ or path.suffix in _LIBRARIES:
                yield path.relative_to(folder).as_posix(), path


def _modules(plugin_info: Path) -> set[str]:
    """The modules that a plugInfo.json may name; it has comments, which JSON does not."""
    try:
        text = plugin_info.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return set()
    return {name.split(".")[0] for name in re.findall(r'"Name"\s*:\s*"([A-Za-z_][\w.]*)"', text)}


@cache
def _places_of(module: str) -> tuple[Path, ...]:
    """The folders of a package that can be imported; it is not."""
    try:
        found = importlib.util.find_spec(module)
    except (ImportError, ValueError):
        return ()
    return tuple(Path(place) for place in (found.submodule_search_locations or ()) if place) if found else ()


def _mark(path: Path) -> bytes:
    """The digest of a file's bytes; of large ones and of libraries, size and time."""
    try:
        seen = path.stat()
        if path.suffix in _LIBRARIES or seen.st_size > _MAX_BYTES:
            return f"{seen.st_size} {seen.st_mtime_ns}".encode()
        return hash_file(path)
    except OSError as error:  # USD does not read it either
        return str(error.errno).encode()
