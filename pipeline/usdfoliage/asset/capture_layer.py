"""A capture as a USD layer: its cameras, the photographs behind them, and the cloud that was made of them.

The layer is in metres and in the axes of the capture's own world, Y or Z up, as its upAxis states; nothing is turned
but a world in which neither is up.
Nobody but a plant's asset gives the Scope /<name>/geo/guide the purpose of its name: alone, the layer would be blank.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Kind, Sdf, Tf, Usd, UsdGeom, UsdShade, Vt

from usdfoliage.asset.layer import author_scopes, export_layer, new_layer
from usdfoliage.asset.publish_file import publish_written
from usdfoliage.capture.cloud.model import Cloud
from usdfoliage.capture.cloud_files.ply import fits_single
from usdfoliage.capture.cloud_files.spacing import point_widths
from usdfoliage.capture.lens import Lens, undistort_places
from usdfoliage.geometry.color import decode_srgb
from usdfoliage.geometry.pinhole import Pinhole

CAMERAS = "geo/guide/Cameras"  # below the root prim
CLOUD = "geo/guide/Cloud"
MATERIALS = "mtl"
IMAGE_PLANE = "ImagePlane"  # below each camera, in the variant "on" of the set "imagePlane"

_FILM_M = 0.036  # longer side of a film frame: only its ratio to the focal length is known
_TENTHS = 10.0  # USD counts film and focal length in tenths of the stage's unit
_BEHIND = 1.05  # how far behind the farthest point an image plane stands
_NEAR = 0.5  # of the nearest point's depth, where the picture begins
_MIN_NEAR = 1e-4  # of the farthest depth: a depth buffer does not resolve a longer range
_PLANE_CELLS = 48  # along the longer side of an image plane whose lens distorts
_WIDEST = 10.0  # tangent of the angle from the axis up to which there is a plane
_FEW = 20_000  # points of the cloud from which its distance to a camera is measured


@dataclass(frozen=True, kw_only=True)
class CaptureCamera:
    """A photograph and where it was taken."""

    name: str  # of the photograph's file, below images/
    photo: str  # the file, as seen from the layer's folder
    camera: Pinhole  # in the capture's world
    lens: Lens | None = None  # of the photograph as it was taken; None where that has no distortion


@dataclass(frozen=True, kw_only=True, eq=False)
class CaptureLayerSettings:
    """How a capture is shown."""

    up_axis: str = "Y"  # of the capture's world, Y or Z; of the layer, where asset_from_world turns it
    # (4, 4) for column vectors: turns the root prim, where neither Y nor Z is up in the capture's world.
    asset_from_world: NDArray[np.float64] | None = None
    point_width_m: float | None = None  # of the cloud's points; None: so wide that neighbours touch

    def __post_init__(self) -> None:
        if self.up_axis not in ("Y", "Z"):
            raise ValueError(f"up_axis must be Y or Z, not {self.up_axis!r}")
        if self.point_width_m is not None and not (np.isfinite(self.point_width_m) and self.point_width_m > 0):
            raise ValueError(f"point_width_m must be above 0, not {self.point_width_m}")


def write_capture_layer(
    path: Path,
    cameras: Sequence[CaptureCamera],
    cloud: Cloud,
    name: str = "capture",
    settings: CaptureLayerSettings = CaptureLayerSettings(),
) -> None:
    """Write path, text, and beside it <stem>_cloud.usdc, the cloud, which it loads as a payload.

    Every photograph is a UsdGeomCamera at /<name>/geo/guide/Cameras. The photograph itself stands behind the cloud once
    the camera's variant imagePlane is "on", placed where its lens showed it, so that it needs no undistortion; and it
    is named by UsdGeomBackPlateAPI for applications that know that. The cloud is at /<name>/geo/guide/Cloud.

    Args:
        path: The layer, .usda. Both files are replaced when they exist.
        cameras: Of the registered photographs.
        cloud: In the same world.
        name: Of the root prim.
        settings: How it is shown.

    Raises:
        ValueError: A path of a photograph is absolute, or name is no name of a prim.
        WriteError: A file cannot be written.
    """
    if not Sdf.Path.IsValidIdentifier(name):
        raise ValueError(f"name must be the name of a prim, not {name!r}")
    for captured in cameras:
        if Path(captured.photo).is_absolute():
            raise ValueError(f"photographs are named as seen from the layer's folder, not {captured.photo}")
    payload = path.with_name(f"{path.stem}_cloud.usdc")
    stage = _new_stage(payload, name, settings)
    bounds = None
    if len(cloud):
        if settings.point_width_m is None:
            widths_m = point_widths(cloud.points_m, [captured.camera for captured in cameras])
        else:
            # A width for each point, though all are equal: from a single one USD and its validators compute no extent.
            widths_m = np.full(len(cloud), settings.point_width_m, np.float32)
        points = author_cloud(stage, Sdf.Path(f"/{name}/{CLOUD}"), cloud, widths_m)
        bounds = UsdGeom.BBoxCache(Usd.TimeCode.Default(), ["default"]).ComputeWorldBound(points.GetPrim())
    publish_written(payload, lambda new: export_layer(stage, new))

    stage = _new_stage(path, name, settings)
    root = stage.GetDefaultPrim()
    if settings.asset_from_world is not None:
        turn = UsdGeom.Xformable(root).AddTransformOp(UsdGeom.XformOp.PrecisionDouble)
        turn.Set(Gf.Matrix4d(settings.asset_from_world.T.tolist()))
    Usd.ModelAPI(root).SetKind(Kind.Tokens.component)
    Usd.ModelAPI(root).SetAssetName(name)
    author_scopes(stage, Sdf.Path(f"/{name}/{CAMERAS}"))
    author_scopes(stage, Sdf.Path(f"/{name}/{MATERIALS}"))
    some = cloud.points_m[:: max(1, len(cloud) // _FEW)]
    taken: set[str] = set()
    for captured in cameras:
        prim_path = Sdf.Path(f"/{name}/{CAMERAS}").AppendChild(_prim_name(captured.name, taken))
        author_camera(stage, prim_path, captured, depth_range(captured.camera, some, [c.camera for c in cameras]))
    if bounds is not None:
        prim = stage.OverridePrim(f"/{name}/{CLOUD}")
        prim.GetPayloads().AddPayload(f"./{payload.name}", prim.GetPath())
        author_unlit(stage, Sdf.Path(f"/{name}/{MATERIALS}/Cloud"), "displayColor")
        UsdShade.MaterialBindingAPI.Apply(prim).Bind(UsdShade.Material.Get(stage, f"/{name}/{MATERIALS}/Cloud"))
        box = bounds.ComputeAlignedRange()
        hint = Vt.Vec3fArray([Gf.Vec3f(box.GetMin()), Gf.Vec3f(box.GetMax())])
        UsdGeom.ModelAPI.Apply(root).SetExtentsHint(hint)
    publish_written(path, lambda new: export_layer(stage, new))


def author_camera(
    stage: Usd.Stage, path: Sdf.Path, captured: CaptureCamera, depths_m: tuple[float, float, float]
) -> UsdGeom.Camera:
    """Define the camera of a photograph at path, and below it the photograph, off until the variant is chosen.

    Args:
        depths_m: Of what it shows: the nearest, the middle and the farthest.
    """
    pinhole = captured.camera
    camera = UsdGeom.Camera.Define(stage, path)
    prim = camera.GetPrim()
    prim.SetDisplayName(captured.name)
    camera.AddTransformOp(UsdGeom.XformOp.PrecisionDouble).Set(world_from_camera(pinhole))
    camera.CreateProjectionAttr(UsdGeom.Tokens.perspective)
    # A pixel is as wide as makes the longer side of the picture that of a film frame; its height follows the lens.
    size = np.array([pinhole.width_px, pinhole.height_px], np.float64)
    focal, center = np.array(pinhole.focal_px), np.array(pinhole.center_px)
    length_m = _FILM_M / max(size / focal)
    aperture = size / focal * length_m * _TENTHS
    offset = (size / 2 - center) / focal * (1, -1) * length_m * _TENTHS + 0.0  # y of pixels is down, that of cameras up
    camera.CreateFocalLengthAttr(length_m * _TENTHS)
    camera.CreateHorizontalApertureAttr(float(aperture[0]))
    camera.CreateVerticalApertureAttr(float(aperture[1]))
    camera.CreateHorizontalApertureOffsetAttr(float(offset[0]))
    camera.CreateVerticalApertureOffsetAttr(float(offset[1]))
    nearest_m, middle_m, farthest_m = depths_m
    plane_m = _BEHIND * farthest_m
    far_m = _BEHIND * plane_m
    camera.CreateClippingRangeAttr(Gf.Vec2f(max(_NEAR * nearest_m, _MIN_NEAR * far_m), far_m))
    camera.CreateFocusDistanceAttr(middle_m)
    camera.CreateFStopAttr(0.0)  # no depth of field

    plate = UsdGeom.BackPlateAPI.Apply(prim, "photograph")
    plate.CreateImageAttr(Sdf.AssetPath(_anchored(captured.photo)))
    plate.CreatePlateVisibilityAttr("mute")  # as it would stand amid the plant, at the focus
    variants = prim.GetVariantSets().AddVariantSet("imagePlane")
    for variant in ("off", "on"):
        variants.AddVariant(variant)
    variants.SetVariantSelection("on")
    with variants.GetVariantEditContext():
        author_image_plane(stage, path.AppendChild(IMAGE_PLANE), captured, plane_m)
    variants.SetVariantSelection("off")
    return camera


def author_image_plane(stage: Usd.Stage, path: Sdf.Path, captured: CaptureCamera, depth_m: float) -> UsdGeom.Mesh:
    """Define the photograph as a mesh at path, in the axes of its camera, at a depth, and its material below.

    Of a lens that distorts, the mesh is a grid: its corners stand where the camera without distortion sees them.
    """
    pinhole, lens = captured.camera, captured.lens
    size = np.array([pinhole.width_px, pinhole.height_px], np.float64)
    cells = np.ones(2, np.int64)
    if lens is not None and not lens.is_pinhole:
        cells = np.maximum(np.rint(_PLANE_CELLS * size / size.max()), 2).astype(np.int64)
    across, down = np.meshgrid(np.linspace(0, 1, cells[0] + 1), np.linspace(0, 1, cells[1] + 1))
    share = np.column_stack([across.ravel(), down.ravel()])
    places = share * size if lens is None else undistort_places(lens, share * size)
    flat = (places - pinhole.center_px) / pinhole.focal_px
    # Where a wide lens sees past what a pinhole camera can, there is no plane.
    good = np.asarray((np.abs(flat) < _WIDEST).all(axis=1))  # False for NaN
    number = np.arange(len(share)).reshape(cells[1] + 1, cells[0] + 1)
    faces = np.stack([number[1:, :-1], number[1:, 1:], number[:-1, 1:], number[:-1, :-1]], -1).reshape(-1, 4)
    faces = faces[good[faces].all(axis=1)]
    used, faces = np.unique(faces, return_inverse=True)
    points = np.column_stack([flat[used] * (1, -1), -np.ones(len(used))]) * depth_m

    mesh = UsdGeom.Mesh.Define(stage, path)
    corner_points = Vt.Vec3fArray.FromNumpy(points.astype(np.float32))
    mesh.CreatePointsAttr(corner_points)
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray([4] * (faces.size // 4)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(faces.ravel().astype(np.int32)))
    mesh.CreateNormalsAttr(Vt.Vec3fArray([Gf.Vec3f(0, 0, 1)] * len(used)))
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateDoubleSidedAttr(False)  # so that it hides nothing from other cameras, most of which see its back
    mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(corner_points))
    st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex)
    st.Set(Vt.Vec2fArray.FromNumpy(np.column_stack([share[used, 0], 1 - share[used, 1]]).astype(np.float32)))
    material = author_unlit(stage, path.AppendChild("Photograph"), "st", captured.photo)
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)
    return mesh


def author_cloud(stage: Usd.Stage, path: Sdf.Path, cloud: Cloud, widths_m: NDArray[np.float32]) -> UsdGeom.Points:
    """Define the cloud at path: places, normals, linear colours, and of each point its confidence and number of views.

    Far from the origin the places are counted from the cloud's middle, since float32 would not hold them.

    Args:
        widths_m: (N,), of its points.
    """
    author_scopes(stage, path.GetParentPath())
    points = UsdGeom.Points.Define(stage, path)
    places_m = cloud.points_m
    if not fits_single(places_m):
        middle_m = np.rint((places_m.min(axis=0) + places_m.max(axis=0)) / 2)
        points.AddTranslateOp().Set(Gf.Vec3d(*middle_m.tolist()))
        places_m = places_m - middle_m
    array = Vt.Vec3fArray.FromNumpy(places_m.astype(np.float32))
    points.CreatePointsAttr(array)
    widths = Vt.FloatArray.FromNumpy(widths_m)
    points.CreateWidthsAttr(widths)
    points.SetWidthsInterpolation(UsdGeom.Tokens.vertex)
    points.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(cloud.normals, np.float32)))
    points.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    points.CreateExtentAttr(UsdGeom.Points.ComputeExtent(array, widths))
    primvars = UsdGeom.PrimvarsAPI(points)
    color = primvars.CreatePrimvar("displayColor", Sdf.ValueTypeNames.Color3fArray, UsdGeom.Tokens.vertex)
    table = decode_srgb(np.arange(256, dtype=np.float32) / np.float32(255)).astype(np.float32)
    color.Set(Vt.Vec3fArray.FromNumpy(table[cloud.srgb]))
    confidence = primvars.CreatePrimvar("confidence", Sdf.ValueTypeNames.FloatArray, UsdGeom.Tokens.vertex)
    confidence.Set(Vt.FloatArray.FromNumpy(np.ascontiguousarray(cloud.confidence, np.float32)))
    views = primvars.CreatePrimvar("views", Sdf.ValueTypeNames.IntArray, UsdGeom.Tokens.vertex)
    views.Set(Vt.IntArray.FromNumpy(np.ascontiguousarray(cloud.views, np.int32)))
    return points


def author_unlit(stage: Usd.Stage, path: Sdf.Path, primvar: str, photo: str = "") -> UsdShade.Material:
    """Define a material that shows what was photographed as it is: the light of the day is in it already.

    Args:
        primvar: Of the colour; or, with a photograph, of its st.
        photo: As seen from the layer's folder.
    """
    material = UsdShade.Material.Define(stage, path)
    reader = UsdShade.Shader.Define(stage, path.AppendChild("Reader"))
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set(primvar)
    surface = UsdShade.Shader.Define(stage, path.AppendChild("Surface"))
    surface.CreateIdAttr("UsdPreviewSurface")
    black = Gf.Vec3f(0)
    surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(black)
    surface.CreateInput("useSpecularWorkflow", Sdf.ValueTypeNames.Int).Set(1)
    surface.CreateInput("specularColor", Sdf.ValueTypeNames.Color3f).Set(black)
    surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(1.0)
    emission = surface.CreateInput("emissiveColor", Sdf.ValueTypeNames.Color3f)
    if photo:
        reader.CreateIdAttr("UsdPrimvarReader_float2")
        reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
        texture = UsdShade.Shader.Define(stage, path.AppendChild("Texture"))
        texture.CreateIdAttr("UsdUVTexture")
        texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(Sdf.AssetPath(_anchored(photo)))
        space = "raw" if photo.lower().endswith(".exr") else "sRGB"
        texture.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set(space)
        for wrap in ("wrapS", "wrapT"):
            texture.CreateInput(wrap, Sdf.ValueTypeNames.Token).Set("clamp")
        texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(reader.ConnectableAPI(), "result")
        texture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
        emission.ConnectToSource(texture.ConnectableAPI(), "rgb")
    else:
        reader.CreateIdAttr("UsdPrimvarReader_float3")
        reader.CreateOutput("result", Sdf.ValueTypeNames.Float3)
        emission.ConnectToSource(reader.ConnectableAPI(), "result")
    surface.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    material.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    return material


def world_from_camera(pinhole: Pinhole) -> Gf.Matrix4d:
    """Where a USD camera stands, for row vectors: it looks along -Z with Y up, a pinhole camera along Z with Y down."""
    matrix = np.eye(4)
    matrix[:3, :3] = np.diag([1.0, -1, -1]) @ pinhole.cam_from_world[:, :3]
    matrix[3, :3] = pinhole.position_m
    return Gf.Matrix4d(matrix.tolist())


def depth_range(
    pinhole: Pinhole, points_m: NDArray[np.float64], others: Sequence[Pinhole]
) -> tuple[float, float, float]:
    """Nearest, middle and farthest depth of the points (N, 3) that a camera has in its picture.

    Where it has none: ten times as far as the next camera is, or 1 m, as the middle.
    """
    places, depth_m = pinhole.project(points_m)
    with np.errstate(invalid="ignore"):
        seen = np.all((places >= 0) & (places <= (pinhole.width_px, pinhole.height_px)), axis=1) & (depth_m > 0)
    if seen.any():
        nearest, middle, farthest = np.quantile(depth_m[seen], (0, 0.5, 1))
        return float(nearest), float(middle), float(farthest)
    apart = [float(np.linalg.norm(other.position_m - pinhole.position_m)) for other in others]
    middle = 10 * min((away for away in apart if away > 0), default=0.1)
    return middle / 10, middle, middle * 10


def _prim_name(photo: str, taken: set[str]) -> str:
    """A name for the camera of a photograph that no other has."""
    stem = str(Path(photo).with_suffix(""))
    wanted = name = Tf.MakeValidIdentifier(stem if stem[:1].isalpha() else f"view_{stem}")
    number = 2
    while name.lower() in taken:
        name = f"{wanted}_{number}"
        number += 1
    taken.add(name.lower())
    return name


def _anchored(photo: str) -> str:
    """So written that it counts from the layer's folder, whatever search paths there are."""
    return photo if photo.startswith(".") else f"./{photo}"


def _new_stage(path: Path, name: str, settings: CaptureLayerSettings) -> Usd.Stage:
    stage = new_layer(path, name)
    UsdGeom.SetStageUpAxis(stage, settings.up_axis)
    return stage
