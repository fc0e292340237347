"""One step of what is made of tasks, as a farm runs it: what task and forest share."""

import argparse
import sys
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from usdfoliage.cli.options.openjd_lines import OpenjdLines

if TYPE_CHECKING:
    from usdfoliage.jobs.plant.executors import Done
    from usdfoliage.jobs.plant.steps import Chunk, Step
    from usdfoliage.jobs.plant.task_request import R
    from usdfoliage.progress import StepProgress

LIST, PLAN, PUBLISH = "list", "plan", "publish"


def report_step(options: argparse.Namespace, run_step: Callable[[OpenjdLines], int]) -> int:
    """Run a step, and report to the farm by the lines that it is given why it failed, if it does."""
    from usdfoliage.errors import FoliageError

    lines = OpenjdLines(enabled=options.openjd)
    try:
        return run_step(lines)
    except FoliageError as error:
        lines.fail(str(error))
        raise
    except KeyboardInterrupt:
        lines.fail("interrupted; the same command goes on from here")
        print("error: interrupted; the same command goes on from here", file=sys.stderr)
        return 130


def require_no_chunk(options: argparse.Namespace) -> None:
    """FoliageError where a chunk is asked of a step that has none."""
    from usdfoliage.errors import FoliageError

    if options.step in (LIST, PLAN, PUBLISH) and (options.chunk or options.chunks):
        raise FoliageError(f"{options.step} has no chunks", "leave --chunk and --chunks out")


def print_steps(steps: "Sequence[Step]", *, as_json: bool) -> None:
    """Steps in their order, with their chunks and what each needs."""
    from usdfoliage.cli.json_output import format_json

    if as_json:
        listed = [
            {"step": step.name, "chunks": step.chunks, "needs": step.needs, "estimate_s": round(step.estimate_s, 1)}
            for step in steps
        ]
        print(format_json({"steps": listed}))
        return
    rows = [("step", "chunks", "needs"), *((s.name, str(s.chunks), ", ".join(s.needs)) for s in steps)]
    wide = max(len(row[0]) for row in rows)
    for name, chunks, needs in rows:
        print(f"{name:<{wide}}  {chunks:>6}  {needs}".rstrip())


def run_chunks(
    chunks: "Sequence[Chunk[R]]",
    run_chunk: "Callable[[Chunk[R], StepProgress | None], Done]",
    lines: OpenjdLines,
    *,
    debug: bool,
) -> int:
    """Do chunks one after the other; returns the exit code.

    Raises:
        FoliageError: One cannot be done.
    """
    from usdfoliage.cli.plant_results import report_fault
    from usdfoliage.errors import FoliageError

    for number, chunk in enumerate(chunks):
        plant, name = chunk.order.request.name, chunk.order.name

        def show(step: str, share: float, number: int = number, plant: str = plant, name: str = name) -> None:
            lines.status(f"{plant}: {name}" if step == name else f"{plant}: {name}, {step}")
            if step == name:  # others follow each other, and each counts from 0
                lines.progress((number + share) / len(chunks))

        done = run_chunk(chunk, show)
        if done.error:
            raise FoliageError(done.error, done.remedy)
        if done.fault:
            lines.fail(f"internal fault in {name}")
            print(report_fault(done.fault, f"{name} of {plant}", debug=debug), file=sys.stderr)
            return 1
        idle = "is gone, and not needed: what is made of it is there" if done.spare else "was done before"
        print(f"{name}: {f'{done.seconds:.1f} s' if done.was_run else idle}", flush=True)
        lines.progress((number + 1) / len(chunks))
    return 0
