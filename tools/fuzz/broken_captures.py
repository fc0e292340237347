"""What can be wrong with a capture: broken photographs among good ones, masks and depth of other sizes, cameras."""

import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import OpenImageIO as oiio

from tools.fuzz.mutations import make_empty, make_folder, make_loop, make_noise, make_pipe, make_text

Damage = Callable[[Path], None]


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
    values = ["1", "0", "0", "0", "nan", "0", "0"]
    _edit("images.txt", lambda lines: [lines[0], _poses(lines[1], values), *lines[2:]])(bed)


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
PHOTOGRAPHS: tuple[Damage, ...] = (mix_broken_photographs, make_all_broken, make_twin_names, make_odd_photographs)
