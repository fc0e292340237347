"""What a work folder holds, and removing what the latest build of no plant needs.

Needed is every task of the latest build, but matching whose depth is done: a round's planes are of use to the next
round and to depth alone. Of the frames of videos those are needed that the latest build of a plant was made of,
although its tasks have copies: each build reads them again. What is removed is made again when a build asks for it.
Nobody loses what is in use: a plant whose tasks run is left alone, as is a task that runs, and no build begins while
this removes.
"""

import logging
import os
import re
import shutil
import time
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from usdfoliage.errors import FoliageError
from usdfoliage.files.locks import is_locked
from usdfoliage.jobs.capture.video_frames import FACTS
from usdfoliage.jobs.plant.inputs import FRAMES
from usdfoliage.jobs.plant.record import KEY, PRUNING, PlantRecord, PlantTask, plant_locks, read_records
from usdfoliage.jobs.plant.store import Stamp, Store, find_finished, read_stamp, remove_leftovers, try_work_lock
from usdfoliage.jobs.plant.tasks import MATCHING

logger = logging.getLogger(__name__)

UNFINISHED = "unfinished"  # what a killed run left of a task
FRAMES_STAGE = "frames"  # what the frames of a video count as; they are of no task
_DAY_S = 86400.0
_BEGINNING_S = 3600.0  # frames are taken before it is noted that a build uses them
_PARTS = ("tasks", "results", "scratch", "views", FRAMES, "builds")
_NEW_FRAMES = re.compile(r"\.([0-9a-f]{32})\.[0-9a-f]+\.new")  # frames that are being taken, or a killed run left

State = Literal["needed", "in use", "recent", "unclear", "not needed"]


@dataclass(frozen=True, kw_only=True)
class StoredTask:
    """What one task has in the work folder, or the frames of a video."""

    key: str
    capture: str  # of the plants that it was made for; empty where nobody knows
    stage: str
    size_bytes: int  # that would be free without it; what several share counts for one of them, a needed one if any
    last_used_s: float  # since 1970
    state: State
    paths: tuple[Path, ...]  # files and folders that are its own


def survey_work(folder: Path, keep_days: float = 0.0) -> tuple[StoredTask, ...]:
    """What every task has in a work folder, those first that are needed. Nothing is written, and nobody waits for it.

    Where it is unknown what some plant needs, all that nobody else needs is unclear, and a warning gives the reason.

    Args:
        folder: The work folder.
        keep_days: What was used in so many days is recent, and not to be removed.

    Raises:
        FoliageError: It is no work folder of builds.
    """
    store = open_work(folder)
    free = {key: not is_locked(store.plant_lock(key)) for key in _plants(store)}
    for remark in _find_unclear(store, free):
        logger.warning("%s", remark)
    return _survey(store, keep_days, free)


def prune_work(folder: Path, keep_days: float = 0.0) -> tuple[StoredTask, ...]:
    """Remove what is not needed.

    Args:
        folder: The work folder.
        keep_days: What was used in so many days stays.

    Returns:
        What was removed.

    Raises:
        FoliageError: It is no work folder of builds, another process prunes it, it cannot be written, or it is
            unknown what some plant needs. Then nothing was removed.
    """
    store = open_work(folder)
    removed = []
    with ExitStack() as locks:
        if not locks.enter_context(try_work_lock(store.plant_lock(PRUNING))):
            raise FoliageError(f"{folder} is being pruned, or a build of it begins, just now", "try again")
        free = {key: locks.enter_context(try_work_lock(store.plant_lock(key))) for key in _plants(store)}
        for remark in _find_unclear(store, free):
            raise FoliageError(remark)
        remove_leftovers(store)
        for stored in _survey(store, keep_days, free):
            if stored.state != "not needed":
                continue
            with try_work_lock(store.lock(stored.key)) as is_idle:
                if is_idle and _remove(store, stored):
                    removed.append(stored)
    return tuple(removed)


def open_work(folder: Path) -> Store:
    """The work folder of that name; FoliageError where it is none, or its parts lead elsewhere."""
    if not (folder / "tasks").is_dir():
        inside = folder / ".usdfoliage"
        hint = f"; did you mean {inside}?" if (inside / "tasks").is_dir() else "; name the work folder itself"
        raise FoliageError(f"{folder} is no work folder of builds: it has no tasks/{hint}")
    for name in _PARTS:
        if (folder / name).is_symlink():
            raise FoliageError(f"{folder / name} is a link; nothing outside of the work folder is looked at or removed")
    return Store(folder=folder)


def _plants(store: Store) -> tuple[str, ...]:
    """The keys of all plants that are remembered, or were."""
    records, damaged = read_records(store)
    return tuple(sorted({*(record.key for record in records), *damaged, *plant_locks(store)}))


def _find_unclear(store: Store, free: dict[str, bool]) -> list[str]:
    """Why it is unknown what some plant needs. It may need any result, since plants share results."""
    records, damaged = read_records(store)
    remarks = [
        f"{store.record(key)} cannot be read ({why}), and what that plant needs is unknown: nothing is removed; "
        "build the plant again, which writes the file anew, or delete the file when no build of it runs, and its "
        "results count as nobody's"
        for key, why in damaged.items()
    ]
    known = {record.key for record in records}
    remarks += [
        f"{store.plant_lock(key)} is locked by a running build whose {store.record(key).name} is gone, and "
        "what it needs is unknown: nothing is removed; try again when it is done"
        for key in sorted(free.keys() - known - damaged.keys())
        if not free[key]
    ]
    return remarks


def _survey(store: Store, keep_days: float, free: dict[str, bool]) -> tuple[StoredTask, ...]:
    records, _ = read_records(store)
    is_unclear = bool(_find_unclear(store, free))
    stamps = {key: stamp for key in _keys(store, "tasks", ".json") if (stamp := read_stamp(store, key)) is not None}
    captures: dict[str, dict[str, None]] = {}
    stages: dict[str, str] = {key: stamp.stage for key, stamp in stamps.items()}
    needed: set[str] = set()
    in_use: set[str] = set()
    for record in records:
        made = {**record.earlier, **{task.key: task.stage for task in record.tasks}}
        stages.update(made)
        for key in made:
            captures.setdefault(key, {})[record.capture] = None
        needed |= _needed(store, record, stamps)
        if not free.get(record.key, False):  # also of a plant that came while this looked
            in_use |= made.keys()

    all_keys = sorted({*stamps, *_keys(store, "results"), *_keys(store, "scratch"), *_keys(store, "views")})
    last_used = {key: _last_used_s(store, key) for key in all_keys}
    states: dict[str, State] = {}
    for key in all_keys:
        is_recent = keep_days > 0 and time.time() - last_used[key] < keep_days * _DAY_S
        state: State = "needed" if key in needed else "recent" if is_recent else "not needed"
        if state != "needed" and key in in_use:
            state = "in use"
        states[key] = "unclear" if is_unclear and state == "not needed" else state
    kept_files = {file.path for key, stamp in stamps.items() if states[key] != "not needed" for file in stamp.files}
    kept_views = {Path(path).parts[1] for path in kept_files if path.startswith("views/")}

    seen: set[tuple[int, int]] = set()
    stored = []
    for key in sorted(all_keys, key=lambda key: (states[key] == "not needed", key)):
        own = [store.stamp(key), store.result(key)]
        if states[key] == "not needed" or key not in stamps:
            own.append(store.scratch(key))
        if key not in kept_views:
            own.append(store.views(key))
        if key in stamps:
            own += _views_of(store, stamps[key], kept_files if states[key] == "not needed" else set())
        stored.append(
            StoredTask(
                key=key,
                capture=", ".join(captures.get(key, ())),
                stage=stages.get(key, UNFINISHED),
                size_bytes=_size_bytes(own, seen),
                last_used_s=last_used[key],
                state=states[key],
                paths=tuple(own),
            )
        )
    frames = _survey_frames(store, records, keep_days, seen, is_unclear=is_unclear)
    return (*stored, *sorted(frames, key=lambda each: each.state == "not needed"))


def _survey_frames(
    store: Store, records: tuple[PlantRecord, ...], keep_days: float, seen: set[tuple[int, int]], *, is_unclear: bool
) -> Iterator[StoredTask]:
    """Frames of videos that were taken, and what killed runs left of some.

    A plant whose tasks run keeps those of its latest build, as every plant does.
    """
    captures: dict[str, dict[str, None]] = {}
    for record in records:
        captures.setdefault(record.frames or "", {})[record.capture] = None
    is_unclear |= any(record.frames is None for record in records)
    young_s = max(keep_days * _DAY_S, _BEGINNING_S)
    for name in _folders(store.folder / FRAMES):
        new = _NEW_FRAMES.fullmatch(name)
        if new is None and not KEY.fullmatch(name):
            continue
        folder = store.folder / FRAMES / name
        try:
            used_s = max(path.lstat().st_mtime for path in (folder, folder / FACTS) if path.exists())
        except (OSError, ValueError):  # it went meanwhile
            continue
        is_recent = time.time() - used_s < young_s
        state: State = "recent" if is_recent else "unclear" if is_unclear and new is None else "not needed"
        yield StoredTask(
            key=name if new is None else new[1],
            capture=", ".join(captures.get(name, ())),
            stage=FRAMES_STAGE if new is None else UNFINISHED,
            size_bytes=_size_bytes([folder], seen),
            last_used_s=used_s,
            state="needed" if name in captures else state,
            paths=(folder,),
        )


def _folders(folder: Path) -> list[str]:
    """Names of the folders in a folder, links left out; none where it is absent."""
    try:
        return sorted(entry.name for entry in os.scandir(folder) if entry.is_dir(follow_symlinks=False))
    except OSError:
        return []


def _needed(store: Store, record: PlantRecord, stamps: dict[str, Stamp]) -> set[str]:
    """The keys of the latest build but those of matching that only finished tasks, or other such ones, have read."""
    readers: dict[str, list[PlantTask]] = {}
    for task in record.tasks:
        for need in task.needs:
            readers.setdefault(need, []).append(task)
    needed: set[str] = set()
    for task in reversed(record.tasks):  # whoever reads a task comes after it
        if task.stage == MATCHING and readers.get(task.key):
            over = all(
                reader.key not in needed
                or (
                    reader.key in stamps
                    and not stamps[reader.key].poor  # which is tried again
                    and find_finished(store, reader.key, thorough=False) is not None
                )
                for reader in readers[task.key]
            )
            if over:
                continue
        needed.add(task.key)
    return needed


def _keys(store: Store, part: str, ends: str = "") -> Iterator[str]:
    """Of the entries of a part that are named by a key and are no links."""
    try:
        entries = sorted(os.scandir(store.folder / part), key=lambda entry: entry.name)
    except OSError:
        return
    for entry in entries:
        name = entry.name.removesuffix(ends) if entry.name.endswith(ends) else ""
        if KEY.fullmatch(name) and not entry.is_symlink() and entry.is_dir() != bool(ends):
            yield name


def _views_of(store: Store, stamp: Stamp, kept: set[str]) -> Iterator[Path]:
    """What a task has in views/, but files that are kept for others; nothing that leads out of there."""
    views = os.path.realpath(store.folder / "views")
    for file in stamp.files:
        path = store.folder / file.path
        parts = Path(file.path).parts
        inside = len(parts) > 2 and parts[0] == "views" and KEY.fullmatch(parts[1]) and ".." not in parts
        if inside and file.path not in kept and Path(os.path.realpath(path.parent)).is_relative_to(views):
            yield path


def _last_used_s(store: Store, key: str) -> float:
    """When it was made, or when a build last asked for it, by the time of its lock."""
    own = (store.stamp(key), store.lock(key), store.result(key), store.scratch(key), store.views(key))
    times = []
    for path in own:
        with suppress(OSError):  # absent, or gone meanwhile
            times.append(path.lstat().st_mtime)
    return max(times, default=0.0)


def _size_bytes(paths: Iterable[Path], seen: set[tuple[int, int]]) -> int:
    """On the disk; a file of several names once."""
    total = 0
    for path in paths:
        below = [path]
        if not path.is_symlink():
            # A worker may be renaming what is walked through, which os.walk does not mind.
            below += [Path(folder) / name for folder, names, files in os.walk(path) for name in (*names, *files)]
        for each in below:
            try:
                found = each.lstat()
            except OSError:
                continue
            if (found.st_dev, found.st_ino) not in seen and not each.is_dir():
                seen.add((found.st_dev, found.st_ino))
                total += found.st_size
    return total


def _remove(store: Store, stored: StoredTask) -> bool:
    """Its stamp first: from then on it is not done, whatever is left of it."""
    for path in stored.paths:
        try:
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink(missing_ok=True)
        except OSError as error:
            logger.warning("%s is not needed and could not be removed: %s", path, error.strerror)
            if path == store.stamp(stored.key):
                return False
    return True
