"""Stages of leaves for Storm: the same leaves as an instancer with our shader and as a finely divided mesh."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade
from usdfoliage.asset.layer import bind_material
from usdfoliage.asset.materials.leaf import LeafMaterial, author_leaf_material
from usdfoliage.asset.parts.leaf_gprims import author_leaf_mesh
from usdfoliage.asset.parts.leaves import PROTOTYPE, author_leaves, edited_leaves, leaves_prim
from usdfoliage.asset.resources import resource_folder
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.edits import NEUTRAL, LeafEdits
from usdfoliage.leaf.shape.jitter import NO_JITTER, Jitter, spread_phases
from usdfoliage.leaf.shape.mesh import LeafMeshSettings, PrototypeSettings, build_leaf_mesh
from usdfoliage.leaf.shape.variation import vary_leaves

SHADERS = str(resource_folder("usd_plugins/usdFoliageShaders"))
COLOR = (0.06, 0.14, 0.03)
FINE = LeafMeshSettings(across=24, along=64, silhouette=512)

# Every edit at once, none of them small.
EDITED = LeafEdits(
    width=1.3,
    axis1=(0.08, 0.02, 0.05),
    axis2=(-0.1, -0.03, 0.12),
    silhouette1=(0.04, 0.05, 0.02),
    silhouette2=(-0.05, -0.04, 0.03),
    silhouette3=(0.02, 0.06, -0.05),
    curl=(0.03, -0.04, 0.08),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """Leaves, and how they are changed."""

    leaves: Leaves
    edits: LeafEdits = NEUTRAL
    jitter_map: Path | None = None

    def jitter(self) -> Jitter:
        wave = None if self.jitter_map is None else JITTER_WAVE
        return Jitter(amplitude=self.edits.jitter_amplitude, frequency=self.edits.jitter_frequency, map=wave)


JITTER_WAVE = np.float64([-1.0, -0.4, 0.2, 0.6, 1.0, 0.1, -0.8, 0.5])  # uneven, so that a shift shows


def one_leaf(parameters) -> Leaves:
    """A leaf of length 1 at the origin."""
    return Leaves(
        parameters=np.float64([parameters]),
        base_m=np.zeros((1, 3)),
        orientation=np.float64([[0, 0, 0, 1]]),
        length_m=np.ones(1),
        phase=np.zeros(1),
    )


def heap(count=12) -> Leaves:
    """Leaves of several lengths, turned at random, that cover each other."""
    rng = np.random.default_rng(5)
    turns = rng.normal(size=(count, 4))
    return Leaves(
        parameters=vary_leaves(count, rng),
        base_m=rng.uniform((-0.5, -0.1, -0.5), (0.5, 0.6, 0.5), (count, 3)),
        orientation=turns / np.linalg.norm(turns, axis=1, keepdims=True),
        length_m=rng.uniform(0.4, 0.9, count),
        phase=spread_phases(count) + 5.0,
    )


def new_stage(path: Path) -> Usd.Stage:
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    return stage


def author_instancer(
    stage,
    path,
    scene: Scene,
    material: UsdShade.Material,
    prototype: PrototypeSettings = PrototypeSettings(across=12, along=64, silhouette=512),
) -> UsdGeom.PointInstancer:
    """The representation bezier, as an asset has it."""
    wave = "" if scene.jitter_map is None else str(scene.jitter_map)
    prim = leaves_prim(scene.leaves, scene.edits, scene.jitter(), COLOR, wave, prototype)
    instancer = author_leaves(stage, Sdf.Path(path), prim)
    bind_material(stage, instancer.GetPath().AppendPath(PROTOTYPE), material.GetPath())
    return instancer


def author_baked(stage, path, scene: Scene, material: UsdShade.Material) -> UsdGeom.Mesh:
    """The same leaves as one mesh."""
    drawn = edited_leaves(scene.leaves, scene.edits)
    jitter = scene.jitter() if scene.edits.jitter_amplitude else NO_JITTER
    mesh = author_leaf_mesh(stage, Sdf.Path(path), build_leaf_mesh(drawn, FINE, jitter), COLOR)
    bind_material(stage, mesh.GetPath(), material.GetPath())
    return mesh


def author_material(stage, path, **fields) -> UsdShade.Material:
    return author_leaf_material(stage, Sdf.Path(path), LeafMaterial(shaders=SHADERS, **fields))


def move(stage, path, x: float) -> None:
    UsdGeom.XformCommonAPI(UsdGeom.Xform.Define(stage, path)).SetTranslate(Gf.Vec3d(x, 0, 0))
