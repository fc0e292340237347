"""Grounds, plants and flights that forests are measured with."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rasterio
from numpy.typing import NDArray
from pxr import Gf, Usd, UsdGeom

WEST, NORTH = 455_000.0, 4_670_000.0
Row = tuple[str, float, float, float]  # species, share, lowest and tallest in metres


def write_inputs(
    folder: Path, crown: Path, rows: Sequence[Row], heights_m: NDArray[np.float64], cell_m: float, plants: int
) -> list[str]:
    """A DEM of heights (N, N), so many trunks at random and plants.toml; returns the arguments of usdfoliage forest."""
    cells = len(heights_m)
    side_m = cells * cell_m
    transform = rasterio.transform.from_origin(WEST, NORTH, cell_m, cell_m)
    profile = {"height": cells, "width": cells, "count": 1, "dtype": "float32", "crs": "EPSG:25831"}
    with rasterio.open(folder / "dem.tif", "w", driver="GTiff", transform=transform, **profile) as file:
        file.write(heights_m.astype(np.float32), 1)
    places = np.array([WEST, NORTH - side_m]) + np.random.default_rng(0).uniform(cell_m, side_m - cell_m, (plants, 2))
    np.savetxt(folder / "trunks.csv", places, fmt="%.2f", delimiter=",")
    text = [
        f'[[plant]]\nspecies = "{name}"\nkind = "tree"\nasset = "{crown.resolve()}"\n'
        f"share = {share}\nheight_m = [{low}, {high}]\n"
        for name, share, low, high in rows
    ]
    (folder / "plants.toml").write_text("\n".join(text), encoding="utf-8")
    return [str(folder / "dem.tif"), "--plants", str(folder / "plants.toml"), "--trunks", str(folder / "trunks.csv")]


def write_flight(
    path: Path, begin_m: Sequence[float], end_m: Sequence[float], look: Sequence[float], frames: int
) -> Path:
    """A camera on a straight way that looks in one direction, in the frame of a forest: Y up, north to -Z."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, "Y")
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetStartTimeCode(1)
    stage.SetEndTimeCode(frames)
    camera = UsdGeom.Camera.Define(stage, "/cam")
    camera.CreateFocalLengthAttr(24.0)
    camera.CreateHorizontalApertureAttr(36.0)
    camera.CreateVerticalApertureAttr(24.0)
    place = camera.AddTransformOp()
    for frame in range(1, frames + 1):
        share = (frame - 1) / max(frames - 1, 1)
        eye = Gf.Vec3d(*((1 - share) * np.asarray(begin_m, float) + share * np.asarray(end_m, float)).tolist())
        view = Gf.Matrix4d().SetLookAt(eye, eye + Gf.Vec3d(*look), Gf.Vec3d(0, 1, 0))
        place.Set(view.GetInverse(), frame)
    stage.GetRootLayer().Save()
    return path
