"""What became of a plant, and how its finished asset is put in its place."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from usdfoliage.asset.publish import publish_folder
from usdfoliage.errors import CaptureError, FoliageError
from usdfoliage.files.hashing import digest_file
from usdfoliage.files.json import read_json
from usdfoliage.jobs.plant.call import BuildRequest
from usdfoliage.jobs.plant.record import use_plant
from usdfoliage.jobs.plant.stages.report import FINISHED, VERDICT
from usdfoliage.jobs.plant.store import copy_tree, hold_work_lock, read_stamp
from usdfoliage.jobs.plant.tasks import REPORT, BuildPlan
from usdfoliage.jobs.report.table import Row
from usdfoliage.jobs.report.timings import TIMINGS, TaskTiming, Timings, write_timings
from usdfoliage.jobs.work.results import write_whole
from usdfoliage.remarks import Remark, Remedy, RenderSetting, explain_error, remark_from_json


@dataclass(frozen=True, kw_only=True)
class BuiltPlant:
    """What became of a plant."""

    request: BuildRequest
    error: str = ""  # why there is no asset
    remedy: Remedy = ()  # what to do about it
    is_fault: bool = False  # whether that is a fault of ours; then error is its traceback
    failed: str = ""  # the task that failed
    result: Path | None = None  # folder with the finished asset in the work folder
    asset: Path | None = None  # where it was put
    errors: int = 0  # that validation found
    tasks: int = 0
    cached: int = 0  # of them, that had been done before
    seconds: Mapping[str, float] | None = None  # by task that was run
    stages: Mapping[str, str] = field(default_factory=dict)  # by task, of those that were run at least
    wall_s: float = 0.0  # of the run
    remarks: tuple[Remark, ...] = ()  # of all stages, warnings first
    facts: tuple[Row, ...] = ()  # as the report has them
    height_m: float | None = None  # the same as numbers; None where there is no report
    leaves: int | None = None
    branches: int | None = None
    withheld: Mapping[str, object] | None = (
        None  # the asset against photographs that were withheld, as MeasuredAsset has it
    )

    def explain(self, render: RenderSetting) -> str:
        """Error and remedy as one sentence; render writes a setting as the reader sets it."""
        return explain_error(FoliageError(self.error, self.remedy), render)

    @property
    def verdict(self) -> str:
        """fault, failed, invalid or built."""
        if self.error:
            return "fault" if self.is_fault else "failed"
        return "invalid" if self.errors else "built"

    def seconds_by_stage(self) -> dict[str, float]:
        """Of the tasks that were run."""
        summed: dict[str, float] = {}
        for name, seconds in (self.seconds or {}).items():
            stage = self.stages[name]
            summed[stage] = summed.get(stage, 0.0) + seconds
        return summed


def finish_plant(made: BuiltPlant, plan: BuildPlan, executor: str) -> BuiltPlant:
    """Put the finished asset in its place, if validation lets it.

    Args:
        made: What was done.
        plan: Of the plant; its last result is there.
        executor: Where tasks ran, in words, for the times in the report.

    Raises:
        FoliageError: It cannot be written; what was there stays.
    """
    # Another run may wait to do a poor report again.
    with use_plant(made.request), hold_work_lock(made.request.store.lock(plan.tasks[REPORT].key), shared=True):
        if read_stamp(made.request.store, plan.tasks[REPORT].key) is None:
            raise FoliageError(
                f"the report in {made.request.work} vanished as soon as it was made", "run the same command again"
            )
        return _finish(made, plan, executor)


def _finish(made: BuiltPlant, plan: BuildPlan, executor: str) -> BuiltPlant:
    request = made.request
    result = request.store.result(plan.tasks[REPORT].key)
    verdict = json.loads((result / VERDICT).read_text(encoding="utf-8"))
    made = replace(
        made,
        result=result / FINISHED,
        errors=int(verdict["errors"]),
        remarks=tuple(remark_from_json(each) for each in verdict["remarks"]),
        facts=tuple(Row(**row) for row in verdict["facts"]),
        height_m=verdict["height_m"],
        leaves=verdict["leaves"],
        branches=verdict["branches"],
        withheld=verdict["withheld"],
    )
    if made.errors and not request.keep_invalid:
        return made
    key = plan.tasks[REPORT].key
    if not _is_in_place(request, key):
        with publish_folder(
            request.output, force=request.force, origin=request.origin, keep_old=request.keep_old
        ) as folder:
            copy_tree(result / FINISHED, folder)
            if not request.reproducible:
                write_timings(folder / "report", collect_timings(made, plan, executor))
        _note_place(request, key)
    return replace(made, asset=request.output / f"{request.name}.usda")


def _is_in_place(request: BuildRequest, key: str) -> bool:
    """Whether the output is, byte for byte, what an earlier run has put there of this very result."""
    try:
        record = read_json(request.store.published(request.output))
        as_asked = (f"report/{TIMINGS}" in record["files"]) != request.reproducible
        return bool(as_asked and record["key"] == key and record["files"] == _digests_of(request))
    except (OSError, ValueError, KeyError, TypeError, CaptureError):
        return False


def _note_place(request: BuildRequest, key: str) -> None:
    record = {"key": key, "files": _digests_of(request)}
    write_whole(request.store.published(request.output), json.dumps(record, indent=1, sort_keys=True).encode())


def _digests_of(request: BuildRequest) -> dict[str, str]:
    paths = sorted(path for path in request.output.rglob("*") if path.is_file())
    return {path.relative_to(request.output).as_posix(): digest_file(path) for path in paths}


def collect_timings(made: BuiltPlant, plan: BuildPlan, executor: str) -> Timings:
    """How long each task took; of those that an earlier run did, what it took then."""
    store, ran = made.request.store, made.seconds or {}
    tasks = []
    for name, task in plan.tasks.items():
        stamp = read_stamp(store, task.key)
        if stamp is not None:
            tasks.append(TaskTiming(stage=task.stage, name=name, seconds=stamp.seconds, cached=name not in ran))
    stages = []
    for stage in dict.fromkeys(timing.stage for timing in tasks):
        own = [timing for timing in tasks if timing.stage == stage]
        seconds = sum(timing.seconds for timing in own)
        stages.append(TaskTiming(stage=stage, seconds=seconds, cached=all(timing.cached for timing in own)))
    return Timings(executor=executor, seconds=made.wall_s, stages=stages, tasks=tasks)
