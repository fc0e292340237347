"""The ground of a forest as a mesh."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, UsdGeom, Vt

from usdfoliage.asset.layer import bind_material, export_layer, new_layer
from usdfoliage.asset.materials.layer import GROUND_MATERIAL

TERRAIN = "terrain"  # below the root prim


@dataclass(frozen=True, kw_only=True, eq=False)
class TerrainPrim:
    """What is authored of the ground."""

    points_m: NDArray[np.float64]  # (V, 3), in the asset's frame
    faces: NDArray[np.int32]  # (F, 4)
    st: NDArray[np.float64]  # (V, 2)

    @property
    def extent_m(self) -> NDArray[np.float64]:
        """(2, 3), smallest and largest corner."""
        return np.stack([self.points_m.min(axis=0), self.points_m.max(axis=0)])


def write_terrain_layer(path: Path, name: str, terrain: TerrainPrim) -> None:
    """Write the ground at /name/terrain.

    Raises:
        WriteError: The file cannot be written.
    """
    stage = new_layer(path, name)
    mesh = UsdGeom.Mesh.Define(stage, Sdf.Path(f"/{name}/{TERRAIN}"))
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(terrain.points_m.astype(np.float32)))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray(len(terrain.faces), 4))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(terrain.faces.reshape(-1).astype(np.int32)))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(terrain.extent_m.astype(np.float32)))
    normals = vertex_normals(terrain.points_m, terrain.faces)
    mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(normals.astype(np.float32)))
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    primvars = UsdGeom.PrimvarsAPI(mesh)
    st = primvars.CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex)
    st.Set(Vt.Vec2fArray.FromNumpy(terrain.st.astype(np.float32)))
    bind_material(stage, mesh.GetPath(), Sdf.Path(f"/{name}/{GROUND_MATERIAL}"))
    export_layer(stage, path)


def vertex_normals(points_m: NDArray[np.float64], faces: NDArray[np.integer]) -> NDArray[np.float64]:
    """(V, 3) unit normals of a mesh of quads, the mean of the faces around by their area."""
    corners_m = points_m[faces]
    face = np.cross(corners_m[:, 2] - corners_m[:, 0], corners_m[:, 3] - corners_m[:, 1])
    normal = np.zeros_like(points_m)
    for corner in range(4):
        np.add.at(normal, faces[:, corner], face)
    return normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
