"""What a build would do, in lines, before anything runs."""

import os
from collections.abc import Mapping

from usdfoliage.asset.publish import plan_folder
from usdfoliage.jobs.plant.call import BuildRequest
from usdfoliage.jobs.plant.executor_choice import ExecutorChoice
from usdfoliage.jobs.plant.inputs import BuildInputs
from usdfoliage.jobs.plant.run import plan_plant
from usdfoliage.jobs.plant.stages.parts import remark_unknown_species
from usdfoliage.jobs.plant.store import Stamp
from usdfoliage.jobs.plant.tasks import BuildPlan, Task, find_wanted
from usdfoliage.remarks import RenderSetting, as_plan_setting, label_remarks

_COLUMNS = ("stage", "tasks", "done", "to do", "seconds")


def describe_plan(request: BuildRequest, where: ExecutorChoice, render: RenderSetting = as_plan_setting) -> str:
    """The tasks of one plant by stage, what of them is done already, and how long the rest may take.

    Args:
        request: The plant.
        where: Where its tasks would run.
        render: Writes a setting in a remark as the reader sets it.

    Raises:
        FoliageError: The input is unusable, or the output cannot be written.
    """
    would = plan_folder(
        request.output, f"{request.name}.usda", request.force, origin=request.origin, keep_old=request.keep_old
    )
    if request.only:
        would = f"nothing is put into {request.output}: it stops after {', '.join(request.only)}"
    inputs, plan = plan_plant(request, "files")
    wanted, finished = find_wanted(plan, request.store, thorough=False)
    lines = [
        *_describe_inputs(request, inputs),
        *label_remarks((*inputs.remarks, *remark_unknown_species(request.settings.plant.species)), render),
        *_table(plan, wanted, finished),
        f"estimate: {in_words(estimate_s(wanted, where))}, {where.describe()}",
        f"work folder: {request.work}",
        would,
    ]
    return "\n".join(lines)


def _describe_inputs(request: BuildRequest, inputs: BuildInputs) -> list[str]:
    if inputs.photo is not None:
        return [
            f"photo: {request.capture}",
            f"strokes: {inputs.strokes or 'proposed'}, trees {inputs.trees}",
        ]
    if not inputs.photographs:
        return [f"cloud: {request.capture}"]
    return [
        f"capture: {request.capture}, {len(inputs.photographs)} photographs",
        f"inputs: {len(inputs.files)} files, poses {'given' if inputs.has_cameras else 'to be estimated'}, depth "
        f"{'given' if inputs.has_depth else 'from the photographs'}",
    ]


def estimate_s(wanted: Mapping[str, Task], where: ExecutorChoice) -> float:
    """How long these tasks may take; one core does about half as much as the two that estimates are for."""
    total_s = sum(task.estimate_s for task in wanted.values())
    cores = max(os.cpu_count() or 1, 1)
    longest_s = max((task.estimate_s for task in wanted.values()), default=0.0)
    return max(total_s * 2 / cores if where.jobs == 1 else total_s * 2 / min(cores, where.jobs), longest_s)


def in_words(seconds: float) -> str:
    """A time in words, rounded."""
    if seconds < 90:
        return f"about {seconds:.0f} s"
    if seconds < 5400:
        return f"about {seconds / 60:.0f} min"
    return f"about {seconds / 3600:.1f} h"


def _needed(plan: BuildPlan) -> set[str]:
    """The names of the last tasks, and of all that they need."""
    needed: set[str] = set()
    ahead = list(plan.last)
    while ahead:
        name = ahead.pop()
        if name not in needed:
            needed.add(name)
            ahead.extend(plan.tasks[name].needs)
    return needed


def _table(plan: BuildPlan, wanted: Mapping[str, Task], finished: Mapping[str, Stamp]) -> list[str]:
    steps: dict[str, list[Task]] = {}
    asked = _needed(plan)
    for task in plan.tasks.values():
        if task.name not in asked:
            continue
        steps.setdefault(task.step, []).append(task)
    rows = [_COLUMNS]
    for step, tasks in steps.items():
        left = [task for task in tasks if task.name in wanted]
        # What only finished tasks need was not looked at, and is not done again.
        done = len(tasks) - len(left)
        rows.append((step, f"{len(tasks)}", f"{done}", f"{len(left)}", f"{sum(task.estimate_s for task in left):.0f}"))
    widths = [max(len(row[column]) for row in rows) for column in range(len(_COLUMNS))]
    return ["  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip() for row in rows]
