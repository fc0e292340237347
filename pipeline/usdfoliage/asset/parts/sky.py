"""The light of a forest: a dome light of a picture of the sky, and a distant light for the sun."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenEXR
from numpy.typing import NDArray
from pxr import Gf, Sdf, UsdGeom, UsdLux

from usdfoliage.asset.layer import export_layer, new_layer
from usdfoliage.asset.materials.cubemap_exr import REC709_CHROMATICITIES
from usdfoliage.files.open_exr import write_open_exr

SKY = "sky"  # below the root prim


@dataclass(frozen=True, kw_only=True, eq=False)
class SkyPrim:
    """What is authored of the light."""

    picture: str  # as seen from the layer's folder
    to_sun: NDArray[np.float64]  # (3,), a unit vector in the asset's frame
    sun_irradiance: NDArray[np.float64]  # (3,) linear Rec.709, on a surface that faces the sun
    sun_width_deg: float


def write_sky_picture(path: Path, radiance: NDArray[np.floating]) -> None:
    """Write radiance (H, 2 H, 3), linear Rec.709, as a latitude-longitude picture in half precision.

    Raises:
        WriteError: The file cannot be written.
    """
    header = {
        "envmap": OpenEXR.ENVMAP_LATLONG,
        "colorInteropID": "lin_rec709_scene",
        "chromaticities": REC709_CHROMATICITIES,
    }
    write_open_exr(path, header, {"RGB": radiance.astype(np.float16)})


def write_sky_layer(path: Path, name: str, sky: SkyPrim) -> None:
    """Write both lights at /name/sky.

    Raises:
        WriteError: The file cannot be written.
    """
    stage = new_layer(path, name)
    root = UsdGeom.Xform.Define(stage, Sdf.Path(f"/{name}/{SKY}")).GetPath()
    dome = UsdLux.DomeLight.Define(stage, root.AppendChild("Dome"))
    dome.CreateTextureFileAttr(Sdf.AssetPath(sky.picture))
    dome.CreateTextureFormatAttr(UsdLux.Tokens.latlong)
    dome.CreateIntensityAttr(1.0)
    sun = UsdLux.DistantLight.Define(stage, root.AppendChild("Sun"))
    strongest = float(sky.sun_irradiance.max())
    half_rad = np.radians(sky.sun_width_deg) / 2
    sun.CreateAngleAttr(sky.sun_width_deg)
    sun.CreateIntensityAttr(strongest / float(np.pi * np.sin(half_rad) ** 2))  # a light's radiance
    sun.CreateColorAttr(Gf.Vec3f(*(sky.sun_irradiance / strongest).tolist()))
    # It shines along -Z of its own.
    turn = Gf.Rotation(Gf.Vec3d.ZAxis(), Gf.Vec3d(*sky.to_sun.tolist()))
    sun.AddTransformOp().Set(Gf.Matrix4d().SetRotate(turn))
    export_layer(stage, path)
