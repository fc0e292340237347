"""A library of plants: the list of their captures, and what becomes of them."""

import csv
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from usdfoliage import __version__
from usdfoliage.asset.plant import asset_name
from usdfoliage.capture.cloud_files.read import CLOUD_SUFFIXES
from usdfoliage.capture.folder.listing import IMAGES, VIDEOS, is_picture, is_video, list_pictures
from usdfoliage.errors import CaptureError, FoliageError
from usdfoliage.files.reading import read_regular
from usdfoliage.jobs.plant.finish import BuiltPlant
from usdfoliage.jobs.plant.pages.library_page import Library, LibraryPlant, PlantState, write_library_page
from usdfoliage.remarks import warnings_of
from usdfoliage.sketch.strokes import SUFFIX, find_strokes, name_tree, read_strokes, strokes_beside

COLUMNS = ("capture", "name", "plan")
_PAGE_SHARE = 0.05  # of the time, that writing the page may take while plants are built


@dataclass(frozen=True, kw_only=True)
class LibraryEntry:
    """A plant that a library is to have."""

    name: str
    capture: Path
    plan: Path | None = None  # settings of its own, over those of all
    place: str = ""  # where the list has it
    tree: int | None = None  # of a photograph whose strokes are of several trees, counted from 1


@dataclass(frozen=True, kw_only=True)
class LibraryList:
    """All plants, and what was found beside them and is none."""

    entries: tuple[LibraryEntry, ...]
    skipped: tuple[LibraryPlant, ...] = ()


def read_library(source: Path) -> LibraryList:
    """The plants of a list, or of a folder.

    Args:
        source: A folder, whose sub-folders with photographs, captures and point clouds are plants, and whose
            photographs are, each with strokes beside it: a plant for each of their trees. A text file, with a
            capture a line, and after tabs its name and its plan, if need be. A CSV file, whose first line names
            columns: capture, and if need be name and plan. Lines that begin with # are comments; paths are as seen
            from the file.

    Raises:
        CaptureError: It cannot be read, a line cannot be understood, there are none, or two have one name.
    """
    if source.is_dir():
        listed = _read_folder(source)
    else:
        if source.exists() and not source.is_file():  # a pipe would be waited for
            raise CaptureError(f"{source} is no regular file", "name a list of captures, or a folder of them")
        try:
            text = read_regular(source).decode("utf-8-sig")
        except OSError as error:
            raise CaptureError(
                f"{source} cannot be read: {error.strerror}", "name a list of captures, or a folder"
            ) from error
        except UnicodeDecodeError as error:
            raise CaptureError(
                f"{source} is no text in UTF-8", "name a list of captures, or a folder of them"
            ) from error
        listed = LibraryList(entries=tuple(_read_lines(source, text)))
    if not listed.entries:
        raise CaptureError(f"{source} has no captures", "put one a line there, or name a folder of captures")
    names: dict[str, LibraryEntry] = {}
    for entry in listed.entries:
        other = names.setdefault(entry.name.casefold(), entry)
        if other is not entry:
            raise CaptureError(
                f"{entry.place}: {entry.capture.name} and {other.capture.name} ({other.place}) would both be called "
                f"{entry.name}",
                "give one of them another name in a list, after a tab",
            )
    return listed


def _read_folder(folder: Path) -> LibraryList:
    entries: list[LibraryEntry] = []
    skipped: list[LibraryPlant] = []
    try:
        paths = sorted(path for path in folder.iterdir() if not path.name.startswith("."))
        used, unused = list_pictures(path.name for path in paths)
        of_photographs = {strokes_beside(Path(name)).name for name in used}
        for path in paths:
            if path.is_dir():
                try:
                    has_photographs = (path / IMAGES).is_dir() or (path / VIDEOS).is_dir()
                    has_photographs = has_photographs or any(is_picture(each.name) for each in path.iterdir())
                except OSError:  # this plant fails, and the others are built
                    has_photographs = True
                if has_photographs:
                    entries.append(_entry(path, str(folder)))
                else:
                    remedy = "put photographs there, or move the folder elsewhere"
                    skipped.append(_skip(path, "the folder has no photographs", remedy))
            elif is_video(path.name) or (
                path.suffix.lower() in CLOUD_SUFFIXES and path.suffix.lower() not in (".txt", ".csv")
            ):
                entries.append(_entry(path, str(folder)))
            elif path.name in unused:
                skipped.append(_skip(path, "another photograph of that name is used", "name them apart to use both"))
            elif is_picture(path.name) and path.is_file():
                if find_strokes(path) is not None:
                    entries += _trees_of(_entry(path, str(folder)))
                else:
                    remedy = f"draw them, and save them as {strokes_beside(path).name} there"
                    skipped.append(_skip(path, "the photograph has no strokes beside it", remedy))
            elif path.name.endswith(SUFFIX) and path.name not in of_photographs:
                skipped.append(_skip(path, "there is no photograph of these strokes", "put it beside them"))
    except OSError as error:
        raise CaptureError(
            f"{error.filename or folder} cannot be read: {error.strerror}", "check permissions"
        ) from error
    return LibraryList(entries=tuple(entries), skipped=tuple(skipped))


def _read_lines(source: Path, text: str) -> Iterator[LibraryEntry]:
    lines = text.splitlines()
    numbers = [number for number, line in enumerate(lines) if line.strip() and not line.lstrip().startswith("#")]
    if source.suffix.lower() == ".csv":
        if not numbers:
            return
        first = numbers.pop(0)
        columns = [cell.strip() for cell in _split_csv(lines[first], f"{source}:{first + 1}")]
        if "capture" not in columns or not set(columns) <= set(COLUMNS):
            raise CaptureError(
                f"{source}: the first line must name columns of {', '.join(COLUMNS)}, and capture among them; it has "
                f"{', '.join(columns)}"
            )
    else:
        columns = list(COLUMNS)
    for number in numbers:
        place = f"{source}:{number + 1}"
        if source.suffix.lower() == ".csv":
            cells = _split_csv(lines[number], place)
        else:
            cells = lines[number].split("\t")
        if len(cells) > len(columns):
            raise CaptureError(f"{place} has {len(cells)} columns, and at most {len(columns)} are known")
        row = {column: cell.strip() for column, cell in zip(columns, cells, strict=False)}
        if not row.get("capture"):
            raise CaptureError(f"{place} names no capture")
        capture = source.parent / _read_path(row["capture"], place)
        plan = source.parent / _read_path(row["plan"], place) if row.get("plan") else None
        yield from _trees_of(_entry(capture, place, row.get("name", ""), plan))


def _read_path(text: str, place: str) -> Path:
    if "\0" in text:
        raise CaptureError(f"{place} has a zero byte in a path", "is it a list of captures?")
    try:
        return Path(text).expanduser()
    except RuntimeError as error:  # ~ of nobody
        raise CaptureError(f"{place}: {text} cannot be found: {error}", "write the folder itself") from error


def _split_csv(line: str, place: str) -> list[str]:
    try:
        return next(csv.reader([line]))
    except csv.Error as error:
        raise CaptureError(f"{place} is no line of CSV: {error}", "put one capture a line there") from error


def _entry(capture: Path, place: str, name: str = "", plan: Path | None = None) -> LibraryEntry:
    named = name or (
        capture.stem
        if capture.suffix.lower() in CLOUD_SUFFIXES or is_picture(capture.name)
        else capture.name or capture.absolute().name
    )
    return LibraryEntry(name=asset_name(named), capture=capture, plan=plan, place=place)


def _trees_of(entry: LibraryEntry) -> list[LibraryEntry]:
    """An entry for each tree of a photograph; the entry itself where strokes are of one, or cannot be read."""
    photo = entry.capture
    if not is_picture(photo.name):
        return [entry]
    try:
        strokes = find_strokes(photo)
        trees = 1 if strokes is None else len(read_strokes(strokes).trees)
    except (CaptureError, OSError):  # this plant fails, and the others are built
        trees = 1
    if trees == 1:
        return [entry]
    return [replace(entry, name=f"{entry.name}_{name_tree(number)}", tree=number) for number in range(1, trees + 1)]


def _skip(path: Path, message: str, remedy: str) -> LibraryPlant:
    return LibraryPlant(name=path.name, state="skipped", capture=path.name, message=message, remedy=(remedy,))


@dataclass
class LibraryIndex:
    """The page of a library, written again as its plants end."""

    folder: Path
    plants: int  # there will be
    skipped: Sequence[LibraryPlant] = ()
    _ended: list[LibraryPlant] = field(default_factory=list, init=False)
    _cost_s: float = field(default=0.0, init=False)
    _written: float = field(default=0.0, init=False)

    def add(self, plant: LibraryPlant) -> None:
        """Write the page with that plant too, unless the last time is too short ago for how long it takes."""
        self._ended.append(plant)
        if time.monotonic() - self._written >= self._cost_s / _PAGE_SHARE:
            self.write()

    def write(self) -> Path:
        """Write the page; AssetError where it cannot be."""
        start = time.monotonic()
        left = self.plants - len(self._ended)
        library = Library(
            title=self.folder.absolute().name,
            plants=[*self._ended, *self.skipped],
            generator=f"usdfoliage {__version__}",
            notes=[f"{left} of {self.plants} plants are still to come."] if left else [],
        )
        page = write_library_page(self.folder, library)
        self._written = time.monotonic()
        self._cost_s = self._written - start
        return page


def describe_built(made: BuiltPlant, folder: Path) -> LibraryPlant:
    """A plant as the page shows it.

    Args:
        made: What became of it.
        folder: Of the library.
    """
    request = made.request
    capture = request.capture.name
    if made.verdict in ("failed", "fault"):
        text = made.error.strip().splitlines()[-1] if made.is_fault else made.error
        return describe_failed(request.name, capture, FoliageError(text, made.remedy), request.settings.plant.species)
    warnings = warnings_of(made.remarks)
    state: PlantState = "warnings" if warnings or made.errors else "built"
    message = warnings[0].text if warnings else ""
    remedy = warnings[0].remedy if warnings else ()
    report = made.result / "report" / "index.html" if made.result is not None and made.asset is None else None
    if made.errors and made.asset is None:
        state = "failed"
        message, remedy = f"validation finds {made.errors} error{'s' if made.errors != 1 else ''}; see {report}", ()
    thumbnail = request.output / "thumbnails" / f"{request.name}.png"
    inside = f"{request.output.name}/" if request.output.parent == folder else f"{request.output}/"
    is_there = made.asset is not None
    return LibraryPlant(
        name=request.name,
        state=state,
        capture=capture,
        species=request.settings.plant.species,
        thumbnail=thumbnail if is_there and thumbnail.is_file() else None,
        height_m=None if made.height_m is None else round(made.height_m, 2),  # as its own report has it
        leaves=made.leaves,
        branches=made.branches,
        size_bytes=sum(each.stat().st_size for each in request.output.rglob("*") if each.is_file())
        if is_there
        else None,
        message=message,
        remedy=remedy,
        warnings=len(warnings),
        report=f"{inside}report/index.html" if is_there else "",
        asset=f"{inside}{request.name}.usda" if is_there else "",
    )


def describe_failed(name: str, capture: str, error: FoliageError, species: str = "") -> LibraryPlant:
    """A plant that was not built, and why."""
    return LibraryPlant(
        name=name,
        state="failed",
        capture=capture,
        species=species,
        message=error.text,
        remedy=error.remedy,
    )


def explain_entry(entry: LibraryEntry, error: FoliageError) -> FoliageError:
    """The error about an entry that is no valid request."""
    return FoliageError(f"{entry.place}: {error.text}", error.remedy)
