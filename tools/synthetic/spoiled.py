"""Captures that are spoiled in one way each, as they come from the field; everything else is as in a good one.

Truth is that of the good capture: of leaves that move, the place at rest.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from usdfoliage.capture.view import View
from usdfoliage.geometry.color import decode_srgb, encode_srgb

from tools.synthetic.depth import LEAF, WOOD, SeenDepth, see_depth
from tools.synthetic.files import write_cameras, write_depth, write_picture, write_truth
from tools.synthetic.scene import Scene, SceneSettings, build_scene
from tools.synthetic.shading import light_scene, photograph
from tools.synthetic.truth import UP_AXES, describe_leaves

MOVED_LEAVES, SWAY_RAD = 0.5, 0.3  # share of the leaves that move; standard deviation of the turn about their base
EXPOSURES, WHITE_BALANCE = (0.5, 1.8), 0.15  # factors; standard deviation of the logarithm of a channel's own factor
BLURRED, BLUR_PX = 3, 3.0  # every so many photographs one is blurred; standard deviation
CUT = 0.55  # of the picture's width, that is missing on the left
SHIFT = 0.08  # of the picture's width, by which masks lie beside the plant
FARTHER = 0.85  # of the focal length, so that no border cuts what is to be whole
WIDER = 5  # pixels by which good masks are wider than the plant

Picture = NDArray[np.uint8]


@dataclass(frozen=True, kw_only=True, eq=False)
class SpoiledCapture:
    """Views with exact depth, as it is where nothing moved, and the truth."""

    views: tuple[View, ...]
    seen: tuple[SeenDepth, ...]
    truth: Mapping[str, NDArray[np.generic]]  # the arrays of truth/leaves.npz


SMALL = SceneSettings(leaves=36, views=8, width_px=440, height_px=330)


@dataclass(frozen=True, kw_only=True)
class SpoilSettings:
    """What is captured, and what is wrong with it."""

    kind: str = "good"  # one of KINDS
    scene: SceneSettings = field(default_factory=lambda: SMALL)

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"kind must be one of {', '.join(KINDS)}, not {self.kind}")


def spoil_capture(settings: SpoilSettings) -> SpoiledCapture:
    """See a scene from all its cameras, and spoil what is seen; the same settings give the same capture."""
    scene = build_scene(settings.scene)
    if settings.kind == "two plants":
        scene = _part_in_two(scene)
    cameras = [
        replace(camera, focal_px=(FARTHER * camera.focal_px[0], FARTHER * camera.focal_px[1]))
        for camera in scene.cameras
    ]
    if settings.kind == "cut by the border":
        cut_px = round(CUT * settings.scene.width_px)
        cameras = [
            replace(
                camera,
                width_px=camera.width_px - cut_px,
                center_px=(camera.center_px[0] - cut_px, camera.center_px[1]),
            )
            for camera in cameras
        ]
    light = light_scene(scene, settings.scene.seed)
    spoil_picture, spoil_mask = _PICTURES.get(settings.kind), _MASKS.get(settings.kind)
    views, seen = [], []
    for number, camera in enumerate(cameras):
        rng = np.random.default_rng((settings.scene.seed, 2, number))
        spoiling = np.random.default_rng((settings.scene.seed, 5, number))
        exact = see_depth(scene, camera)
        moved = move_leaves(scene, spoiling) if settings.kind == "moving leaves" else scene
        srgb = photograph(moved, light, camera, rng)
        mask = None
        if spoil_mask is not None:
            side = 2 * WIDER + 1
            plant = np.isin(exact.label, (WOOD, LEAF)).astype(np.uint8)
            mask = spoil_mask(cv2.dilate(plant, np.ones((side, side), np.uint8)) > 0)
        views.append(
            View(
                name=f"{number:03d}.jpg",
                camera=camera,
                srgb=srgb if spoil_picture is None else spoil_picture(srgb, number, spoiling),
                depth_m=exact.depth_m,
                mask=mask,
            )
        )
        seen.append(exact)
    return SpoiledCapture(views=tuple(views), seen=tuple(seen), truth=describe_leaves(scene, seen, UP_AXES["Y"]))


def write_spoiled(folder: Path, capture: SpoiledCapture) -> None:
    """Write a capture folder; depth/ is exact, for whoever measures.

    Raises:
        OSError: It cannot be written.
    """
    for name in ("images", "depth"):
        (folder / name).mkdir(parents=True)
    for view in capture.views:
        write_picture(folder / "images" / view.name, view.srgb)
        write_depth(folder / "depth" / Path(view.name).with_suffix(".exr").name, view.depth_m)
        if view.mask is not None:
            (folder / "masks").mkdir(exist_ok=True)
            write_picture(folder / "masks" / Path(view.name).with_suffix(".png").name, view.mask.astype(np.uint8) * 255)
    write_cameras(folder / "cameras", capture.views, np.random.default_rng(3))
    (folder / "capture.toml").write_text('metres_per_unit = 1.0\nup_axis = "Y"\n')
    ids = {view.name: seen.leaf_id for view, seen in zip(capture.views, capture.seen, strict=True)}
    labels = {view.name: seen.label for view, seen in zip(capture.views, capture.seen, strict=True)}
    write_truth(folder / "truth", capture.truth, ids, labels, "made by tools/synthetic/spoiled.py\n")


def move_leaves(scene: Scene, rng: np.random.Generator) -> Scene:
    """The scene with some leaves turned about their bases: always the same ones, by other angles each time."""
    count, vertices = len(scene.leaves), scene.vertices_a_leaf
    moves = np.random.default_rng(0).permutation(count) < round(MOVED_LEAVES * count)
    turns = Rotation.from_rotvec(rng.normal(0, SWAY_RAD, (count, 3)) * moves[:, None]).as_matrix()
    blades = count * vertices
    base_m = scene.leaves.base_m[:, None]
    points_m = scene.points_m[:blades].reshape(count, vertices, 3) - base_m
    normals = scene.normals[:blades].reshape(count, vertices, 3)
    turned_m = np.einsum("nij,nvj->nvi", turns, points_m) + base_m
    return replace(
        scene,
        points_m=np.concatenate([turned_m.reshape(-1, 3), scene.points_m[blades:]]),
        normals=np.concatenate([np.einsum("nij,nvj->nvi", turns, normals).reshape(-1, 3), scene.normals[blades:]]),
    )


def _part_in_two(scene: Scene) -> Scene:
    """The scene with its right half moved aside, so that two plants stand in the pictures."""
    length_m = float(np.median(scene.leaves.length_m))
    middle_m = float(np.median(scene.leaves.base_m[:, 0]))
    aside_m = np.array([2.0 * length_m, 0.0, 0.0])
    right = scene.leaves.base_m[:, 0] > middle_m
    blades = len(right) * scene.vertices_a_leaf
    moved = np.concatenate([np.repeat(right, scene.vertices_a_leaf), scene.points_m[blades:, 0] > middle_m])
    return replace(
        scene,
        leaves=replace(scene.leaves, base_m=scene.leaves.base_m + right[:, None] * aside_m - aside_m / 2),
        points_m=scene.points_m + moved[:, None] * aside_m - aside_m / 2,
    )


def _expose(srgb: Picture, number: int, rng: np.random.Generator) -> Picture:
    factor = np.exp(rng.uniform(*np.log(EXPOSURES)) + rng.normal(0, WHITE_BALANCE, 3))
    linear = decode_srgb(srgb.astype(np.float64) / 255) * factor
    return np.asarray(np.rint(255 * encode_srgb(np.clip(linear, 0, 1))), np.uint8)


def _blur(srgb: Picture, number: int, rng: np.random.Generator) -> Picture:
    return srgb if number % BLURRED else np.asarray(cv2.GaussianBlur(srgb, (0, 0), BLUR_PX), np.uint8)


_PICTURES: Mapping[str, Callable[[Picture, int, np.random.Generator], Picture]] = {
    "other exposures": _expose,
    "blurred photographs": _blur,
}
_MASKS: Mapping[str, Callable[[NDArray[np.bool_]], NDArray[np.bool_]]] = {
    "good masks": lambda mask: mask,
    "masks shifted": lambda mask: np.roll(mask, round(SHIFT * mask.shape[1]), axis=1),
    "masks inverted": lambda mask: ~mask,
    "masks empty": np.zeros_like,
    "masks of everything": np.ones_like,
}
KINDS = ("good", "moving leaves", "two plants", "cut by the border", *_PICTURES, *_MASKS)
