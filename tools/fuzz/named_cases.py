"""Hostile input that is made on purpose: odd names, captures with broken files among good ones, cameras that cannot be."""

import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import OpenImageIO as oiio

from fuzz.cases import Case
from fuzz.mutations import PLACES, make_empty, make_folder, make_loop, make_noise, make_pipe, make_text

Damage = Callable[[Path], None]

NAMES = (
    *("a b", "ünïcode 木 \U0001f333", "e\u0301", "a\nb", "a\tb", os.fsdecode(b"\xff\xfe"), "-o", "--help", "x" * 230, "木" * 76),
    *("<UDIM>", "%04d", "@x@", "#", "$HOME", "'\"", "a:b", "a?b", "[1]", "{a}", "a;b", "a\\b", "\u202eb", "~", "\x07", "1 %s"),
)
_BED = (
    ("leaves", "bed", "--no-preview", "-o", "out"),
    ("capture", "bed", "--settings", "bed/fast.toml", "--no-report", "-o", "out"),
)


def named_cases(seeds: Path) -> list[Case]:
    """All of them."""
    found = [*_odd_names(seeds), *_broken_captures(seeds), *_other(seeds)]
    return [
        Case(
            kind=kind, number=number, mutation=what, target=target, words=words, prepare=prepare, names_file=bool(target)
        )
        for number, (kind, what, target, words, prepare) in enumerate(found)
    ]


_Made = tuple[str, str, str, Sequence[str], Damage]


def _odd_names(seeds: Path) -> Iterator[_Made]:
    """Good files, folders and outputs of names that file systems allow."""

    def copy(source: str, name: str) -> Damage:
        def prepare(folder: Path) -> None:
            kept = seeds / source
            (shutil.copytree if kept.is_dir() else shutil.copy)(kept, folder / name)
            shutil.copy(seeds / "photo" / "mask.png", folder / "mask.png")

        return prepare

    small = ("--size", "32", "--mesh-size", "17", "--no-preview")
    for number, name in enumerate(NAMES):
        given = f"./{name}"
        for source, words in (
            ("photo/oak.png", ("crown", f"{given}.png", "--mask", "mask.png", *small, "-o", "out")),
            ("photo/oak.png", ("scatter", "-n", "1", "--texture", f"{given}.png", "-o", f"out{name}")),
            ("cloud/tree.xyz", ("branches", f"{given}.xyz", "--no-preview", "-o", "out")),
            ("bed", ("leaves", given, "--no-preview", "-o", f"out{name}")),
            ("bed", ("capture", given, "--settings", f"{given}/fast.toml", "--no-report", "-o", "out")),
            ("plants/spray", ("info", given)),
            ("plants/spray", ("validate", given)),
            ("plants/spray", ("edit", given, "--width", "2", "-o", f"out{name}.usda")),
        )[number % 2 :: 2]:
            yield f"name {words[0]}", repr(name[:20]), "", words, copy(source, name + Path(source).suffix)
    for path in ("photo/../photo/oak.png", "link/../photo/oak.png", "photo//./oak.png"):

        def prepare(folder: Path) -> None:
            shutil.copytree(seeds / "photo", folder / "photo")
            (folder / "link").symlink_to("photo")

        yield "name crown", path, "", ("crown", path, "--mask", "photo/mask.png", *small, "-o", "out"), prepare


def _broken_captures(seeds: Path) -> Iterator[_Made]:
    """The bed with things done to it."""

    def damaged(damage: Damage, tree: str = "bed") -> Damage:
        def prepare(folder: Path) -> None:
            shutil.copytree(seeds / tree, folder / "bed")
            damage(folder / "bed")

        return prepare

    for damage in DAMAGES:
        for words in _BED:
            yield "broken capture", damage.__name__, "", words, damaged(damage)
    for damage in (mix_broken_photographs, make_all_broken, make_twin_names, make_odd_photographs):
        words = ("capture", "bed/images", "--settings", "bed/fast.toml", "--no-report", "-o", "out", "--dry-run")
        yield "broken photographs", damage.__name__, "", words, damaged(damage)
    for place in PLACES:
        for below in ("images", "cameras", "depth", "masks", "cloud.ply"):

            def damage(bed: Path, place: Damage = place, below: str = below) -> None:
                path = bed / below
                if path.is_dir():
                    shutil.rmtree(path)
                    path.write_bytes(b"0" * 64)
                place(path)

            yield "folder replaced", f"{below} {place.__name__}", "", _BED[0], damaged(damage)


def mix_broken_photographs(bed: Path) -> None:
    """Three in ten photographs: a truncated JPEG, no bytes, a text; and further ones that no camera has."""
    images = bed / "images"
    make_empty(images / "leaf 1.png")
    make_text(images / "leaf 3.png")
    cv2.imwrite(str(images / "whole.jpg"), cv2.imread(str(images / "leaf 0.png")))
    data = (images / "whole.jpg").read_bytes()
    (images / "half.jpg").write_bytes(data[: len(data) // 2])
    (images / "text.jpg").write_text("no picture")
    (images / "Thumbs.db").write_bytes(b"\xd0\xcf\x11\xe0")
    cv2.imwrite(str(images / "one.png"), np.zeros((1, 1, 3), np.uint8))


def make_all_broken(bed: Path) -> None:
    for photo in (bed / "images").iterdir():
        make_noise(photo)


def make_odd_photographs(bed: Path) -> None:
    """One of 1 x 1 pixel, CMYK, 16 bits, greyscale, with alpha, each in a file of a good name."""
    images = bed / "images"
    picture = cv2.imread(str(images / "leaf 1.png"))
    cv2.imwrite(str(images / "leaf 0.png"), np.zeros((1, 1, 3), np.uint8))
    cv2.imwrite(str(images / "leaf 1.png"), picture.astype(np.uint16) * 257)
    cv2.imwrite(str(images / "leaf 2.png"), picture[..., 0])
    cv2.imwrite(str(images / "leaf 3.png"), np.dstack([picture, picture[..., 1]]))
    path = images / "leaf 4.tif"
    output = oiio.ImageOutput.create(str(path))
    spec = oiio.ImageSpec(picture.shape[1], picture.shape[0], 4, "uint8")
    spec.attribute("tiff:ColorSpace", "CMYK")
    assert output.open(str(path), spec)
    assert output.write_image(np.dstack([picture, picture[..., :1]]))
    output.close()
    path.replace(images / "leaf 4.png")


def make_other_masks(bed: Path) -> None:
    """Masks of another size, all black, all white, empty, and a picture of noise."""
    masks = bed / "masks"
    cv2.imwrite(str(masks / "leaf 0.png"), np.full((50, 30), 255, np.uint8))
    cv2.imwrite(str(masks / "leaf 1.png"), np.zeros((96, 128), np.uint8))
    cv2.imwrite(str(masks / "leaf 2.png"), np.full((96, 128), 255, np.uint8))
    make_empty(masks / "leaf 3.png")
    make_folder(masks / "leaf 4.png")


def make_black_masks(bed: Path) -> None:
    for mask in (bed / "masks").iterdir():
        cv2.imwrite(str(mask), np.zeros((96, 128), np.uint8))


def make_odd_depth(bed: Path) -> None:
    """Depth that is not finite, negative, of another size, of another channel."""
    for number, (name, depth_m) in enumerate(
        (
            ("Z", np.full((96, 128), np.nan, np.float32)),
            ("Z", np.full((96, 128), -1, np.float32)),
            ("Z", np.ones((7, 9), np.float32)),
            ("A", np.ones((96, 128), np.float32)),
        )
    ):
        OpenEXR.File({"type": OpenEXR.scanlineimage}, {name: depth_m}).write(str(bed / "depth" / f"leaf {number}.exr"))
    cv2.imwrite(str(bed / "depth" / "leaf 4.png"), np.zeros((96, 128), np.uint8))


def make_constant_depth(bed: Path) -> None:
    shutil.rmtree(bed / "depth")
    (bed / "depth").mkdir()
    for number in range(5):
        flat = np.full((96, 128), 1e-6 if number % 2 else 9e5, np.float32)
        OpenEXR.File({"type": OpenEXR.scanlineimage}, {"Z": flat}).write(str(bed / "depth" / f"leaf {number}.exr"))


def _edit(name: str, change: Callable[[list[str]], list[str]]) -> Damage:
    def damage(bed: Path) -> None:
        path = bed / "cameras" / name
        path.write_text("\n".join(change(path.read_text().splitlines())))

    return damage


def _poses(line: str, values: Sequence[str]) -> str:
    words = line.split(" ", 8)
    return " ".join([words[0], *values, words[8]]) if len(words) == 9 else line


def make_nan_pose(bed: Path) -> None:
    _edit("images.txt", lambda lines: [_poses(line, ["nan"] * 7) for line in lines])(bed)


def make_one_nan_pose(bed: Path) -> None:
    _edit("images.txt", lambda lines: [lines[0], _poses(lines[1], ["1", "0", "0", "0", "nan", "0", "0"]), *lines[2:]])(bed)


def make_zero_quaternions(bed: Path) -> None:
    _edit("images.txt", lambda lines: [_poses(line, ["0"] * 7) for line in lines])(bed)


def make_same_poses(bed: Path) -> None:
    """All photographs from one place: no depth can follow."""
    _edit("images.txt", lambda lines: [_poses(line, ["1", "0", "0", "0", "0", "0", "0"]) for line in lines])(bed)


def make_far_poses(bed: Path) -> None:
    _edit("images.txt", lambda lines: [_poses(line, ["1", "0", "0", "0", "1e18", "0", "-1e18"]) for line in lines])(bed)


def make_zero_focal(bed: Path) -> None:
    _edit("cameras.txt", lambda lines: [*lines[:-1], "1 PINHOLE 128 96 0 0 64 48"])(bed)


def make_tiny_focal(bed: Path) -> None:
    _edit("cameras.txt", lambda lines: [*lines[:-1], "1 PINHOLE 128 96 1e-300 1e300 64 48"])(bed)


def make_wild_lens(bed: Path) -> None:
    """A lens whose distortion folds the picture."""
    _edit("cameras.txt", lambda lines: [*lines[:-1], "1 OPENCV 128 96 120 120 64 48 1e9 -1e9 1e5 7"])(bed)


def make_far_center(bed: Path) -> None:
    _edit("cameras.txt", lambda lines: [*lines[:-1], "1 PINHOLE 128 96 120 120 1e12 -1e12"])(bed)


def make_huge_camera(bed: Path) -> None:
    _edit("cameras.txt", lambda lines: [*lines[:-1], "1 PINHOLE 1280000000 960000000 120 120 64 48"])(bed)


def make_twin_names(bed: Path) -> None:
    """A photograph that is listed twice, and one that is there twice but for its suffix."""
    _edit("images.txt", lambda lines: [*lines, *lines[1:3]])(bed)
    shutil.copy(bed / "images" / "leaf 0.png", bed / "images" / "leaf 0.jpg")


def make_absent_photographs(bed: Path) -> None:
    """Listed and absent, and the other way round."""
    (bed / "images" / "leaf 0.png").rename(bed / "images" / "unlisted.png")
    (bed / "images" / "leaf 3.png").unlink()


def make_no_photographs(bed: Path) -> None:
    for photo in (bed / "images").iterdir():
        photo.unlink()


def make_names_that_lead_out(bed: Path) -> None:
    _edit("images.txt", lambda lines: [line.replace("leaf 0.png", "../../../../etc/passwd") for line in lines])(bed)


def make_looped_folder(bed: Path) -> None:
    (bed / "images" / "again").symlink_to("..")
    make_loop(bed / "images" / "leaf 2.png")
    make_pipe(bed / "images" / "leaf 4.png")


def make_many_points(bed: Path) -> None:
    """Points of which all are in one place, or far away."""
    lines = [f"{number} {'1e300' if number % 3 else '0'} 0 0 9 9 9 0.1 1 2" for number in range(1, 3000)]
    (bed / "cameras" / "points3D.txt").write_text("\n".join(lines))


def make_truncated_work(bed: Path) -> None:
    (bed / "capture.toml").write_text("metres_per_unit = 1e-9\nup_axis = 'Y'\n")


DAMAGES: tuple[Damage, ...] = (
    *(mix_broken_photographs, make_all_broken, make_odd_photographs, make_other_masks, make_black_masks),
    *(make_odd_depth, make_constant_depth, make_nan_pose, make_one_nan_pose, make_zero_quaternions, make_same_poses),
    *(make_far_poses, make_zero_focal, make_tiny_focal, make_wild_lens, make_far_center, make_huge_camera),
    *(make_twin_names, make_absent_photographs, make_no_photographs, make_names_that_lead_out, make_looped_folder),
    *(make_many_points, make_truncated_work),
)


def _other(seeds: Path) -> Iterator[_Made]:
    """Files that no damage makes: bombs, lines without end, a drawing of what cannot be drawn."""

    def written(target: str, data: Callable[[], bytes], *trees: str) -> Damage:
        def prepare(folder: Path) -> None:
            for tree in trees:
                shutil.copytree(seeds / tree, folder / tree)
            (folder / target).parent.mkdir(parents=True, exist_ok=True)
            (folder / target).write_bytes(data())

        return prepare

    header = "ply\nformat {} 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
    for what, target, data in (
        ("a line of 40 MB", "a.xyz", lambda: b"1 2 3 " * 7_000_000),
        ("a million numbers a line", "a.xyz", lambda: b"1 " * 1_000_000 + b"\n1 2 3\n" * 60),
        ("zeros without end", "a.pts", lambda: b"\0" * 10_000_000),
        ("a count of 10^12", "a.ply", lambda: header.format("binary_little_endian", 10**12).encode() + b"\0" * 600),
        ("a count of 10^12, text", "a.ply", lambda: header.format("ascii", 10**12).encode() + b"1 2 3\n" * 60),
        ("numbers of a million digits", "a.xyz", lambda: (b"9" * 1_000_000 + b" 1 2\n") * 8),
        ("one place", "a.xyz", lambda: b"1 2 3\n" * 1000),
        ("a line of points", "a.xyz", lambda: b"".join(b"%d 0 0\n" % number for number in range(1000))),
        ("no number", "a.xyz", lambda: b"nan nan nan\n" * 1000),
        ("far apart", "a.xyz", lambda: b"".join(b"%d 1e%d 3\n" % (k, k % 11) for k in range(1000))),
    ):
        yield "cloud made", what, target, ("branches", target, "--no-preview", "-o", "out"), written(target, data)
    for what, data in (
        ("deep lists", lambda: b"a = " + b"[" * 100_000),
        ("deep tables", lambda: b"a = " + b"{a = " * 50_000),
        ("deep dots", lambda: b"a" + b".a" * 20_000 + b" = 1"),
        ("long number", lambda: b"metres_per_unit = " + b"9" * 100_000),
        ("long text", lambda: b"name = '" + b"x" * 10_000_000 + b"'"),
        ("no Unicode", lambda: b"name = '\xff\xfe'"),
    ):
        for words in (
            ("leaves", "bed", "-o", "out", "--dry-run"),
            ("capture", "bed", "-o", "out", "--dry-run"),
            ("branches", "bed", "-o", "out", "--dry-run"),
            ("leaves", "--print-settings", "--settings", "bed/capture.toml"),
            ("branches", "bed/cloud.ply", "--dry-run", "-o", "out", "--species-file", "bed/capture.toml"),
            ("validate", "plants/spray", "--profile", "bed/capture.toml"),
        ):
            yield "toml made", what, "bed/capture.toml", words, written("bed/capture.toml", data, "bed", "plants")
    deep = b"#usda 1.0\n" + b'def Xform "a" {\n' * 20_000 + b"}\n" * 20_000
    for words in (("info", "deep.usda"), ("validate", "deep.usda"), ("edit", "deep.usda", "--width", "2", "-o", "out.usda")):
        yield "usd made", "deep prims", "deep.usda", words, written("deep.usda", lambda: deep)
    for what, data in (
        ("a zip of nothing", lambda: b"PK\x05\x06" + bytes(18)),
        ("a broken zip", lambda: b"PK\x03\x04" + b"\xff" * 300),
        ("no zip", lambda: b"no zip"),
    ):
        for command in ("info", "validate"):
            yield "usd made", what, "a.usdz", (command, "a.usdz"), written("a.usdz", data)
    for name in ("photo", "cloud", "toml"):

        def prepare(folder: Path, name: str = name) -> None:
            shutil.copytree(seeds / name, folder / name)

        for command in ("info", "validate", "crown", "branches", "leaves", "capture"):
            more = () if command in ("info", "validate") else ("-o", "out")
            yield "a wrong folder", f"{command} {name}", "", (command, name, *more), prepare
