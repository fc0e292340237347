#!/usr/bin/env python3
"""A capture of a whole plant that never stood: photographs from all around, their cameras, and what is true.

usage: tools/synthetic_plant.py OUT [--views 24] [--size 480 640] [--leaves 240] [--height 1.4] [--seed 0] [--masks] …
       tools/synthetic_plant.py --help       all options

A young tree with three orders of branches on bare soil before a plain sky, for usdfoliage build. OUT is a capture
folder: images/, cameras/ (COLMAP text), capture.toml, masks/ if asked for, and truth/, which the product never reads.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from usdfoliage.capture.view import View

from tools.synthetic.depth import LEAF, WOOD, SeenDepth, see_depth
from tools.synthetic.files import write_cameras, write_depth, write_picture
from tools.synthetic.plant import Plant, PlantSettings, build_plant
from tools.synthetic.shading import light_scene, photograph
from tools.synthetic.truth import UP_AXES, describe_leaves

TRUE_DEPTHS = 4  # views whose exact depth is written
README = """# {name}: ground truth
A plant {height:g} m high with {count} leaves, seed {seed}, made by tools/synthetic_plant.py. In the capture's frame,
{up} up, in metres.

skeleton.npz: points, radius (V), counts, parent_curve, parent_vertex, order (B): one polyline a branch, each after its
parent; the first point of a branch repeats the vertex of its parent.
leaves.npz: as that of tools/synthetic_foliage.py, and branch, the number of the branch that each leaf stands on.
depth/NNN.exr: along the optical axis, exact, of the triangles that were drawn. NNN_label.png: 0 sky, 1 wood, 2 leaf,
3 ground, of the same views.
"""


@dataclass(frozen=True, kw_only=True)
class PlantCaptureSettings:
    """What is captured, and how."""

    plant: PlantSettings = field(default_factory=PlantSettings)
    up_axis: str = "Z"
    masks: bool = False
    samples: int = 2  # rays a pixel of the photographs, along either side

    def __post_init__(self) -> None:
        if self.up_axis not in UP_AXES:
            raise ValueError(f"up_axis must be one of {', '.join(UP_AXES)}, not {self.up_axis}")
        if self.samples < 1:
            raise ValueError(f"samples must be 1 or more, not {self.samples}")


@dataclass(frozen=True, kw_only=True, eq=False)
class PlantCapture:
    """A capture and its truth."""

    settings: PlantCaptureSettings
    plant: Plant  # Y up
    views: Sequence[View]  # in the capture's frame, with exact depth
    seen: Sequence[SeenDepth]  # one a view


def make_plant_capture(settings: PlantCaptureSettings = PlantCaptureSettings()) -> PlantCapture:
    """Grow a plant and see it from all its cameras; the same settings give the same capture."""
    plant = build_plant(settings.plant)
    light = light_scene(plant.scene, settings.plant.seed)
    capture_from_scene = UP_AXES[settings.up_axis]
    views, seen = [], []
    for number, camera in enumerate(plant.scene.cameras):
        rng = np.random.default_rng((settings.plant.seed, 5, number))
        exact = see_depth(plant.scene, camera)
        pose = camera.cam_from_world.copy()
        pose[:, :3] = pose[:, :3] @ capture_from_scene.T
        views.append(
            View(
                name=f"{number:03d}.jpg",
                camera=replace(camera, cam_from_world=pose),
                srgb=photograph(plant.scene, light, camera, rng, settings.samples),
                depth_m=exact.depth_m,
            )
        )
        seen.append(exact)
    return PlantCapture(settings=settings, plant=plant, views=views, seen=seen)


def write_plant_capture(folder: Path, capture: PlantCapture) -> None:
    """Write the capture folder.

    Raises:
        FileExistsError: The folder is there and not empty.
        OSError: It cannot be written.
    """
    if folder.exists() and any(folder.iterdir()):
        raise FileExistsError(f"{folder} is not empty")
    settings = capture.settings
    for name in ("images", *["masks"] * settings.masks):
        (folder / name).mkdir(parents=True)
    for view, seen in zip(capture.views, capture.seen, strict=True):
        write_picture(folder / "images" / view.name, view.srgb)
        if settings.masks:
            plant = np.isin(seen.label, (WOOD, LEAF))
            write_picture(folder / "masks" / Path(view.name).with_suffix(".png").name, np.uint8(255) * plant)
    write_cameras(folder / "cameras", capture.views, np.random.default_rng((settings.plant.seed, 6)))
    (folder / "capture.toml").write_text(
        f'name = "{folder.name}"\nmetres_per_unit = 1.0\nup_axis = "{settings.up_axis}"\n'
        'note = "a synthetic plant; truth/ is not for the product"\n'
    )
    _write_truth(folder / "truth", capture, folder.name)


def _write_truth(folder: Path, capture: PlantCapture, name: str) -> None:
    settings, plant = capture.settings, capture.plant
    capture_from_scene = UP_AXES[settings.up_axis]
    (folder / "depth").mkdir(parents=True)
    skeleton = plant.skeleton
    np.savez_compressed(
        folder / "skeleton.npz",
        points=skeleton.points_m @ capture_from_scene.T,
        radius=skeleton.radius_m,
        counts=skeleton.counts,
        parent_curve=skeleton.parent_curve,
        parent_vertex=skeleton.parent_vertex,
        order=skeleton.order,
    )
    leaves = describe_leaves(plant.scene, capture.seen, capture_from_scene)
    np.savez_compressed(folder / "leaves.npz", **leaves, branch=plant.branch)
    chosen = np.unique(np.arange(TRUE_DEPTHS) * len(capture.views) // TRUE_DEPTHS)
    for number in chosen.tolist():
        stem = Path(capture.views[number].name).stem
        write_depth(folder / "depth" / f"{stem}.exr", capture.views[number].depth_m)
        write_picture(folder / f"{stem}_label.png", capture.seen[number].label)
    (folder / "README.md").write_text(
        README.format(
            name=name,
            height=settings.plant.height_m,
            count=len(plant.scene.leaves),
            seed=settings.plant.seed,
            up=settings.up_axis,
        )
    )


def main() -> int:
    plant, capture = PlantSettings(), PlantCaptureSettings()
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("output", type=Path, help="capture folder, new or empty")
    parser.add_argument("--views", type=int, default=plant.views)
    parser.add_argument("--size", type=int, nargs=2, default=[plant.width_px, plant.height_px], metavar=("W", "H"))
    parser.add_argument("--leaves", type=int, default=plant.leaves, help="at most")
    parser.add_argument("--height", type=float, default=plant.height_m, help="of the plant, in metres")
    parser.add_argument("--masks", action="store_true", help="write masks/, the plant white")
    parser.add_argument("--up", choices=list(UP_AXES), default=capture.up_axis)
    parser.add_argument("--seed", type=int, default=plant.seed)
    options = parser.parse_args()
    if options.output.exists() and (not options.output.is_dir() or any(options.output.iterdir())):
        parser.error(f"{options.output} is not empty; name another folder")
    settings = PlantCaptureSettings(
        plant=PlantSettings(
            height_m=options.height,
            leaves=options.leaves,
            views=options.views,
            width_px=options.size[0],
            height_px=options.size[1],
            seed=options.seed,
        ),
        up_axis=options.up,
        masks=options.masks,
    )
    write_plant_capture(options.output, make_plant_capture(settings))
    print(options.output)
    return 0


if __name__ == "__main__":
    sys.exit(main())
