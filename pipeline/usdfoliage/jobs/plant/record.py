"""What a work folder remembers of each plant: the tasks of its latest build, and the results of earlier ones.

A plant is a capture and where its asset goes. Pruning keeps what the latest build of every plant needs.
"""

import json
import logging
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from usdfoliage.files.hashing import hash_bytes
from usdfoliage.files.json import read_json
from usdfoliage.files.reading import read_regular
from usdfoliage.jobs.plant.store import Store, hold_work_lock
from usdfoliage.jobs.plant.task_request import TaskRequest
from usdfoliage.jobs.plant.tasks import BuildPlan, Task
from usdfoliage.jobs.work.results import write_whole

logger = logging.getLogger(__name__)

KEY = re.compile(r"[0-9a-f]{32}")  # of a task or a plant; nothing else in the work folder is ever removed
_DAMAGE = (OSError, ValueError, KeyError, TypeError, AttributeError)
PRUNING = "prune"  # whoever prunes has that lock alone, whoever notes a build shares it


@dataclass(frozen=True, kw_only=True)
class PlantTask:
    """A task of the latest build."""

    key: str
    stage: str
    needs: tuple[str, ...]  # keys


@dataclass(frozen=True, kw_only=True)
class PlantRecord:
    """What is remembered of one plant."""

    key: str
    capture: str
    output: str
    tasks: tuple[PlantTask, ...]
    earlier: dict[str, str]  # stages by the keys of earlier builds' tasks, as far as there are results
    frames: str | None = ""  # folder of the frames of its video; "": it has none; None: nobody knows


def note_build(request: TaskRequest, plan: BuildPlan) -> None:
    """Remember that this is the latest build of the plant, and that its tasks are used now: the time of their locks.

    Raises:
        FoliageError: The work folder cannot be written.
    """
    store, key = request.store, plant_key(request)
    with hold_work_lock(store.plant_lock(PRUNING), shared=True):
        before = read_record(store, key)
        now = {task.key for task in plan.tasks.values()}
        earlier = dict(before.earlier) if before else {}
        earlier.update((task.key, task.stage) for task in (before.tasks if before else ()))
        record = {
            "capture": str(request.capture.resolve()),
            "output": str(request.output.resolve()),
            "tasks": [
                {"key": task.key, "stage": task.stage, "needs": [plan.tasks[need].key for need in task.needs]}
                for task in plan.tasks.values()
            ],
            "frames": plan.frames,
            "earlier": {old: stage for old, stage in sorted(earlier.items()) if _is_left(store, old, now)},
        }
        data = json.dumps(record, indent=1).encode()
        record_data = b""
        with suppress(OSError):  # there is none, or none that can be read
            record_data = read_regular(store.record(key))
        if record_data != data:
            write_whole(store.record(key), data)
        for task in plan.tasks.values():
            with suppress(OSError):  # most are not done yet
                os.utime(store.lock(task.key))


def note_task(request: TaskRequest, plan: BuildPlan, task: Task) -> None:
    """The same, unless the latest build has that task: of a farm, steps may run without the first one."""
    record = read_record(request.store, plant_key(request))
    if record is None or all(each.key != task.key for each in record.tasks):
        note_build(request, plan)


@contextmanager
def use_plant(request: TaskRequest) -> Iterator[None]:
    """Let nobody prune what the plant's builds have made; FoliageError where the work folder cannot be written."""
    with hold_work_lock(request.store.plant_lock(plant_key(request)), shared=True):
        yield


def read_records(store: Store) -> tuple[tuple[PlantRecord, ...], dict[str, str]]:
    """Of all plants, by where they are from; and by their keys, what is wrong with those that cannot be read."""
    names = sorted(path.stem for path in (store.folder / "builds").glob("*.json") if KEY.fullmatch(path.stem))
    records: list[PlantRecord] = []
    damaged: dict[str, str] = {}
    for name in names:
        try:
            records.append(_read_record(store, name))
        except FileNotFoundError:
            continue  # it went meanwhile
        except _DAMAGE as error:
            damaged[name] = str(error)
    return tuple(sorted(records, key=lambda record: (record.capture, record.output))), damaged


def read_record(store: Store, key: str) -> PlantRecord | None:
    """Of one plant; None where there is none, or it is damaged."""
    try:
        return _read_record(store, key)
    except FileNotFoundError:
        return None
    except _DAMAGE as error:
        logger.warning("%s is damaged (%s): it is written anew", store.record(key), error)
        return None


def plant_locks(store: Store) -> tuple[str, ...]:
    """The keys of all plants that have a lock, whether or not anybody holds it."""
    names = (path.stem for path in (store.folder / "builds").glob("*.lock"))
    return tuple(sorted(name for name in names if KEY.fullmatch(name)))


def _read_record(store: Store, key: str) -> PlantRecord:
    record = read_json(store.record(key))
    tasks = tuple(
        PlantTask(key=str(task["key"]), stage=str(task["stage"]), needs=tuple(map(str, task["needs"])))
        for task in record["tasks"]
    )
    earlier = {str(old): str(stage) for old, stage in record["earlier"].items()}
    frames = record.get("frames")  # of a record that was written before it was noted, nobody knows
    return PlantRecord(
        key=key,
        capture=str(record["capture"]),
        output=str(record["output"]),
        tasks=tasks,
        earlier=earlier,
        frames=None if frames is None else str(frames),
    )


def plant_key(request: TaskRequest) -> str:
    """The same for every version of the code: a build by a newer one is the latest of the same plant."""
    places = b"\n".join(os.fsencode(Path(path).resolve()) for path in (request.capture, request.output))
    return hash_bytes(places).hex()[:32]


def _is_left(store: Store, key: str, now: set[str]) -> bool:
    return key not in now and KEY.fullmatch(key) is not None and store.stamp(key).is_file()
