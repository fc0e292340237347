"""A whole plant from a capture."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from usdfoliage.asset.plant import asset_name
from usdfoliage.asset.validation.studio_profile import read_profile
from usdfoliage.capture.folder.listing import parts_of_input
from usdfoliage.errors import FoliageError
from usdfoliage.files.write_gate import Access, check_access
from usdfoliage.jobs.plant.call import BuildRequest
from usdfoliage.jobs.plant.executor_choice import ExecutorChoice
from usdfoliage.jobs.plant.run import build_plants
from usdfoliage.jobs.plant.settings import BuildSettings, with_seed
from usdfoliage.jobs.plant.work_folder import find_work_folder
from usdfoliage.jobs.work.settings_file import read_settings_file
from usdfoliage.progress import StepProgress
from usdfoliage.remarks import Remark


@dataclass(frozen=True, kw_only=True)
class BuildResult:
    """What became of a build.

    Attributes:
        asset: The interface layer in its place. None where validation found errors and keep_invalid was not set, or
            where the build stopped before the end (`only`).
        report: The HTML page of the asset. None where there is no report yet.
        result: The folder in the work folder that holds what was made last.
        remarks: What the user should know, warnings first.
        errors: How many errors validation found.
        measures: Figures of the plant, by name, as the report shows them.
        tasks: How many tasks the plant takes.
        cached: How many of them an earlier run had done.
        seconds: How long each task of this run took, by its name.
    """

    asset: Path | None
    report: Path | None
    result: Path | None
    remarks: tuple[Remark, ...] = ()
    errors: int = 0
    measures: Mapping[str, str] = field(default_factory=dict)
    tasks: int = 0
    cached: int = 0
    seconds: Mapping[str, float] = field(default_factory=dict)


def build(
    capture: str | Path,
    output: str | Path,
    *,
    settings: BuildSettings = BuildSettings(),
    name: str | None = None,
    work: str | Path | None = None,
    only: Sequence[str] = (),
    profile: str | Path | None = None,
    jobs: int = 1,
    threads: int = 0,
    scheduler: str = "",
    keep_invalid: bool = False,
    reproducible: bool = False,
    force: bool = False,
    keep_old: bool = False,
    progress: StepProgress | None = None,
) -> BuildResult:
    """Build one plant from a capture, as the command `usdfoliage build` does. A second run does only what is missing.

    Args:
        capture: A folder of photographs, a video, a capture folder, or a point cloud.
        output: The asset's folder. What was there stays until the new asset is whole.
        settings: The settings of every stage. The seed counts for all of them.
        name: The name of the root prim; by default that of the folder, made an identifier.
        work: Where results of tasks are kept; by default the folder that the environment variable USDFOLIAGE_WORK
            names, else `.usdfoliage` beside the asset.
        only: Stages after which to stop; the whole plant without.
        profile: The studio's rules for validation, a TOML file; those shipped with usdfoliage without.
        jobs: How many processes of this machine work at once; 1 is this process. A program that asks for more must be a
            file that starts its work under `if __name__ == "__main__":`, since the processes import it.
        threads: Threads of each task; 0 shares the cores. The result does not depend on it.
        scheduler: The address of a Dask scheduler, such as `tcp://farm:8786`, whose workers do the tasks instead.
        keep_invalid: Put an asset in its place though validation finds errors in it.
        reproducible: Leave out how long the run took, `report/timings.js`: then equal runs give the same bytes.
        force: Replace an asset of another name or origin too, or one whose record is lost. Files that are not the
            asset's always stay.
        keep_old: Keep the asset that is replaced, in a folder beside the new one that the log names.
        progress: Called with what runs and the share of all work that is done, 0 to 1.

    Raises:
        FoliageError: The capture or the profile cannot be used, a stage failed, or the output cannot be written or
            would replace the input.
        ValueError: A number is out of its range.
        RuntimeError: A fault of usdfoliage; the text is the traceback of the task.
    """
    if profile is not None:
        read_profile(Path(profile))  # what is wrong with it is found now, not when all else is done
    folder = Path(output).absolute()
    request = BuildRequest(
        capture=Path(capture).absolute(),
        output=folder,
        name=asset_name(name or folder.name),
        settings=with_seed(settings, settings.seed),
        work=find_work_folder(None if work is None else Path(work), folder),
        only=tuple(only),
        profile=None if profile is None else Path(profile).absolute(),
        force=force,
        keep_old=keep_old,
        keep_invalid=keep_invalid,
        reproducible=reproducible,
    )
    where = ExecutorChoice(jobs=jobs, scheduler=scheduler, threads=threads)
    reads = (*parts_of_input(request.capture, folder), *([] if request.profile is None else [request.profile]))
    check_access(Access(reads=reads, replaces=(folder,), fills=(request.work,)))
    show = None if progress is None else lambda _, what, share: progress(what, share)
    ((_, made),) = build_plants([request], where, show)
    if made.error:
        raise RuntimeError(made.error) if made.is_fault else FoliageError(made.error, made.remedy)
    top = made.asset.parent if made.asset is not None else made.result
    page = top / "report" / "index.html" if top is not None else None
    return BuildResult(
        asset=made.asset,
        report=page if page is not None and page.is_file() else None,
        result=made.result,
        remarks=made.remarks,
        errors=made.errors,
        measures={row.name: row.value for row in made.facts},
        tasks=made.tasks,
        cached=made.cached,
        seconds=dict(made.seconds or {}),
    )


def read_plan(path: str | Path, settings: BuildSettings = BuildSettings()) -> BuildSettings:
    """Read a plan: a TOML file with settings of a build, a table for each stage (docs/settings.md).

    Args:
        path: The plan.
        settings: What holds for settings that the plan leaves out.

    Raises:
        FoliageError: There is no such file, it is no TOML, or it has an unknown setting or a value that cannot be.
    """
    return read_settings_file(Path(path), settings)
