"""Write a build as a job for a render farm.

The job is a template of Open Job Description, or a bundle for AWS Deadline Cloud. It runs usdfoliage task for every
step. Nothing is sent. Run a template on this machine, or send a bundle:

    openjd run JOB.yaml -p file://JOB.parameters.yaml
    deadline bundle submit FOLDER

For other farms, usdfoliage task --step list --json prints the steps. All machines must see the work folder.
usdfoliage forest writes the job of a forest itself, with the same options.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from usdfoliage.cli.options.access import given
from usdfoliage.cli.options.build import add_job, add_machines, add_plan, add_publishing, add_work
from usdfoliage.cli.options.leaf_commands import add_threads
from usdfoliage.files.write_gate import Access

if TYPE_CHECKING:
    from usdfoliage.jobs.plant.farm_job import JobParameter
    from usdfoliage.jobs.plant.steps import Step

FLAGS = ("--keep-invalid", "--reproducible", "--force", "--keep-old")  # of the last step


def add_arguments(parser: argparse.ArgumentParser) -> None:
    files = parser.add_argument_group("input and output")
    files.add_argument(
        "capture",
        metavar="CAPTURE",
        type=Path,
        help="The input is a folder of photographs, a capture, a point cloud, or one photograph of a tree.",
    )
    files.add_argument(
        "-o",
        "--output",
        metavar="ASSET",
        type=Path,
        help="The asset is written to this folder. Without this option the job asks for it.",
    )
    files.add_argument(
        "--name", help="The asset has this name. The default is the name of the folder ASSET, or else of CAPTURE."
    )
    add_job(files)
    add_work(files)
    add_plan(parser.add_argument_group("settings of the plant"))
    farm = parser.add_argument_group("machines of the farm")
    add_machines(farm)
    add_threads(farm, 0)
    add_publishing(parser.add_argument_group("the last step"))


def declare(options: argparse.Namespace) -> Access:
    return declare_job(options, given(options.capture, options.plan, options.profile))


def run(options: argparse.Namespace) -> int:
    from usdfoliage.cli.options.build import given_flags, read_request
    from usdfoliage.errors import FoliageError
    from usdfoliage.jobs.plant.farm_steps import find_steps

    if options.template is None and options.bundle is None:
        raise FoliageError("name where the job goes: --template JOB.yaml, --bundle FOLDER, or both")
    if options.threads < 0:
        raise FoliageError(f"--threads must be 0 or more, not {options.threads}")
    output = options.output or Path(options.capture.absolute().stem)
    request = read_request(options, options.capture, output, options.name)
    write_farm_job(
        options,
        name=request.name,
        steps=find_steps(request),
        parameters=_parameters(options, request.name, request.work),
        flags=given_flags(options, FLAGS),
    )
    return 0


def declare_job(options: argparse.Namespace, reads: tuple[Path, ...]) -> Access:
    """What is read and written where a job is made."""
    from usdfoliage.asset.access import refuse_in_asset
    from usdfoliage.jobs.plant.openjd_template import values_file

    outputs = [] if options.template is None else [options.template, values_file(options.template)]
    for output in outputs:
        refuse_in_asset(output)
    return Access(reads=reads, replaces=tuple(outputs), fills=given(options.bundle))


def write_farm_job(
    options: argparse.Namespace,
    *,
    name: str,
    steps: "Sequence[Step]",
    parameters: "Sequence[JobParameter]",
    flags: Sequence[str],
    switches: Sequence[str] = (),
    what: str = "plant",
    command: str = "task",
    heavy: Sequence[str] = (),
) -> None:
    """Write a job where the options of add_job have it, for the machines of add_machines, and print where it is.

    Args:
        options: Of the command line.
        name: As FarmJob has it, and so are the others.
        steps: Likewise.
        parameters: Likewise.
        flags: Likewise.
        switches: Likewise.
        what: Likewise.
        command: Likewise.
        heavy: Likewise.

    Raises:
        FoliageError: An option cannot be, or a file cannot be written.
    """
    from usdfoliage.errors import FoliageError
    from usdfoliage.jobs.plant.farm_job import FarmJob
    from usdfoliage.jobs.plant.openjd_template import values_file, write_job

    try:
        job = FarmJob(
            name=name,
            steps=steps,
            parameters=parameters,
            flags=flags,
            switches=switches,
            what=what,
            command=command,
            heavy=heavy,
            executable=options.executable,
            cores=options.cores,
            memory_mib=options.memory_mib,
            is_chunked=not options.no_chunking,
        )
    except ValueError as error:
        raise FoliageError(f"--{error}") from error
    write_job(job, template=options.template, bundle=options.bundle, force=options.force)
    if options.template is not None:
        print(f"template: {options.template}\nparameters: {values_file(options.template)}")
    if options.bundle is not None:
        print(f"bundle: {options.bundle}")
    tasks = sum(step.chunks for step in job.steps)
    seconds = sum(step.estimate_s * step.chunks for step in job.steps)
    print(f"steps: {len(job.steps)}, with {tasks} tasks, about {seconds:.0f} s of work on two cores")


def _parameters(options: argparse.Namespace, name: str, work: Path) -> "list[JobParameter]":
    from usdfoliage.capture.folder.listing import is_picture
    from usdfoliage.jobs.plant.farm_job import JobParameter

    capture, is_file = options.capture.absolute(), options.capture.is_file()
    of_file = "the photograph of a tree; its strokes lie beside it" if is_picture(capture.name) else "the point cloud"
    known_work = options.output is not None or options.work is not None
    parameters = [
        JobParameter(
            name="CaptureFile" if is_file else "CaptureDir",
            kind="PATH",
            value=str(capture),
            description=of_file if is_file else "photographs, or a capture; those that the job was made for",
            is_file=is_file,
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
        ("hold_back", "INT", "--hold-back", "of every so many photographs one measures the asset"),
        ("sway", "INT", "--sway", "frames of a loop in which the branches sway"),
        ("growth", "INT", "--growth", "frames in which the plant grows"),
        ("seed", "INT", "--seed", "of every random choice"),
    ):
        given = getattr(options, field)
        if given is not None:
            is_file = kind == "PATH"
            parameters.append(
                JobParameter(
                    name=field.title().replace("_", ""),
                    kind=kind,
                    value=str(given.absolute()) if is_file else given,
                    description=what,
                    option=option,
                    is_file=is_file,
                    flow="IN" if is_file else "",
                )
            )
    return parameters
