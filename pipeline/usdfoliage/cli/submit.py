"""Write a build as a job for a render farm: a template of Open Job Description, or a bundle for AWS Deadline Cloud.

Nothing is sent. The job runs `usdfoliage task` for every step; run it here with `openjd run JOB.yaml -p
file://JOB.parameters.yaml`, or send a bundle with `deadline bundle submit FOLDER`. Other farms take the steps of
`usdfoliage task --step list --json`. The work folder must be one that all machines see.
"""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from usdfoliage.cli.options.build import add_plan, add_publishing

if TYPE_CHECKING:
    from usdfoliage.jobs.plant.openjd_template import JobParameter


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("capture", metavar="CAPTURE", type=Path, help="photographs, a capture, or a cloud")
    parser.add_argument(
        "-o", "--output", metavar="ASSET", type=Path, help="the asset's folder (asked for on submitting)"
    )
    parser.add_argument("--name", help="name of the asset (ASSET's basename, else CAPTURE's)")
    parser.add_argument("--template", metavar="JOB.yaml", type=Path, help="the template; values go beside it")
    parser.add_argument("--bundle", metavar="FOLDER", type=Path, help="a job bundle")
    parser.add_argument("--executable", default="usdfoliage", help="usdfoliage on the workers (%(default)s)")
    parser.add_argument("--cores", type=int, default=4, help="that a machine for heavy steps must have (%(default)s)")
    parser.add_argument("--memory-mib", type=int, default=8192, help="likewise (%(default)s)")
    parser.add_argument("--threads", type=int, default=0, metavar="N", help="of each task (all cores)")
    parser.add_argument(
        "--no-chunking", action="store_true", help="for farms without the extension TASK_CHUNKING: one chunk a task"
    )
    add_plan(parser)
    add_publishing(parser)


def run(options: argparse.Namespace) -> int:
    from usdfoliage.cli.options.build import read_request
    from usdfoliage.errors import FoliageError
    from usdfoliage.jobs.plant.farm_steps import list_steps
    from usdfoliage.jobs.plant.openjd_template import FarmJob, write_bundle, write_template
    from usdfoliage.jobs.plant.run import plan_plant

    if options.template is None and options.bundle is None:
        raise FoliageError("name where the job goes: --template JOB.yaml, --bundle FOLDER, or both")
    if options.threads < 0:
        raise FoliageError(f"--threads must be 0 or more, not {options.threads}")
    output = options.output or Path(options.capture.absolute().stem)
    request = read_request(options, options.capture, output, options.name)
    steps = list_steps(plan_plant(request, "names")[1])
    try:
        job = FarmJob(
            name=request.name,
            steps=steps,
            parameters=_parameters(options, request.name, request.work),
            flags=[flag for flag in ("--keep-invalid", "--force") if getattr(options, flag[2:].replace("-", "_"))],
            executable=options.executable,
            cores=options.cores,
            memory_mib=options.memory_mib,
            is_chunked=not options.no_chunking,
        )
    except ValueError as error:
        raise FoliageError(f"--{error}") from error
    if options.template is not None:
        values = write_template(options.template, job, force=options.force)
        print(f"template: {options.template}\nparameters: {values}")
    if options.bundle is not None:
        write_bundle(options.bundle, job, force=options.force)
        print(f"bundle: {options.bundle}")
    tasks = sum(step.chunks for step in steps)
    seconds = sum(step.estimate_s * step.chunks for step in steps)
    print(f"steps: {len(steps)}, with {tasks} tasks, about {seconds:.0f} s of work on two cores")
    return 0


def _parameters(options: argparse.Namespace, name: str, work: Path) -> "list[JobParameter]":
    from usdfoliage.jobs.plant.openjd_template import JobParameter

    capture, is_cloud = options.capture.absolute(), options.capture.is_file()
    known_work = options.output is not None or options.work is not None
    parameters = [
        JobParameter(
            name="CaptureFile" if is_cloud else "CaptureDir",
            kind="PATH",
            value=str(capture),
            description="the point cloud" if is_cloud else "photographs, or a capture; those that the job was made for",
            is_file=is_cloud,
            flow="IN",
        ),
        JobParameter(
            name="AssetDir",
            kind="PATH",
            value=None if options.output is None else str(options.output.absolute()),
            description="where the asset is put",
            option="-o",
            flow="OUT",
        ),
        JobParameter(
            name="WorkDir",
            kind="PATH",
            value=str(work) if known_work else None,
            description="where results of tasks are kept; all workers must see it",
            option="--work",
            flow="INOUT",
        ),
        JobParameter(name="Name", kind="STRING", value=name, description="of the asset", option="--name"),
        JobParameter(
            name="Threads",
            kind="INT",
            value=options.threads,
            description="of each task; 0: all cores",
            option="--threads",
        ),
    ]
    for field, kind, option, what in (
        ("plan", "PATH", "--plan", "settings of every stage, TOML"),
        ("profile", "PATH", "--profile", "the studio's rules for validation, TOML"),
        ("species", "STRING", "--species", "written into the asset"),
        ("seed", "INT", "--seed", "of every random choice"),
    ):
        given = getattr(options, field)
        if given is not None:
            is_file = kind == "PATH"
            parameters.append(
                JobParameter(
                    name=field.title(),
                    kind=kind,
                    value=str(given.absolute()) if is_file else given,
                    description=what,
                    option=option,
                    is_file=is_file,
                    flow="IN" if is_file else "",
                )
            )
    return parameters
