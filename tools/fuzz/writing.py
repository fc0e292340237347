"""All commands that write, on small input that is made here, each with an earlier result of other options."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from usdfoliage.geometry.color import encode_srgb

from tests.support import textured_scene
from tests.support.branch_clouds import cloud_of, small_tree
from tests.support.capture_photos import FAST, write_posed_photos
from tests.support.cloud_files import write_ply
from tests.support.crown_shapes import foliage
from tests.support.leaves.scans import scanned_leaves
from tests.support.small_builds import write_quick_plan, write_small_capture

INPUT = "in"
SPRAY, LOOK = f"{INPUT}/spray", f"{INPUT}/look.usda"


@dataclass(frozen=True, kw_only=True)
class Subject:
    """A command in a folder that has the input."""

    words: tuple[str, ...]
    other: tuple[str, ...]  # more words, with which it makes another result
    outputs: tuple[str, ...]  # files and folders, which it may write
    work: str = ""  # a folder with results from which it goes on
    apart: bool = False  # whether what is in an output appears entry by entry: a capture, a library, frames


_SMALL = ("--size", "32", "--mesh-size", "9", "--reproducible")
_BUILD = ("build", "in/bed", "-o", "out", "--plan", "in/plan.toml", "--work", "work", "--reproducible")
_OTHER_PLAN = ("--plan", "in/other.toml")
SUBJECTS: Mapping[str, Subject] = {
    "crown": Subject(
        words=("crown", "in/oak.png", "-o", "out", "--no-preview", *_SMALL),
        other=("--height", "3"),
        outputs=("out",),
    ),
    "crown with pictures": Subject(
        words=("crown", "in/tree.ply", "-o", "out", *_SMALL), other=("--no-preview",), outputs=("out",)
    ),
    "branches": Subject(
        words=("branches", "in/tree.ply", "-o", "out", "--no-preview", "--reproducible"),
        other=("--foliage", "template", "--most-leaves", "5"),
        outputs=("out",),
    ),
    "leaves": Subject(
        words=("leaves", "in/bed", "-o", "out", "--no-preview", "--reproducible"),
        other=("--species", "oak"),
        outputs=("out",),
    ),
    "leaves of a cloud": Subject(
        words=(
            *("leaves", "in/scan.ply", "-o", "out", "--up", "Z", "--unit", "m", "--no-preview"),
            "--reproducible",
        ),
        other=("--species", "oak"),
        outputs=("out",),
    ),
    "capture": Subject(
        words=("capture", "in/posed", "-o", "out", "--settings", "in/posed/fast.toml", "--reproducible"),
        other=("--views", "0:4"),
        outputs=("out",),
        work="out/.usdfoliage",
        apart=True,
    ),
    "capture, poses": Subject(
        words=("capture", "in/arc", "-o", "out", "--settings", "in/fast.toml", "--reproducible"),
        other=("--no-report",),
        outputs=("out",),
        work="out/.usdfoliage",
        apart=True,
    ),
    "build": Subject(words=_BUILD, other=_OTHER_PLAN, outputs=("out",), work="work"),
    "build, two workers": Subject(words=(*_BUILD, "--jobs", "2"), other=_OTHER_PLAN, outputs=("out",), work="work"),
    "batch": Subject(
        words=("batch", "in/list.csv", "-o", "out", "--work", "work", "--jobs", "2", "--reproducible"),
        other=(),
        outputs=("out",),
        work="work",
        apart=True,
    ),
    "submit": Subject(
        words=(
            *("submit", "in/bed", "-o", "plant", "--plan", "in/plan.toml", "--work", "work", "--reproducible"),
            *("--template", "job.yaml", "--bundle", "bundle"),
        ),
        other=("--name", "shrub"),
        outputs=("job.yaml", "job.parameters.yaml", "bundle"),
        work="work",
        apart=True,
    ),
    "scatter": Subject(
        words=("scatter", "-n", "30", "--seed", "1", "-o", "out"), other=("--seed", "2"), outputs=("out",)
    ),
    "edit": Subject(
        words=("edit", SPRAY, "--width", "1.5", "-o", "out.usda"), other=("--bend", "0.4"), outputs=("out.usda",)
    ),
    "bake": Subject(words=("bake", LOOK, "-o", "out"), other=("--representation", "mesh"), outputs=("out",)),
    "preview": Subject(
        words=("preview", SPRAY, "-o", "out.png", "--size", "96", "96"),
        other=("--view", "top"),
        outputs=("out.png",),
    ),
    "preview, turntable": Subject(
        words=("preview", SPRAY, "-o", "turn.png", "--size", "64", "64", "--turntable", "3"),
        other=("--background", "transparent"),
        outputs=("turn.png", "turn_000.png", "turn_001.png", "turn_002.png"),
        apart=True,
    ),
}


def write_input(folder: Path, run: Callable[..., object], subjects: Iterable[Subject] = SUBJECTS.values()) -> None:
    """Make the input of commands.

    Args:
        folder: Where, a folder that is there.
        run: Runs a command of usdfoliage in the folder above it.
        subjects: Whose input it is.
    """
    read = {word.split("/")[1] for each in subjects for word in (*each.words, *each.other) if word.startswith("in/")}
    if "list.csv" in read:
        read |= {"bed", "hedge", "plan.toml"}
    if "oak.png" in read:
        photo = np.full((140, 140, 3), 1.0)
        photo[20:116, 22:118] = 0.5 * foliage((96, 96))
        cv2.imwrite(str(folder / "oak.png"), np.rint(encode_srgb(photo) * 255).astype(np.uint8)[..., ::-1])
    if "tree.ply" in read:
        write_ply(folder / "tree.ply", cloud_of(small_tree(), per_m2=4000))
    if "scan.ply" in read:
        points_m, _ = scanned_leaves(12, 80)
        write_ply(folder / "scan.ply", points_m, np.full(points_m.shape, (60, 140, 30)))
    for name in sorted(read & {"bed", "hedge"}):
        write_small_capture(folder / name)
    if "posed" in read:
        write_posed_photos(folder / "posed")
    if "arc" in read:
        (folder / "arc").mkdir()
        for name, pose in textured_scene.arc(6).items():
            cv2.imwrite(str(folder / "arc" / name), textured_scene.render(pose))
    (folder / "fast.toml").write_text(FAST)
    plan = write_quick_plan(folder / "plan.toml")
    (folder / "other.toml").write_text(plan.read_text().replace("max_side_px = 160", "max_side_px = 140"))
    (folder / "list.csv").write_text("capture,name,plan\nbed,bed,plan.toml\nhedge,hedge,plan.toml\n")
    if read & {"spray", "look.usda"}:
        run("scatter", "-n", "8", "--seed", "3", "-o", SPRAY)
    if "look.usda" in read:
        run("edit", SPRAY, "--width", "1.3", "-o", LOOK)
