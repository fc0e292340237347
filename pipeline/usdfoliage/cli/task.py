"""Run one step of a build, or some chunks of it, as a render farm does.

--step list prints the steps of a plant in their order. A step may run when the steps that it needs are done. The first
step, plan, reads the input; the last step, publish, writes the asset. Any farm that runs commands can run a build: as a
job of Open Job Description, which usdfoliage submit writes, or as one task for each command in Tractor, OpenCue or
Deadline. A step whose results exist does nothing, so a farm may repeat it at any time.

The exit code is 0 if the step is done. It is 2 if the input cannot be used, or if the results that the step needs do
not exist. It is 3 if validation finds errors in the asset that the step publish would write.
"""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from usdfoliage.cli.options.access import declare_build
from usdfoliage.cli.options.build import add_openjd, add_plan, add_publishing, add_step, add_work
from usdfoliage.cli.options.leaf_commands import add_output, add_threads
from usdfoliage.cli.options.steps import LIST, PLAN, PUBLISH, print_steps, report_step, require_no_chunk, run_chunks
from usdfoliage.files.write_gate import Access

if TYPE_CHECKING:
    from usdfoliage.cli.options.openjd_lines import OpenjdLines
    from usdfoliage.jobs.plant.call import BuildRequest


def add_arguments(parser: argparse.ArgumentParser) -> None:
    files = parser.add_argument_group("input and output")
    files.add_argument(
        "capture",
        metavar="CAPTURE",
        type=Path,
        help="The input is a folder of photographs, a capture, a point cloud, or one photograph of a tree.",
    )
    add_output(files, "ASSET")
    add_work(files)
    add_plan(parser.add_argument_group("settings of the plant"))
    step = parser.add_argument_group("this step")
    add_step(step, required=True)
    add_threads(step, 0)
    add_publishing(step)
    output = parser.add_argument_group("printed output")
    output.add_argument("--json", action="store_true", help="Print the list of steps as JSON.")
    add_openjd(output)


def declare(options: argparse.Namespace) -> Access:
    return declare_build(options)


def run(options: argparse.Namespace) -> int:
    from usdfoliage.errors import FoliageError

    def run_step(lines: "OpenjdLines") -> int:
        if options.threads < 0:
            raise FoliageError(f"--threads must be 0 or more, not {options.threads}")
        from usdfoliage.cli.interrupts import handle_interrupts
        from usdfoliage.cli.options.build import read_request
        from usdfoliage.jobs.plant import farm_steps  # all that is heavy, before interrupts are handled

        request = read_request(options, options.capture, options.output, options.name)
        handle_interrupts()
        require_no_chunk(options)
        if options.step == PUBLISH:
            return _publish(request, options, lines)
        if options.step in (LIST, PLAN):
            return _plan(request, options, lines)
        asked, of = options.chunk or (options.chunks, None)
        lines.begin(f"{request.name}: {options.step}")
        chunks = farm_steps.find_chunks(request, options.step, asked, of, options.threads)
        return run_chunks(chunks, farm_steps.run_chunk, lines, debug=options.debug)

    return report_step(options, run_step)


def _plan(request: "BuildRequest", options: argparse.Namespace, lines: "OpenjdLines") -> int:
    from usdfoliage.jobs.plant.farm_steps import find_steps, plan_step

    if options.step == LIST:
        print_steps(find_steps(request), as_json=options.json)
        return 0
    lines.begin(f"{request.name}: reading the input")
    print_steps(plan_step(request), as_json=options.json)
    lines.progress(1.0)
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
