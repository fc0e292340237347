"""The tasks of a build: which there are, what each needs, and the hash that names its result.

A task's key is known before anything runs: it is made of the code, the settings that matter to it, the input files and
the keys of the tasks whose results it reads. So a plan can list what is done already, on any machine.
"""

import functools
import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from usdfoliage.asset.provenance import PACKAGES, package_versions
from usdfoliage.asset.resources import resource_folder
from usdfoliage.capture.folder.hold_back import choose_withheld
from usdfoliage.capture.mvs.agreement import AgreementSettings
from usdfoliage.errors import CaptureError
from usdfoliage.files.code import digest_code, is_code
from usdfoliage.files.hashing import digest_values, hash_files
from usdfoliage.jobs.plant.inputs import BuildInputs
from usdfoliage.jobs.plant.outside_tools import describe_interpreter, describe_validators
from usdfoliage.jobs.plant.settings import SKETCH_SETTINGS, BuildSettings, TaskSettings
from usdfoliage.jobs.plant.store import Stamp, Store, find_finished
from usdfoliage.jobs.work.keys import task_key
from usdfoliage.remarks import Setting

logger = logging.getLogger(__name__)

POSES, MATCHING, DEPTH, CLOUD = "poses", "matching", "depth", "cloud"
ISOLATION = "isolation"
BRANCHES, LEAVES, CROWN, ASSET = "branches", "leaves", "crown", "asset"
SKETCH = "sketch"  # the whole asset of one photograph and its strokes
PART_ASSET = "part-asset"  # of one part, where a build stops after it
WITHHELD = "withheld"
TURNTABLE, COMPARISONS, VARIANTS, REPORT = "turntable", "comparisons", "variants", "report"
STAGES = (
    POSES,
    MATCHING,
    DEPTH,
    CLOUD,
    ISOLATION,
    BRANCHES,
    LEAVES,
    CROWN,
    SKETCH,
    ASSET,
    WITHHELD,
    TURNTABLE,
    COMPARISONS,
    VARIANTS,
    REPORT,
)
_RESOURCES = ("schemas", "usd_plugins", "hydra_preview")
# What poses and depth are made by: a test follows the imports.
_NOT_OF_DEPTH = ("laspy", "lazrs", "pye57", "jinja2")  # packages that read clouds and write pages
CODE_OF_DEPTH = (
    "[!_]*.py",
    "files/**/*",
    "geometry/**/*",
    "capture/**/*",
    "jobs/capture/**/*",
    "jobs/work/**/*",
    "jobs/plant/stages/capture.py",
    "jobs/plant/summary.py",
    "jobs/report/table.py",
)
_EVERYTHING = ("**/*",)


@dataclass(frozen=True, kw_only=True)
class Task:
    """One stage on one chunk."""

    name: str  # of one build; it may be a path of two parts, such as depth/3
    stage: str
    chunk: int = 0
    chunks: int = 1
    round: int = 0  # of matching
    needs: tuple[str, ...] = ()  # names of tasks whose results it reads
    key: str = ""
    estimate_s: float = 0.0  # on one core or two, estimated by its size or by what others took (times.py)

    @property
    def step(self) -> str:
        """The name without the chunk: what all chunks of a stage, or of a round of matching, share."""
        return self.name if self.chunks == 1 else _name_step(self.stage, self.round)


@dataclass(frozen=True, kw_only=True)
class BuildPlan:
    """The tasks of one plant, each after those that it needs."""

    tasks: Mapping[str, Task]
    last: tuple[str, ...]  # tasks that are wanted for themselves
    frames: str = ""  # the folder of them in the work folder, where the photographs are frames of a video

    def needed_by(self, name: str) -> Iterator[Task]:
        return (task for task in self.tasks.values() if name in task.needs)


def _name_step(stage: str, number: int) -> str:
    """The step of a stage; of matching that of its round, counted from 0."""
    return f"{stage}-{number + 1}" if stage == MATCHING else stage


def code_of(stage: str) -> tuple[str, ...]:
    """Patterns of the code that decides what a stage makes.

    Of matching, which takes longest, only what it can reach: another report is no reason to match again.
    """
    return CODE_OF_DEPTH if stage in (POSES, MATCHING, DEPTH) else _EVERYTHING


@functools.cache
def build_code_version(stage: str) -> str:
    """A hash of everything that decides what a stage makes: the package, its extension, schemas, shaders, libraries."""
    of_depth = code_of(stage) == CODE_OF_DEPTH
    packages = [name for name in PACKAGES if not (of_depth and name in _NOT_OF_DEPTH)]
    folders = [] if of_depth else [resource_folder(name) for name in _RESOURCES]
    resources = [(path.name, path) for folder in folders for path in sorted(folder.rglob("*")) if is_code(path)]
    versions = repr(sorted(package_versions(packages).items()))
    return digest_values(versions, digest_code(code_of(stage)), hash_files(resources).hex())


def plan_build(
    inputs: BuildInputs, settings: BuildSettings, name: str, only: Sequence[str] = (), profile: str = ""
) -> BuildPlan:
    """The tasks of a plant.

    Args:
        inputs: The files, with their digests.
        settings: Of every stage.
        name: Of the asset.
        only: Stages after which to stop; none: all. Parts among them get an asset of their own.
        profile: Digest of the studio's profile that the asset is validated by.

    Raises:
        CaptureError: The settings ask for what the files cannot give.
    """
    if inputs.photo is not None:
        return _plan_sketch(inputs, settings, name, only, profile)
    tasks: dict[str, Task] = {}
    megapixels = inputs.megapixels
    add = functools.partial(_add_task, tasks)
    parts: list[str] = []
    poses = ""
    source = list(inputs.digests)
    if inputs.photographs:
        capture = settings.capture
        photographs = len(inputs.photographs)
        posing = (capture.poses, capture.mask, capture.sky, capture.pose_estimation, capture.world)
        frames = None if inputs.frames is None else capture.video  # which photographs there are
        # A run that used uncertain poses leaves none for one that would have stopped at them; given poses are certain.
        uncertain = capture.uncertain_poses if capture.poses == "estimate" or not inputs.has_cameras else ""
        withheld = choose_withheld(list(inputs.photographs), settings.plant.hold_back)
        deciding = (source, inputs.name, frames, settings.seed, posing, uncertain, capture.depth.max_side_px, withheld)
        estimated = 0.0 if inputs.has_cameras else 1.0
        poses = add(POSES, deciding, (), 2.0 + photographs * (0.15 * megapixels + estimated))
        photographs -= len(withheld)
        chunks = -(-photographs // settings.tasks.photographs_a_task)
        # Hashed once for all chunks: a library of thousands is planned in seconds.
        matching = task_key(capture.dense, replace(capture.depth, agreement=AgreementSettings()))
        finishing = task_key(capture.depth)
        before = [poses]
        rounds = len(capture.depth.rounds) if capture.dense == "own" else 0
        matched = photographs * min(megapixels, (capture.depth.max_side_px / 1000) ** 2 * 0.75)
        for number in range(rounds):
            level = capture.depth.rounds[number].level
            cost_s = 3.0 * matched / chunks / 4**level
            before = [
                add(
                    MATCHING,
                    matching,
                    before if number else [poses],
                    0.3 + cost_s,
                    chunk=k,
                    chunks=chunks,
                    round=number,
                )
                for k in range(chunks)
            ]
        finished = before
        if rounds:
            cost_s = 0.3 + matched / chunks
            finished = [add(DEPTH, finishing, before, cost_s, chunk=k, chunks=chunks) for k in range(chunks)]
        cloud_settings = replace(capture, uncertain_poses="stop")  # which decides nothing once there are poses
        cloud = add(CLOUD, cloud_settings, [poses, *finished], 3.0 + 1.2 * matched)
    else:
        if settings.plant.hold_back:
            raise CaptureError(
                f"{inputs.source} has no photographs, and none can be withheld",
                ("set ", Setting(name="plant.hold_back", value="0")),
            )
        cloud = ""
    has_cloud = [cloud] if cloud else []
    plant = has_cloud  # what its parts are made of
    if cloud and settings.isolation.make != "off":
        given = source if inputs.has_depth else []  # which lies beside what was found
        megapixels_of_all = len(inputs.photographs) * megapixels
        isolation = add(ISOLATION, (settings.isolation, given), has_cloud, 5.0 + 0.7 * megapixels_of_all)
        plant = [isolation]
    species = settings.plant.species  # which is written into the asset of every part
    branch_settings = (settings.seed, settings.branches, species, name, *([] if cloud else source))
    has_branches = settings.branches.make != "off"
    if has_branches and not cloud:  # first, since a cloud of no plant ends the build
        parts.append(add(BRANCHES, branch_settings, plant, 25.0))
    leaves = []  # of photographs, by which stems are distinguished from veins, and which petioles lead to
    if settings.leaves.make:
        leaf_settings = (settings.seed, settings.leaves, species, name, source)
        leaves_s = 5.0 + 3.0 * len(inputs.photographs) * megapixels if cloud else 30.0
        leaves = [add(LEAVES, leaf_settings, plant, leaves_s)]
    if has_branches and cloud:
        parts.append(add(BRANCHES, branch_settings, [*plant, *leaves], 25.0))
    parts += leaves
    if settings.crown.make:
        crown_settings = (settings.seed, settings.crown, species, name, *([] if cloud else source))
        parts.append(add(CROWN, crown_settings, [*plant, *parts], 40.0))
    part_settings = (name, inputs.name, source, replace(settings, tasks=TaskSettings()))
    for part in parts:
        if part in only:
            full = f"{part}-asset"
            key = task_key(build_code_version(PART_ASSET), full, part_settings, [tasks[part].key])
            tasks[full] = Task(name=full, stage=PART_ASSET, needs=(part,), key=key, estimate_s=2.0)
    draws = describe_interpreter() if settings.pictures.make else ()  # the thumbnail too
    asset_settings = (replace(settings, tasks=TaskSettings()), name, inputs.name, source, draws)
    asset = add(ASSET, asset_settings, [*plant, *parts], 20.0)
    pictures: list[str] = []
    if settings.plant.hold_back:
        pictures.append(add(WITHHELD, settings.plant.hold_back, [poses, asset], 2.0 + 0.5 * len(inputs.photographs)))
    if settings.pictures.make:
        drawn = settings.pictures
        picture_settings = (drawn, draws)
        pictures.append(add(TURNTABLE, picture_settings, [asset], 4.0 + 1.2 * drawn.turntable_frames))
        if cloud:
            pictures.append(add(COMPARISONS, picture_settings, [*plant, asset], 6.0 + 2.5 * drawn.comparisons))
        pictures.append(add(VARIANTS, picture_settings, [asset], 30.0))
    everything = [*([poses] if cloud else []), *dict.fromkeys([*has_cloud, *plant]), *parts, asset, *pictures]
    report = add(REPORT, (profile, describe_validators()), everything, 20.0)
    frames_folder = "" if inputs.frames is None else inputs.frames.folder.name
    return BuildPlan(tasks=tasks, last=_last_tasks(tasks, inputs, only, report), frames=frames_folder)


def _plan_sketch(
    inputs: BuildInputs, settings: BuildSettings, name: str, only: Sequence[str], profile: str
) -> BuildPlan:
    """The tasks of a tree of one photograph, as plan_build: one makes its whole asset."""
    tree = settings.sketch.tree
    if settings.plant.hold_back:
        raise CaptureError(
            f"{inputs.source} is one photograph, and none can be withheld",
            ("set ", Setting(name="plant.hold_back", value="0")),
        )
    if (inputs.trees > 1 and tree is None) or (tree or 1) > inputs.trees:
        asked = "an asset is one of them" if tree is None else f"tree {tree} is asked for"
        which = "1" if inputs.trees == 1 else f"a number from 1 to {inputs.trees}"
        raise CaptureError(
            f"the strokes of {inputs.source} are of {inputs.trees} tree{'s' * (inputs.trees > 1)}, and {asked}",
            ("set ", Setting(name="sketch.tree"), f" to {which}, or build all by usdfoliage batch"),
        )
    tasks: dict[str, Task] = {}
    add = functools.partial(_add_task, tasks)
    draws = describe_interpreter() if settings.pictures.make else ()
    decided = [getattr(settings, table) for table in SKETCH_SETTINGS]
    sketch = add(SKETCH, (inputs.digests, inputs.name, settings.seed, decided, name, draws), (), 25.0)
    pictures: list[str] = []
    if settings.pictures.make:
        drawn = (settings.pictures, draws)
        pictures.append(add(TURNTABLE, drawn, [sketch], 4.0 + 1.2 * settings.pictures.turntable_frames))
        pictures.append(add(VARIANTS, drawn, [sketch], 30.0))
    report = add(REPORT, (profile, describe_validators()), [sketch, *pictures], 20.0)
    return BuildPlan(tasks=tasks, last=_last_tasks(tasks, inputs, only, report))


def _add_task(
    tasks: dict[str, Task], stage: str, deciding: object, needs: Sequence[str], estimate_s: float, **place: int
) -> str:
    """Add a task to those of a plan; its name."""
    chunk, chunks, number = place.get("chunk", 0), place.get("chunks", 1), place.get("round", 0)
    full = _name_step(stage, number)
    if chunks > 1:
        full = f"{full}/{chunk + 1}"
    keys = [tasks[each].key for each in needs]
    key = task_key(build_code_version(stage), stage, number, chunk, chunks, deciding, keys)
    tasks[full] = Task(
        name=full,
        stage=stage,
        chunk=chunk,
        chunks=chunks,
        round=number,
        needs=tuple(needs),
        key=key,
        estimate_s=estimate_s,
    )
    return full


def _last_tasks(tasks: Mapping[str, Task], inputs: BuildInputs, only: Sequence[str], report: str) -> tuple[str, ...]:
    """The tasks that are wanted for themselves; CaptureError where there are none of the stages that are asked for."""
    if not only:
        return (report,)
    stop_after = (*only, PART_ASSET)  # which there is for the parts among them alone
    last = tuple(task.name for task in tasks.values() if task.stage in stop_after)
    if not last:
        stages = dict.fromkeys(task.stage for task in tasks.values())
        raise CaptureError(
            f"a build of {inputs.source} has no stage {' and no stage '.join(only)}",
            f"its stages are {', '.join(stages)}",
        )
    return last


def find_wanted(plan: BuildPlan, store: Store, *, thorough: bool) -> tuple[dict[str, Task], dict[str, Stamp]]:
    """What must be done for the last tasks, and what is done already of all that was looked at.

    What only finished tasks need is not looked at: it may be gone.

    Args:
        plan: All tasks.
        store: Where results are.
        thorough: Whether every byte of a result is looked at.
    """
    wanted: set[str] = set()
    finished: dict[str, Stamp] = {}
    ahead = list(plan.last)
    while ahead:
        name = ahead.pop()
        if name in wanted or name in finished:
            continue
        stamp = find_finished(store, plan.tasks[name].key, thorough=thorough)
        if stamp is not None and not stamp.poor:
            finished[name] = stamp
            continue
        wanted.add(name)
        ahead.extend(plan.tasks[name].needs)
    return {name: task for name, task in plan.tasks.items() if name in wanted}, finished
