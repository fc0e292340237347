"""A small forest to plant, and shots over it."""

from pathlib import Path

import numpy as np
from pxr import Gf, Usd, UsdGeom
from usdfoliage.asset.packages.leaf_package import write_crown_asset
from usdfoliage.asset.provenance import Provenance

from tests.support.forests.scene import forest_scene, write_forest_files
from tests.support.plant_assets import round_crown

PLAIN = Provenance(capture="crown.jpg", generator="test", seed=0, input_sha256="0")
FRAMES = 24
PATH_M = np.linspace(60, -20, FRAMES)


def write_shot(path, eyes_m, rate=24.0, towards=(0.0, -0.3, -1.0)):
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, "Y")
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetStartTimeCode(1001)
    stage.SetEndTimeCode(1000 + len(eyes_m))
    stage.SetTimeCodesPerSecond(rate)
    camera = UsdGeom.Camera.Define(stage, "/cam")
    camera.CreateFocalLengthAttr(30.0)
    place = camera.AddTransformOp()
    for number, eye_m in enumerate(eyes_m):
        eye = Gf.Vec3d(*map(float, eye_m))
        view = Gf.Matrix4d().SetLookAt(eye, eye + Gf.Vec3d(*towards), Gf.Vec3d(0, 1, 0))
        place.Set(view.GetInverse(), 1001 + number)
    stage.GetRootLayer().Save()
    return path


def drawn_at(instancer: UsdGeom.PointInstancer, frame: float) -> set[int]:
    hidden = set(instancer.GetInvisibleIdsAttr().Get(frame) or ())
    return set(instancer.GetIdsAttr().Get()) - hidden


def forest_words(folder: Path) -> list[str]:
    """Write the rasters, the plants and the asset of a forest into folder; the words of usdfoliage that plant it."""
    (folder / "oak").mkdir()
    write_crown_asset(folder / "oak", "oak", round_crown(), PLAIN)
    files = write_forest_files(folder, forest_scene())
    options = [f"--{name}={files[name]}" for name in files if name != "dem"]
    return ["forest", str(files["dem"]), *options, "--no-preview", "--reproducible"]
