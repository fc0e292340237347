"""A build as a job of Open Job Description, which render farms run: each step of it a command on any machine.

Source:
    Open Job Description, Template Schemas, revision 2023-09, with the extension TASK_CHUNKING; AWS Deadline Cloud
    developer guide, Job bundles.
"""

import json
from pathlib import Path

import yaml

from usdfoliage.errors import AssetError
from usdfoliage.files.atomic import write_whole_files
from usdfoliage.jobs.plant.farm_job import FarmJob, JobParameter
from usdfoliage.jobs.plant.steps import PUBLISH, Step
from usdfoliage.jobs.plant.tasks import (
    BRANCHES,
    CLOUD,
    COMPARISONS,
    CROWN,
    DEPTH,
    ISOLATION,
    LEAVES,
    MATCHING,
    PART_ASSET,
    POSES,
    SKETCH,
    TURNTABLE,
    VARIANTS,
    WITHHELD,
)
from usdfoliage.remarks import Argument

_HEAVY = (
    POSES,
    MATCHING,
    DEPTH,
    CLOUD,
    ISOLATION,
    BRANCHES,
    LEAVES,
    CROWN,
    PART_ASSET,
    SKETCH,
    WITHHELD,
    TURNTABLE,
    COMPARISONS,
    VARIANTS,
)
_JSON = ".json"
_MIN_MEMORY_MIB = 2048
_FORCE = Argument(name="force")
_SHORTEST_TIMEOUT_S = 3600
_LATE = 30  # times its estimate: then a task hangs
_NOTIFY_S = 30  # after which one that is cancelled is killed; what it had done is not lost then either


def make_template(job: FarmJob) -> dict[str, object]:
    """The job template; it names no file and no folder of this machine.

    Paths are parameters, and reach the command as arguments of their own: no shell reads them.
    """
    parameters = [
        _define(each)
        for each in (
            *job.parameters,
            JobParameter(
                name="Executable", kind="STRING", value=job.executable, description="usdfoliage on the workers"
            ),
        )
    ]
    template: dict[str, object] = {"specificationVersion": "jobtemplate-2023-09"}
    if job.is_chunked and any(step.chunks > 1 for step in job.steps):
        template["extensions"] = ["TASK_CHUNKING"]
    return {
        **template,
        "name": f"usdfoliage {job.name}",
        "description": (
            f"The asset of a {job.what}. All machines must see the same work folder, or get it with the job."
        ),
        "parameterDefinitions": parameters,
        "steps": [_define_step(job, step) for step in job.steps],
    }


def values_file(template: Path) -> Path:
    """The file beside a template that has the values of its parameters."""
    return template.with_name(f"{template.stem}.parameters{_JSON if template.suffix.lower() == _JSON else '.yaml'}")


def write_job(job: FarmJob, *, template: Path | None = None, bundle: Path | None = None, force: bool = False) -> None:
    """Write a job as a template, as a bundle, or as both: all of their files appear, or none.

    Args:
        job: The content.
        template: The job template, JSON by that suffix, else YAML; beside it go the values of its parameters, to
            values_file(template).
        bundle: The folder of a job bundle as AWS Deadline Cloud takes it.
        force: Replace a file that is no job's, and write into a folder that holds something else.

    Raises:
        AssetError: A file is no template, or the folder holds something else.
        WriteError: A file cannot be written; what was there is unchanged.
    """
    files = []
    if template is not None:
        _spare(template, force)
        encode = _as_json if template.suffix.lower() == _JSON else _as_yaml
        files += [(values_file(template), encode(parameter_values(job))), (template, encode(make_template(job)))]
    if bundle is not None:
        _spare_folder(bundle, force)
        files += _bundle_files(bundle, job)
    write_whole_files(files)


def _bundle_files(folder: Path, job: FarmJob) -> list[tuple[Path, bytes]]:
    """The template last, without which there is no bundle."""
    values = [{"name": name, "value": value} for name, value in parameter_values(job).items()]
    # Deadline finds the files of PATH parameters itself.
    references = {"inputs": {"filenames": [], "directories": []}, "outputs": {"directories": []}, "referencedPaths": []}
    return [
        (folder / "parameter_values.yaml", _as_yaml({"parameterValues": values})),
        (folder / "asset_references.yaml", _as_yaml({"assetReferences": references})),
        (folder / "template.yaml", _as_yaml(make_template(job))),
    ]


def _spare_folder(folder: Path, force: bool) -> None:
    """AssetError for a folder that holds something else than a bundle."""
    if folder.is_dir() and any(folder.iterdir()) and not (folder / "template.yaml").is_file() and not force:
        raise AssetError(f"{folder} holds something else than a bundle", ("name another folder, or give ", _FORCE))
    _spare(folder / "template.yaml", force)


def _spare(path: Path, force: bool) -> None:
    """AssetError for a file that is there and no template."""
    if force or not path.exists():
        return
    try:
        is_template = path.is_file() and "specificationVersion" in path.read_text(encoding="utf-8")
    except (OSError, ValueError):
        is_template = False
    if not is_template:
        raise AssetError(
            f"{path} is there and no job template", ("name another file, or give ", _FORCE, " to replace it")
        )


def parameter_values(job: FarmJob) -> dict[str, str | int | float]:
    """Of the parameters that are known."""
    return {each.name: each.value for each in job.parameters if each.value is not None}


def _define(parameter: JobParameter) -> dict[str, object]:
    defined: dict[str, object] = {"name": parameter.name, "type": parameter.kind, "description": parameter.description}
    if parameter.kind == "PATH":
        # A default would have to lie below the template's own folder.
        control = "CHOOSE_INPUT_FILE" if parameter.is_file else "CHOOSE_DIRECTORY"
        return {
            **defined,
            "objectType": "FILE" if parameter.is_file else "DIRECTORY",
            "dataFlow": parameter.flow,
            "userInterface": {"control": control, "label": parameter.name},
        }
    return {**defined, "default": parameter.value} if parameter.value is not None else defined


def _define_step(job: FarmJob, step: Step) -> dict[str, object]:
    arguments = [job.command]
    for each in job.parameters:
        arguments += [each.option] if each.option else []
        arguments.append(f"{{{{Param.{each.name}}}}}")
    arguments += [*job.switches, "--step", step.name, "--openjd"]
    space: dict[str, object] = {}
    if step.chunks > 1:
        arguments += ["--chunks", "{{Task.Param.Chunk}}"]
        chunk: dict[str, object] = {"name": "Chunk", "type": "INT", "range": f"1-{step.chunks}"}
        if job.is_chunked:
            chunk["type"] = "CHUNK[INT]"
            chunk["chunks"] = {"defaultTaskCount": 1, "targetRuntimeSeconds": 600, "rangeConstraint": "CONTIGUOUS"}
        space = {"parameterSpace": {"taskParameterDefinitions": [chunk]}}
    if step.name == PUBLISH:
        arguments += job.flags
    is_heavy = step.stage in (*_HEAVY, *job.heavy)
    action = {
        "command": "{{Param.Executable}}",
        "args": arguments,
        "timeout": max(_SHORTEST_TIMEOUT_S, round(_LATE * step.estimate_s * step.chunks)),
        "cancelation": {"mode": "NOTIFY_THEN_TERMINATE", "notifyPeriodInSeconds": _NOTIFY_S},
    }
    return {
        "name": step.name,
        **({"dependencies": [{"dependsOn": need} for need in step.needs]} if step.needs else {}),
        **space,
        "hostRequirements": {
            "amounts": [
                {"name": "amount.worker.vcpu", "min": job.cores if is_heavy else 1},
                {"name": "amount.worker.memory", "min": job.memory_mib if is_heavy else _MIN_MEMORY_MIB},
            ],
            "attributes": [{"name": "attr.worker.os.family", "anyOf": ["linux", "macos"]}],
        },
        "script": {"actions": {"onRun": action}},
    }


def _as_json(value: object) -> bytes:
    return (json.dumps(value, indent=2, ensure_ascii=False) + "\n").encode()


def _as_yaml(value: object) -> bytes:
    return yaml.safe_dump(value, sort_keys=False, allow_unicode=True, width=120, encoding="utf-8")
