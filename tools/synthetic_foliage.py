#!/usr/bin/env python3
"""A capture of known leaves: posed photographs with depth, and which leaf stands where.

usage: tools/synthetic_foliage.py OUT [--leaves 400] [--views 10] [--size 1200 900] [--length 0.07] [--scale 1] …
       tools/synthetic_foliage.py --help       all options

Shoots of leaves as `usdfoliage scatter` varies them stand in a bed before a wall; the cameras stand on an arc before
them. OUT is a capture folder: images/, cameras/ (COLMAP text), depth/ (exact), depth_noisy/ (in place of depth/ it
makes a harder capture), capture.toml, and truth/, which the product never reads.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from usdfoliage.capture.view import View

from tools.synthetic.depth import NoiseSettings, SeenDepth, degrade_depth, see_depth
from tools.synthetic.files import write_cameras, write_depth, write_picture, write_truth
from tools.synthetic.scene import SceneSettings, build_scene
from tools.synthetic.shading import light_scene, photograph
from tools.synthetic.truth import UP_AXES, describe_leaves

README = """# {name}: ground truth
{count} leaves of mean length {length:g} m, seed {seed}, made by tools/synthetic_foliage.py.

leaves.npz: id (from 1), base, apex, length (m, of the axis), chord (m, |apex - base|), width (m), transform (4 x 4,
leaf frame at the base to world: x = axis' tangent, y = lateral, z = upper normal), visible_pixels (leaves x views),
vertices, vertex_offset, faces (numbers within each leaf), face_offset; and parameters (21 of each leaf, 7 x 3),
orientation (x, y, z, w, world from leaf space), with base and chord the leaf exactly.
NNN_leafid.png: 16 bit, 0 none, k the leaf of id k at the pixel's centre. NNN_label.png: 0 sky, 1 wood, 2 leaf, 3 ground
and wall. depth/: exact, of the triangles of leaves.npz. depth_noisy/: noise of {noise:g} pixel footprints, outliers,
holes beside edges. Up axis: {up}.
"""


@dataclass(frozen=True, kw_only=True)
class CaptureSettings:
    """What is captured, and how."""

    scene: SceneSettings = field(default_factory=SceneSettings)
    noise: NoiseSettings = field(default_factory=NoiseSettings)
    up_axis: str = "Y"
    samples: int = 2  # rays a pixel of the photographs, along either side

    def __post_init__(self) -> None:
        if self.up_axis not in UP_AXES:
            raise ValueError(f"up_axis must be one of {', '.join(UP_AXES)}, not {self.up_axis}")
        if self.samples < 1:
            raise ValueError(f"samples must be 1 or more, not {self.samples}")


@dataclass(frozen=True, kw_only=True, eq=False)
class SyntheticCapture:
    """A capture and its truth, in the capture's frame."""

    settings: CaptureSettings
    views: Sequence[View]  # with exact depth
    noisy_depth_m: Sequence[NDArray[np.float32]]  # (H, W) a view
    seen: Sequence[SeenDepth]  # one a view
    truth: Mapping[str, NDArray[np.generic]]  # the arrays of truth/leaves.npz

    def noisy_views(self) -> list[View]:
        """The views with degraded depth."""
        pairs = zip(self.views, self.noisy_depth_m, strict=True)
        return [replace(view, depth_m=depth_m) for view, depth_m in pairs]


def make_capture(settings: CaptureSettings = CaptureSettings()) -> SyntheticCapture:
    """Grow a scene and see it from all its cameras; the same settings give the same capture."""
    scene = build_scene(settings.scene)
    light = light_scene(scene, settings.scene.seed)
    capture_from_scene = UP_AXES[settings.up_axis]
    views, noisy, seen = [], [], []
    for number, camera in enumerate(scene.cameras):
        rng = np.random.default_rng((settings.scene.seed, 2, number))
        exact = see_depth(scene, camera)
        pose = camera.cam_from_world.copy()
        pose[:, :3] = pose[:, :3] @ capture_from_scene.T
        views.append(
            View(
                name=f"{number:03d}.jpg",
                camera=replace(camera, cam_from_world=pose),
                srgb=photograph(scene, light, camera, rng, settings.samples),
                depth_m=exact.depth_m,
            )
        )
        noisy.append(degrade_depth(exact.depth_m, camera.focal_px[0], rng, settings.noise))
        seen.append(exact)
    return SyntheticCapture(
        settings=settings,
        views=views,
        noisy_depth_m=noisy,
        seen=seen,
        truth=describe_leaves(scene, seen, capture_from_scene),
    )


def write_capture(folder: Path, capture: SyntheticCapture) -> None:
    """Write the capture folder.

    Raises:
        FileExistsError: The folder is there and not empty.
        OSError: It cannot be written.
    """
    if folder.exists() and any(folder.iterdir()):
        raise FileExistsError(f"{folder} is not empty")
    settings = capture.settings
    for name in ("images", "depth", "depth_noisy"):
        (folder / name).mkdir(parents=True)
    for view, noisy_m in zip(capture.views, capture.noisy_depth_m, strict=True):
        write_picture(folder / "images" / view.name, view.srgb)
        depth_name = Path(view.name).with_suffix(".exr").name
        write_depth(folder / "depth" / depth_name, view.depth_m)
        write_depth(folder / "depth_noisy" / depth_name, noisy_m)
    write_cameras(folder / "cameras", capture.views, np.random.default_rng((settings.scene.seed, 3)))
    (folder / "capture.toml").write_text(
        f'name = "{folder.name}"\nmetres_per_unit = 1.0\nup_axis = "{settings.up_axis}"\n'
        'note = "synthetic foliage; depth/ is exact, depth_noisy/ a degraded copy"\n'
    )
    write_truth(
        folder / "truth",
        capture.truth,
        {view.name: seen.leaf_id for view, seen in zip(capture.views, capture.seen, strict=True)},
        {view.name: seen.label for view, seen in zip(capture.views, capture.seen, strict=True)},
        README.format(
            name=folder.name,
            count=settings.scene.leaves,
            length=settings.scene.length_m,
            seed=settings.scene.seed,
            noise=settings.noise.sigma,
            up=settings.up_axis,
        ),
    )


def main() -> int:
    scene, noise = SceneSettings(), NoiseSettings()
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("output", type=Path, help="capture folder, new or empty")
    parser.add_argument("--leaves", type=int, default=scene.leaves)
    parser.add_argument("--views", type=int, default=scene.views)
    parser.add_argument("--size", type=int, nargs=2, default=[scene.width_px, scene.height_px], metavar=("W", "H"))
    parser.add_argument("--length", type=float, default=scene.length_m, help="of a leaf, on average, in metres")
    parser.add_argument("--scale", type=float, default=1.0, help="of the whole scene")
    parser.add_argument("--width", type=float, default=scene.width, help="of leaves, to the default width")
    parser.add_argument("--variation", type=float, default=scene.variation, help="0 all leaves equal; 2 wild ones")
    parser.add_argument("--framed", type=int, default=scene.framed_leaves, help="leaves that a view shows, about")
    parser.add_argument("--no-wall", action="store_true", help="sky behind the leaves")
    parser.add_argument("--noise", type=float, default=noise.sigma, help="of depth_noisy/, in pixel footprints")
    parser.add_argument("--up", choices=list(UP_AXES), default="Y")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    if options.output.exists() and (not options.output.is_dir() or any(options.output.iterdir())):
        parser.error(f"{options.output} is not empty; name another folder")
    settings = CaptureSettings(
        scene=SceneSettings(
            leaves=options.leaves,
            views=options.views,
            width_px=options.size[0],
            height_px=options.size[1],
            length_m=options.length * options.scale,
            width=options.width,
            variation=options.variation,
            framed_leaves=options.framed,
            wall=not options.no_wall,
            seed=options.seed,
        ),
        noise=NoiseSettings(sigma=options.noise),
        up_axis=options.up,
    )
    write_capture(options.output, make_capture(settings))
    return 0


if __name__ == "__main__":
    sys.exit(main())
