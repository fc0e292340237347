"""Which files are damaged, how, and which commands they are given to."""

import shutil
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tools.fuzz.headers import LIES
from tools.fuzz.mutations import BYTES, PLACES, TEXT, TOML

_SMALL = ("--size", "32", "--mesh-size", "17", "--no-preview")
_CROWN = ("crown", "photo/oak.png", "--mask", "photo/mask.png", *_SMALL, "-o", "out")
_LARCH = ("branches", "cloud/tree.ply", "--species-file", "toml/species.toml", "--species", "larch")
CHILDREN_KILLED = "children killed"  # a kind of cases
_FAST = ("--settings", "bed/fast.toml", "--no-report")


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A file that is damaged in every case, and the commands that read it, which take turns."""

    name: str
    target: str  # below the folder of a case; its first folder, and those in with_trees, are copied there; of several
    # files that a pattern names the first
    commands: Sequence[Sequence[str]]
    with_trees: Sequence[str] = ()
    text: bool = False
    cases: int = 20


@dataclass(frozen=True, kw_only=True)
class Case:
    """One run of one command on files of which one is damaged."""

    kind: str
    number: int
    mutation: str
    target: str
    words: Sequence[str]  # of the command line, paths below the folder of the case
    prepare: Callable[[Path], None]  # makes that folder
    names_file: bool = True  # whether a refusal must name the target
    harden: Callable[[], None] | None = None  # what is done to the process of the command, in the case's folder


def _photograph(name: str) -> Kind:
    photo = f"photo/{name}"
    return Kind(
        name=f"photograph {name}",
        target=photo,
        with_trees=("plants",),
        commands=(
            ("crown", photo, "--mask", "photo/mask.png", *_SMALL, "-o", "out"),
            ("scatter", "-n", "2", "--texture", photo, "-o", "out"),
            ("edit", "plants/spray", "--jitter", "0.1", "2", "--jitter-map", photo, "-o", "out.usda"),
            ("crown", photo, "-o", "out", "--dry-run"),
        ),
    )


def _cloud(name: str, text: bool = False) -> Kind:
    return Kind(
        name=f"cloud {name}",
        target=f"cloud/{name}",
        text=text,
        commands=(
            ("branches", f"cloud/{name}", "--no-preview", "-o", "out"),
            ("branches", f"cloud/{name}", "-o", "out", "--dry-run"),
            ("crown", f"cloud/{name}", *_SMALL, "-o", "out"),
        ),
    )


def _sketch(name: str, text: bool = False, cases: int = 20) -> Kind:
    return Kind(
        name=f"sketch {name}",
        target=f"sketch/{name}",
        text=text,
        cases=cases,
        commands=(
            ("sketch", "sketch/oak.png", "-o", "out", "--dry-run"),
            ("build", "sketch/oak.png", "-o", "out", "--dry-run"),
        ),
    )


def _in_bed(target: str, text: bool = False, cases: int = 20) -> Kind:
    bed = target.split("/")[0]
    return Kind(
        name=target,
        target=target,
        text=text,
        cases=cases,
        with_trees=("bed",),
        commands=(
            ("leaves", bed, "--no-preview", "-o", "out"),
            ("capture", bed, *_FAST, "-o", "out"),
            ("leaves", bed, "-o", "out", "--dry-run"),
            ("capture", bed, "-o", "out", "--dry-run"),
        ),
    )


def _usd(target: str, asset: str, text: bool, cases: int = 24) -> Kind:
    commands: list[Sequence[str]] = [("info", asset), ("validate", asset)]
    if "crown" not in asset:
        commands += [
            ("edit", asset, "--width", "2", "--curl", "0.1", "0", "0", "-o", "out.usda"),
            ("bake", asset, "-o", "out"),
            ("branches", "cloud/tree.ply", "--leaves", asset, "--no-preview", "-o", "out"),
        ]
    return Kind(name=target, target=target, commands=commands, with_trees=("cloud",), text=text, cases=cases)


def _library(name: str) -> Kind:
    return Kind(
        name=f"library {name}",
        target=f"library/{name}",
        text=True,
        commands=(("batch", f"library/{name}", "-o", "out", "--dry-run"),),
        with_trees=("bed", "cloud", "toml"),
        cases=24,
    )


def _work(name: str, target: str) -> Kind:
    return Kind(
        name=f"work {name}",
        target=target,
        text=True,
        commands=(
            ("build", "bed", "-o", "out", "--work", "work", "--dry-run"),
            ("work", "work"),
            ("work", "work", "--prune", "--dry-run"),
        ),
        with_trees=("bed",),
        cases=24,
    )


KINDS: tuple[Kind, ...] = (
    *map(_photograph, ("oak.jpg", "oak progressive.jpg", "oak.png", "oak 16.png", "oak alpha.png", "oak grey.png")),
    *map(_photograph, ("oak.tif", "oak tiled.tif", "oak.exr")),
    Kind(name="mask", target="photo/mask.png", commands=(_CROWN,)),
    Kind(name="tangent", target="photo/oak grey.png", commands=((*_CROWN, "--tangent", "photo/oak grey.png"),)),
    *(_sketch("oak.png"), _sketch("oak.strokes.json", text=True, cases=60)),
    *(_in_bed("bed/images/leaf 1.png"), _in_bed("bed/masks/leaf 2.png"), _in_bed("bed/depth/leaf 3.exr")),
    *(_in_bed("bed/depth/leaf 4.png"), _in_bed("bed/capture.toml", text=True, cases=28)),
    *(_in_bed(f"bed/cameras/{name}.txt", text=True) for name in ("cameras", "images", "points3D")),
    *(_in_bed(f"binary/cameras/{name}.bin") for name in ("cameras", "images", "points3D")),
    *map(_cloud, ("tree.ply", "big endian.ply", "tree.las", "tree.laz")),
    *(_cloud(name, text=True) for name in ("ascii.ply", "tree.xyz", "tree.csv", "tree.pts")),
    Kind(
        name="settings leaves",
        target="toml/leaves.toml",
        text=True,
        commands=(
            ("leaves", "--settings", "toml/leaves.toml", "--print-settings"),
            ("leaves", "bed", "--settings", "toml/leaves.toml", "--no-preview", "-o", "out"),
        ),
        with_trees=("bed",),
        cases=30,
    ),
    Kind(
        name="settings capture",
        target="toml/capture.toml",
        text=True,
        commands=(
            ("capture", "--settings", "toml/capture.toml", "--print-settings"),
            ("capture", "bed", "--settings", "toml/capture.toml", "-o", "out", "--dry-run"),
        ),
        with_trees=("bed",),
        cases=30,
    ),
    Kind(
        name="plan",
        target="toml/build.toml",
        text=True,
        commands=(
            ("build", "--print-plan", "--plan", "toml/build.toml"),
            ("build", "bed", "--plan", "toml/build.toml", "-o", "out", "--dry-run"),
            ("build", "cloud/tree.ply", "--plan", "toml/build.toml", "-o", "out", "--dry-run"),
        ),
        with_trees=("bed", "cloud"),
        cases=40,
    ),
    *map(_library, ("list.txt", "list.csv")),
    *(_work("stamp", "work/tasks/*.json"), _work("record", "work/builds/*.json")),
    Kind(
        name="species",
        target="toml/species.toml",
        text=True,
        commands=(
            (*_LARCH, "--dry-run", "-o", "out"),
            (*_LARCH, "--foliage", "template", "--no-preview", "-o", "out"),
        ),
        with_trees=("cloud",),
        cases=30,
    ),
    Kind(
        name="profile",
        target="toml/profile.toml",
        text=True,
        commands=(("validate", "plants/spray", "--profile", "toml/profile.toml"),),
        with_trees=("plants",),
        cases=24,
    ),
    _usd("plants/look.usda", "plants/look.usda", text=True, cases=40),
    *(_usd(f"plants/spray/{name}", "plants/spray", text=True) for name in ("spray.usda", "payload/payload.usda")),
    _usd("plants/spray/payload/materials.usda", "plants/spray", text=True),
    _usd("plants/spray/payload/leaves.usdc", "plants/spray", text=False, cases=50),
    _usd("plants/spray/payload/leaves_mesh.usdc", "plants/spray", text=False, cases=20),
    _usd("plants/spray/maps/spray_leaf.png", "plants/spray", text=False, cases=12),
    _usd("plants/tree/payload/skeleton.usdc", "plants/tree", text=False, cases=16),
    _usd("plants/crown/payload/crown.usdc", "plants/crown", text=False, cases=16),
    _usd("plants/crown/maps/crown_crown_radius.exr", "plants/crown", text=False, cases=16),
    _usd("bed/capture.usda", "bed/capture.usda", text=True, cases=12),
)


# Seed, kind and number of what had a fault once.
FOUND: tuple[tuple[int, str, int], ...] = (
    (4711, "plants/spray/payload/leaves.usdc", 22),  # a value of a crate that cannot be unpacked, in edit
    (4711, "plants/crown/maps/crown_crown_radius.exr", 1),  # a header that is no Unicode, in validate
    (72, "cloud tree.csv", 13),  # a colour that no float32 holds
    (73, "binary/cameras/images.bin", 1),  # cameras of one photograph; the message named the output
    (72, "plants/tree/payload/skeleton.usdc", 14),  # numbers that are none, in validate
    (74, "settings leaves", 9),  # a grid of 2^31 columns
    (74, "plants/spray/payload/leaves.usdc", 21),  # an exception that USD prints, in validate
    (76, "cloud ascii.ply", 2),  # a warning of numpy
    (76, "plants/spray/payload/leaves.usdc", 28),  # another one, in validate
)


def random_cases(seeds: Path, seed: int, share: float = 1.0) -> list[Case]:
    """The cases of every kind; a share of them for a quick look. The same seed gives the same bytes."""
    return [
        _random_case(seeds, kind, number, seed) for kind in KINDS for number in range(max(1, round(kind.cases * share)))
    ]


def found_cases(seeds: Path) -> list[Case]:
    """The cases with a fault of earlier runs, each of which was mended then."""
    kinds = {kind.name: kind for kind in KINDS}
    cases = [_random_case(seeds, kinds[name], number, seed) for seed, name, number in FOUND]
    return [replace(case, kind=f"found in {case.kind}") for case in cases]


def _random_case(seeds: Path, kind: Kind, number: int, seed: int) -> Case:
    """One file damaged: one case in four in its place on the disk, the others in its bytes."""
    rng = np.random.default_rng([seed, zlib.crc32(kind.name.encode()), number])
    suffix = Path(kind.target).suffix
    if number % 4 == 3:
        spoil = PLACES[(number // 4 + zlib.crc32(kind.name.encode())) % len(PLACES)]
        name = spoil.__name__
    else:
        lies = LIES.get(suffix, ())
        known = TOML if suffix == ".toml" else TEXT if kind.text else BYTES
        mutate = lies[int(rng.integers(len(lies)))] if lies and rng.random() < 0.5 else known[rng.integers(len(known))]
        name = mutate.__name__

        def spoil(path: Path) -> None:
            path.write_bytes(mutate(path.read_bytes(), rng))

    trees = dict.fromkeys((kind.target.split("/")[0], *kind.with_trees))

    def prepare(folder: Path) -> None:
        for tree in trees:
            shutil.copytree(seeds / tree, folder / tree)
        spoil(min(folder.glob(kind.target)) if "*" in kind.target else folder / kind.target)

    turn = number // 4 if number % 4 == 3 else number - number // 4
    words = kind.commands[turn % len(kind.commands)]
    return Case(kind=kind.name, number=number, mutation=name, target=kind.target, words=words, prepare=prepare)
