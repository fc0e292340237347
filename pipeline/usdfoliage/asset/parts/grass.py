"""Blades of grass near the camera of a shot: a PointInstancer of clumps.

It has no FoliageForestAPI: its instances are no plants of the forest, and are not counted as such.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, Vt

from usdfoliage.asset.layer import bind_material, export_layer, new_layer
from usdfoliage.asset.materials.grass import TINT
from usdfoliage.asset.materials.layer import GRASS_MATERIAL
from usdfoliage.asset.parts.instancers import author_turns
from usdfoliage.forest.grass_clump import GrassClump

GRASS = "grass"  # below the root prim
OPEN_SKY = "openSky"  # primvar, a number an instance
ALONG, SHADE = "along", "shade"  # primvars, a number a point


@dataclass(frozen=True, kw_only=True, eq=False)
class GrassPrim:
    """Clumps (N,) of some forms."""

    forms: Sequence[GrassClump]
    form: NDArray[np.int32]  # (N,)
    position_m: NDArray[np.float64]  # (N, 3), in the asset's frame
    orientation: NDArray[np.float64]  # (N, 4), unit quaternions, real part first
    scale: NDArray[np.float64]  # (N, 3)
    tint: NDArray[np.float64]  # (N, 3), linear
    open_sky: NDArray[np.float64]  # (N,), the part of the sky's light that plants leave, 0 to 1

    def __len__(self) -> int:
        return len(self.form)

    def take(self, own: NDArray[np.integer]) -> "GrassPrim":
        """Some clumps (K,) of it, in that order."""
        return replace(
            self,
            form=self.form[own],
            position_m=self.position_m[own],
            orientation=self.orientation[own],
            scale=self.scale[own],
            tint=self.tint[own],
            open_sky=self.open_sky[own],
        )

    @property
    def extent_m(self) -> NDArray[np.float64]:
        """(2, 3) around all clumps, however they are turned."""
        far = np.array([np.abs(each.points).max(axis=0) for each in self.forms])[self.form]
        reach_m = np.linalg.norm(far * self.scale, axis=1)[:, None]
        return np.stack([(self.position_m - reach_m).min(axis=0), (self.position_m + reach_m).max(axis=0)])


def write_grass_layer(path: Path, name: str, grass: GrassPrim) -> None:
    """Write clumps of grass at /name/grass; there is at least one.

    Raises:
        WriteError: The file cannot be written.
    """
    stage = new_layer(path, name)
    author_grass(stage, Sdf.Path(f"/{name}/{GRASS}"), grass)
    export_layer(stage, path)


def author_grass(stage: Usd.Stage, path: Sdf.Path, grass: GrassPrim) -> UsdGeom.PointInstancer:
    """Define the instancer of grass at path, below the root prim."""
    instancer = UsdGeom.PointInstancer.Define(stage, path)
    holder = path.AppendChild("Prototypes")
    UsdGeom.Scope.Define(stage, holder)
    material = path.GetPrefixes()[0].AppendPath(GRASS_MATERIAL)
    targets = []
    for number, form in enumerate(grass.forms):
        targets.append(holder.AppendChild(f"Clump_{number + 1}"))
        _author_form(stage, targets[-1], form, material)
    instancer.CreatePrototypesRel().SetTargets(targets)
    instancer.CreateProtoIndicesAttr(Vt.IntArray.FromNumpy(grass.form.astype(np.int32)))
    instancer.CreatePositionsAttr(Vt.Vec3fArray.FromNumpy(grass.position_m.astype(np.float32)))
    instancer.CreateScalesAttr(Vt.Vec3fArray.FromNumpy(grass.scale.astype(np.float32)))
    author_turns(instancer, np.roll(grass.orientation, -1, axis=1))
    instancer.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(grass.extent_m.astype(np.float32)))
    primvars, types = UsdGeom.PrimvarsAPI(instancer), Sdf.ValueTypeNames
    tint = primvars.CreatePrimvar(TINT, types.Color3fArray, UsdGeom.Tokens.varying)
    tint.Set(Vt.Vec3fArray.FromNumpy(grass.tint.astype(np.float32)))
    # The picture of it, which the ground has, is as fine.
    _author_numbers(instancer, OPEN_SKY, np.rint(255 * grass.open_sky) / 255, UsdGeom.Tokens.varying)
    return instancer


def _author_form(stage: Usd.Stage, path: Sdf.Path, form: GrassClump, material: Sdf.Path) -> None:
    """The mesh of a clump."""
    mesh = UsdGeom.Mesh.Define(stage, path)
    points = form.points.astype(np.float32)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(form.face_counts.astype(np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(form.face_indices.astype(np.int32)))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateDoubleSidedAttr(True)
    mesh.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(np.stack([points.min(axis=0), points.max(axis=0)])))
    mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(form.normals.astype(np.float32)))
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    _author_numbers(mesh, ALONG, form.along, UsdGeom.Tokens.vertex)
    _author_numbers(mesh, SHADE, form.shade, UsdGeom.Tokens.vertex)
    bind_material(stage, path, material)


def _author_numbers(prim: UsdGeom.Imageable, name: str, values: NDArray[np.float64], interpolation: str) -> None:
    """A primvar of numbers (N,) of which many are equal."""
    primvar = UsdGeom.PrimvarsAPI(prim).CreatePrimvar(name, Sdf.ValueTypeNames.FloatArray, interpolation)
    different, index = np.unique(values.astype(np.float32), return_inverse=True)
    primvar.Set(Vt.FloatArray.FromNumpy(different))
    primvar.SetIndices(Vt.IntArray.FromNumpy(index.astype(np.int32)))
