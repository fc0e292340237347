"""Scenes whose pictures can be computed by hand, written as USD files."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, Vt

# Linear colours of the cube's faces, named by the direction they face in a Y-up stage.
CUBE_COLORS = {
    "+X": (0.8, 0.0, 0.0),
    "-X": (0.0, 0.6, 0.6),
    "+Y": (0.0, 0.7, 0.0),
    "-Y": (0.6, 0.0, 0.6),
    "+Z": (0.0, 0.0, 0.9),
    "-Z": (0.18, 0.18, 0.18),
}
_NORMALS = {"+X": (1, 0, 0), "-X": (-1, 0, 0), "+Y": (0, 1, 0), "-Y": (0, -1, 0), "+Z": (0, 0, 1), "-Z": (0, 0, -1)}


def new_stage(path: Path, z_up: bool = False) -> Usd.Stage:
    """An empty stage in metres with the default prim /Thing."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z if z_up else UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/Thing").GetPrim())
    return stage


def define_mesh(stage: Usd.Stage, path: str, points: NDArray, faces: NDArray) -> UsdGeom.Mesh:
    """A polygon mesh with its extent; faces (F, 4)."""
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(np.asarray(points, np.float32)))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(faces), 4, np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(np.asarray(faces, np.int32).ravel()))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(mesh.GetPointsAttr().Get()))
    return mesh


def bind_surface(mesh: UsdGeom.Mesh, **inputs: tuple[float, float, float] | float) -> UsdShade.Shader:
    """Bind a UsdPreviewSurface of these inputs (colours or numbers) to the mesh."""
    stage, path = mesh.GetPrim().GetStage(), str(mesh.GetPath()) + "Material"
    material = UsdShade.Material.Define(stage, path)
    shader = UsdShade.Shader.Define(stage, path + "/Surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    for name, value in inputs.items():
        if isinstance(value, tuple):
            shader.CreateInput(name, Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*value))
        else:
            shader.CreateInput(name, Sdf.ValueTypeNames.Float).Set(value)
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)
    return shader


def write_cube(path: Path, z_up: bool = False) -> None:
    """A unit-sided cube about (3, 1, -2) whose faces glow in CUBE_COLORS and reflect nothing; with two cameras."""
    stage = new_stage(path, z_up)
    middle = np.array([3.0, 1.0, -2.0])
    for number, (name, normal) in enumerate(_NORMALS.items()):
        n = np.array(normal, float)
        a = np.roll(n, 1) * (1 if n.sum() > 0 else -1)
        b = np.cross(n, a)
        points = middle + 0.5 * np.array([n - a - b, n + a - b, n + a + b, n - a + b])
        mesh = define_mesh(stage, f"/Thing/Face{number}", points, np.array([[0, 1, 2, 3]]))
        black = (0.0, 0.0, 0.0)
        bind_surface(mesh, diffuseColor=black, emissiveColor=CUBE_COLORS[name], ior=1.0, roughness=1.0)
    camera = Gf.Camera()
    camera.transform = Gf.Matrix4d().SetTranslate(Gf.Vec3d(3, 1, 4))
    UsdGeom.Camera.Define(stage, "/Thing/Straight").SetFromCamera(camera, Usd.TimeCode.Default())
    camera.transform = Gf.Matrix4d().SetTranslate(Gf.Vec3d(3, 1, -40))
    UsdGeom.Camera.Define(stage, "/Thing/Away").SetFromCamera(camera, Usd.TimeCode.Default())
    stage.Save()


def write_ball(path: Path, radius_m: float, center_m: tuple[float, float, float], rings: int = 96) -> None:
    """A smooth white ball, matte."""
    stage = new_stage(path)
    polar, turn = np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, 2 * rings, endpoint=False)
    flat, round_ = np.cos(polar), np.sin(polar)
    unit = np.stack(
        [np.outer(round_, np.sin(turn)), np.outer(flat, np.ones_like(turn)), np.outer(round_, np.cos(turn))], axis=-1
    )
    index = np.arange(unit.size // 3).reshape(unit.shape[:2])
    after = np.roll(index, -1, axis=1)
    faces = np.stack([index[:-1], index[1:], after[1:], after[:-1]], axis=-1).reshape(-1, 4)
    normals = unit.reshape(-1, 3)
    mesh = define_mesh(stage, "/Thing/Ball", normals * radius_m + np.array(center_m), faces)
    mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(normals.astype(np.float32)))
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    bind_surface(mesh, diffuseColor=(1.0, 1.0, 1.0), roughness=0.9)
    stage.Save()


def write_square(path: Path) -> None:
    """A grey square of a metre in the plane z = 0, as small a scene as there is."""
    stage = new_stage(path)
    points = np.array([(-0.5, -0.5, 0), (0.5, -0.5, 0), (0.5, 0.5, 0), (-0.5, 0.5, 0)])
    mesh = define_mesh(stage, "/Thing/Square", points, np.array([[0, 1, 2, 3]]))
    mesh.CreateDisplayColorAttr([(0.5, 0.5, 0.5)])
    mesh.CreateDoubleSidedAttr(True)
    stage.Save()
