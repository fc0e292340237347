"""The light of a picture: that of the stage, else a soft sky and one key light over the camera's left shoulder.

Lights are authored in the stage's edit target, below PREVIEW_ROOT.
"""

PREVIEW_ROOT = "/UsdfoliagePreview"

# Chosen so that white that faces the key light comes out just below 1 and is not below 0.2 anywhere. (Storm scales a
# distant light's intensity down by some thousands.)
KEY_INTENSITY = 1000.0
KEY_ELEVATION_DEG = 35.0  # above and to the left of the camera's view
KEY_AZIMUTH_DEG = 35.0


def has_lights(stage) -> bool:
    from pxr import UsdLux

    return any(prim.HasAPI(UsdLux.LightAPI) for prim in stage.Traverse())


def author_sky(stage, z_up: bool, dome_texture: str) -> None:
    """A sky above the stage's ground, of a latitude-longitude picture."""
    from pxr import Gf, Sdf, UsdLux

    dome = UsdLux.DomeLight.Define(stage, Sdf.Path(PREVIEW_ROOT).AppendChild("Dome"))
    dome.CreateTextureFileAttr(dome_texture)
    dome.CreateTextureFormatAttr(UsdLux.Tokens.latlong)
    dome.CreateIntensityAttr(1.0)
    dome.MakeMatrixXform().Set(Gf.Matrix4d().SetRotate(Gf.Rotation(Gf.Vec3d.XAxis(), 90.0 if z_up else 0.0)))


def author_key(stage, camera) -> None:
    """The key light of a camera, as if the asset turned before a fixed one."""
    from pxr import Gf, Sdf, UsdGeom, UsdLux

    path = Sdf.Path(PREVIEW_ROOT).AppendChild("Key")
    prim = stage.GetPrimAtPath(path)
    turn = Gf.Rotation(Gf.Vec3d.XAxis(), -KEY_ELEVATION_DEG) * Gf.Rotation(Gf.Vec3d.YAxis(), -KEY_AZIMUTH_DEG)
    matrix = Gf.Matrix4d().SetRotate(turn) * camera.transform.RemoveScaleShear()
    if prim:  # only moved: a viewer does so with every step of the mouse
        UsdGeom.Xformable(prim).GetOrderedXformOps()[0].Set(matrix)
        return
    key = UsdLux.DistantLight.Define(stage, path)
    key.CreateIntensityAttr(KEY_INTENSITY)
    key.CreateAngleAttr(2.0)
    key.MakeMatrixXform().Set(matrix)


def author_lights(stage, camera, z_up: bool, dome_texture: str) -> None:
    """Sky and key light."""
    author_sky(stage, z_up, dome_texture)
    author_key(stage, camera)
