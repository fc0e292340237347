"""Run one step of a build, or some chunks of it, as a render farm does.

--step list prints the steps of a plant in their order. A step may run when the steps that it needs are done. The first
step, plan, reads the input; the last step, publish, writes the asset. Any farm that runs commands can run a build: as a
job of Open Job Description, which usdfoliage submit writes, or as one task for each command in Tractor, OpenCue or
Deadline. A step whose results exist does nothing, so a farm may repeat it at any time.

The exit code is 0 if the step is done. It is 2 if the input cannot be used, or if the results that the step needs do
not exist. It is 3 if validation finds errors in the asset that the step publish would write.
"""

import argparse
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from usdfoliage.cli.options.access import declare_build
from usdfoliage.cli.options.build import add_plan, add_publishing, add_work
from usdfoliage.cli.options.leaf_commands import add_output, add_threads
from usdfoliage.files.write_gate import Access

if TYPE_CHECKING:
    from usdfoliage.cli.openjd_lines import OpenjdLines
    from usdfoliage.jobs.plant.call import BuildRequest

LIST, PLAN, PUBLISH = "list", "plan", "publish"


def read_chunk(text: str) -> tuple[range, int]:
    """The chunk of K/N."""
    found = re.fullmatch(r"(\d+)/(\d+)", text)
    if not found or not 1 <= int(found[1]) <= int(found[2]):
        raise argparse.ArgumentTypeError(f"{text!r} is not K/N, a chunk and how many there are, as in 3/10")
    return range(int(found[1]), int(found[1]) + 1), int(found[2])


def read_chunks(text: str) -> range:
    """The chunks of A-B, or A."""
    found = re.fullmatch(r"(\d+)(?:-(\d+))?", text)
    first, last = (int(found[1]), int(found[2] or found[1])) if found else (0, 0)
    if not 1 <= first <= last:
        raise argparse.ArgumentTypeError(f"{text!r} is not A-B, the first and the last chunk from 1, as in 3-5")
    return range(first, last + 1)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    files = parser.add_argument_group("input and output")
    files.add_argument(
        "capture",
        metavar="CAPTURE",
        type=Path,
        help="The input is a folder of photographs, a capture, or a point cloud.",
    )
    add_output(files, "ASSET")
    add_work(files)
    add_plan(parser.add_argument_group("settings of the plant"))
    step = parser.add_argument_group("this step")
    step.add_argument(
        "--step",
        required=True,
        metavar="STEP",
        help="This step runs. The step list prints all steps with their numbers of chunks.",
    )
    which = step.add_mutually_exclusive_group()
    which.add_argument(
        "--chunk",
        type=read_chunk,
        metavar="K/N",
        help="Only chunk K of N runs, as in 3/10. The default is all chunks.",
    )
    which.add_argument(
        "--chunks",
        type=read_chunks,
        metavar="A-B",
        help="Only the chunks from A to B run, counted from 1, as in 3-5. The default is all chunks.",
    )
    add_threads(step, 0)
    add_publishing(step)
    output = parser.add_argument_group("printed output")
    output.add_argument("--json", action="store_true", help="Print the list of steps as JSON.")
    output.add_argument(
        "--openjd", action="store_true", help="Print progress and errors as lines of Open Job Description."
    )


def declare(options: argparse.Namespace) -> Access:
    return declare_build(options)


def run(options: argparse.Namespace) -> int:
    from usdfoliage.cli.interrupts import handle_interrupts
    from usdfoliage.cli.openjd_lines import OpenjdLines
    from usdfoliage.errors import FoliageError

    lines = OpenjdLines(enabled=options.openjd)
    try:
        if options.threads < 0:
            raise FoliageError(f"--threads must be 0 or more, not {options.threads}")
        from usdfoliage.cli.options.build import read_request
        from usdfoliage.jobs.plant import farm_steps  # noqa: F401  # all that is heavy, before interrupts are handled

        request = read_request(options, options.capture, options.output, options.name)
        handle_interrupts()
        if options.step in (LIST, PLAN, PUBLISH):
            if options.chunk or options.chunks:
                raise FoliageError(f"{options.step} has no chunks", "leave --chunk and --chunks out")
            return _publish(request, options, lines) if options.step == PUBLISH else _plan(request, options, lines)
        return _run_chunks(request, options, lines)
    except FoliageError as error:
        lines.fail(str(error))
        raise
    except KeyboardInterrupt:
        lines.fail("interrupted; the same command goes on from here")
        print("error: interrupted; the same command goes on from here", file=sys.stderr)
        return 130


def _plan(request: "BuildRequest", options: argparse.Namespace, lines: "OpenjdLines") -> int:
    from usdfoliage.cli.json_output import format_json
    from usdfoliage.jobs.plant.farm_steps import list_steps, plan_step
    from usdfoliage.jobs.plant.run import plan_plant

    if options.step == LIST:
        steps = list_steps(plan_plant(request, "names")[1])
    else:
        lines.begin(f"{request.name}: reading the input")
        steps = plan_step(request)
    if options.json:
        listed = [
            {"step": step.name, "chunks": step.chunks, "needs": step.needs, "estimate_s": round(step.estimate_s, 1)}
            for step in steps
        ]
        print(format_json({"steps": listed}))
    else:
        rows = [("step", "chunks", "needs"), *((s.name, str(s.chunks), ", ".join(s.needs)) for s in steps)]
        wide = max(len(row[0]) for row in rows)
        for name, chunks, needs in rows:
            print(f"{name:<{wide}}  {chunks:>6}  {needs}".rstrip())
    if options.step == PLAN:
        lines.progress(1.0)
    return 0


def _run_chunks(request: "BuildRequest", options: argparse.Namespace, lines: "OpenjdLines") -> int:
    from usdfoliage.cli.plant_results import report_fault
    from usdfoliage.errors import FoliageError
    from usdfoliage.jobs.plant.farm_steps import find_chunks, run_chunk

    asked, of = options.chunk or (options.chunks, None)
    lines.begin(f"{request.name}: {options.step}")
    chunks = find_chunks(request, options.step, asked, of, options.threads)
    for number, chunk in enumerate(chunks):
        name = chunk.order.name

        def show(step: str, share: float, number: int = number, name: str = name) -> None:
            lines.status(f"{request.name}: {name}" if step == name else f"{request.name}: {name}, {step}")
            if step == name:  # others follow each other, and each counts from 0
                lines.progress((number + share) / len(chunks))

        done = run_chunk(chunk, show)
        if done.error:
            raise FoliageError(done.error, done.remedy)
        if done.fault:
            lines.fail(f"internal fault in {name}")
            print(report_fault(done.fault, f"{name} of {request.name}", debug=options.debug), file=sys.stderr)
            return 1
        idle = "is gone, and not needed: what is made of it is there" if done.spare else "was done before"
        print(f"{name}: {f'{done.seconds:.1f} s' if done.was_run else idle}", flush=True)
        lines.progress((number + 1) / len(chunks))
    return 0


def _publish(request: "BuildRequest", options: argparse.Namespace, lines: "OpenjdLines") -> int:
    from usdfoliage.cli.plant_results import EXIT_CODES, print_plant
    from usdfoliage.jobs.plant.farm_steps import publish_step

    lines.begin(f"{request.name}: publishing")
    made = publish_step(request)
    print_plant(made, "task", debug=options.debug)
    if made.errors:
        lines.fail(f"validation finds {made.errors} errors; see {made.result}/report/index.html")
    lines.progress(1.0)
    return EXIT_CODES[made.verdict]
