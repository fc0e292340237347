"""What a task is given to work with."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from usdfoliage.asset.asset_record import AssetOrigin
from usdfoliage.asset.validation.studio_profile import default_profile
from usdfoliage.errors import AssetError, FoliageError
from usdfoliage.files.hashing import digest_file
from usdfoliage.jobs.plant.input_digests import DigestBy
from usdfoliage.jobs.plant.inputs import BuildInputs, find_inputs
from usdfoliage.jobs.plant.settings import BuildSettings
from usdfoliage.jobs.plant.store import ResultFile, Store
from usdfoliage.jobs.plant.tasks import ASSET, SKETCH, BuildPlan, Task
from usdfoliage.progress import Progress, StepProgress, progress_in_step


@dataclass(frozen=True, kw_only=True)
class BuildRequest:
    """A plant that a user asked for, checked."""

    capture: Path
    output: Path
    name: str
    settings: BuildSettings
    work: Path
    only: tuple[str, ...] = ()  # stages after which to stop
    profile: Path | None = None  # of the studio, for validation; None: the one that is shipped
    force: bool = False  # replace an asset of another name or origin too
    keep_old: bool = False  # what is replaced stays in a folder beside the new asset
    keep_invalid: bool = False  # put an asset that validation finds errors in into its place nevertheless
    reproducible: bool = False  # leave out how long the run took: then equal runs give the same bytes

    @property
    def store(self) -> Store:
        return Store(folder=self.work)

    @property
    def origin(self) -> AssetOrigin:
        """Of the asset."""
        return AssetOrigin(name=self.name, command="build", source=self.capture.resolve().name)


@dataclass(frozen=True, kw_only=True, eq=False)
class StageCall:
    """One task that runs."""

    request: BuildRequest
    inputs: BuildInputs
    plan: BuildPlan
    task: Task
    out: Path  # an empty folder for the result
    scratch: Path  # what a run of this task that was killed may have left; it need not be there
    threads: int  # 0: one per core
    progress: StepProgress | None = None

    @property
    def settings(self) -> BuildSettings:
        return self.request.settings

    @property
    def store(self) -> Store:
        return self.request.store

    @property
    def report_parts(self) -> Progress | None:
        """What to call with the parts of the task that are done; None where nobody listens."""
        return progress_in_step(self.task.name, self.progress)

    def result_of(self, name: str) -> Path:
        """The folder of another task's result."""
        return self.store.result(self.plan.tasks[name].key)

    @property
    def asset_result(self) -> Path:
        """The folder of the result of the task that writes the asset."""
        return self.result_of(SKETCH if self.has(SKETCH) else ASSET)

    def has(self, name: str) -> bool:
        """Whether the plan has a task of that name."""
        return name in self.plan.tasks


def inputs_of(request: BuildRequest, digest_by: DigestBy = "bytes", progress: Progress | None = None) -> BuildInputs:
    """What a plant is built from, as find_inputs finds it by the settings of the request."""
    settings = request.settings
    return find_inputs(
        request.capture,
        request.store,
        settings.leaves.depth,
        digest_by,
        video=settings.capture.video,
        progress=progress,
    )


def digest_profile(request: BuildRequest) -> str:
    """Of the rules that the asset is validated by; CaptureError where they cannot be read."""
    return digest_file(request.profile or default_profile())


def fails_now(error: FoliageError) -> bool:
    """Whether an error is of here and now, as of a full disk, and would not be a result of the task's input."""
    return isinstance(error, AssetError) or isinstance(error.__cause__, OSError)


# A stage: fills the folder of its result, and returns which files elsewhere in the work folder belong to it too.
Stage = Callable[[StageCall], tuple[ResultFile, ...]]
