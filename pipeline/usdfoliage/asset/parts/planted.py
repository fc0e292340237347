"""The plants of a forest: a PointInstancer with FoliageForestAPI for each level of detail."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Kind, Sdf, Usd, UsdGeom, Vt

from usdfoliage.asset.layer import NO_TIMES, author_times, bind_material, export_layer, new_layer
from usdfoliage.asset.materials.bark import BARK_COLOR
from usdfoliage.asset.materials.layer import BARK_MATERIAL
from usdfoliage.asset.parts.crown import FORM
from usdfoliage.asset.parts.crown_leaves import OtherLeaves, author_other_leaves
from usdfoliage.asset.parts.instancers import author_turns
from usdfoliage.asset.plant import CROWN_HOLDER
from usdfoliage.asset.schema import FOREST_API

PLANTS = "plants"  # below the root prim
TRUNK_SIDES, TRUNK_RINGS = 8, 5
TRUNK_TAPER = 0.5  # of its radius, that a trunk is thick at its top
TRUNK_BEND = 0.04  # of its height, that it is bent by


@dataclass(frozen=True, kw_only=True, eq=False)
class ForestPrototype:
    """One prototype of an instancer, with its row of the species table."""

    name: str  # of its prim, an identifier
    species: str
    kind: str
    share: float
    scale_range: tuple[float, float]
    reference: str  # the asset, as seen from the layer's folder
    selections: Mapping[str, str]
    crown_form: str  # variant of its crown; empty for the default one
    asset_to_meters: float  # unit of the asset
    is_z_up: bool
    raised_m: float = 0.0  # by which its crown stands on a trunk
    trunk_m: tuple[float, float] | None = None  # height and radius of that trunk
    extent_m: NDArray[np.float64]  # (2, 3), with the trunk
    leaves: OtherLeaves | None = None  # of its crown, where these are not its own


@dataclass(frozen=True, kw_only=True, eq=False)
class HiddenPlants:
    """Plants of a level that are not drawn from a frame on, until the next one."""

    frame: float  # time code
    ids: NDArray[np.int64]  # (K,)


@dataclass(frozen=True, kw_only=True, eq=False)
class PlantedLevel:
    """Plants (N,) that are drawn in one form."""

    name: str  # of the instancer's prim, and of the level
    prototypes: Sequence[ForestPrototype]
    prototype: NDArray[np.int32]  # (N,)
    ids: NDArray[np.int64]  # (N,)
    position_m: NDArray[np.float64]  # (N, 3), in the asset's frame
    orientation: NDArray[np.float64]  # (N, 4), unit quaternions, real part first
    scale: NDArray[np.float64]  # (N, 3)
    tint: NDArray[np.float64]  # (N, 3), linear
    jitter: NDArray[np.float64]  # (N,)
    seed: int
    lod_distance_m: tuple[float, float]
    orthophoto: str = ""  # as seen from the layer's folder
    orthophoto_bounds_m: tuple[float, float, float, float] = (0.0, 0.0, 1.0, 1.0)  # least x and z, greatest x and z
    hidden: Sequence[HiddenPlants] = ()  # by rising frame, where that changes

    def take(self, own: NDArray[np.integer]) -> "PlantedLevel":
        """Some plants (K,) of it, in that order."""
        ids = self.ids[own]
        hidden = [replace(each, ids=each.ids[np.isin(each.ids, ids)]) for each in self.hidden]
        changes = [
            number == 0 or not np.array_equal(each.ids, hidden[number - 1].ids) for number, each in enumerate(hidden)
        ]
        kept = tuple(itertools.compress(hidden, changes))
        return replace(
            self,
            prototype=self.prototype[own],
            ids=ids,
            position_m=self.position_m[own],
            orientation=self.orientation[own],
            scale=self.scale[own],
            tint=self.tint[own],
            jitter=self.jitter[own],
            hidden=kept if len(kept) > 1 or (kept and len(kept[0].ids)) else (),
        )

    @property
    def extent_m(self) -> NDArray[np.float64]:
        """(2, 3) around all plants as they are turned."""
        boxes_m = np.array([each.extent_m for each in self.prototypes]).reshape(-1, 2, 3)[self.prototype]
        aside_m = np.linalg.norm(np.abs(boxes_m[..., [0, 2]]).max(axis=1) * self.scale[:, [0, 2]], axis=1)
        low_m, high_m = (boxes_m[:, end, 1] * self.scale[:, 1] for end in (0, 1))
        # By how much each leans, whatever its turn: the vertical part of where its own Y axis points.
        _, x, _, z = self.orientation.T
        upright = 1 - 2 * (x * x + z * z)
        lean = np.sqrt(np.maximum(1 - upright**2, 0.0))
        tall_m = np.maximum(np.abs(low_m), np.abs(high_m))
        reach_m = np.column_stack([aside_m + lean * tall_m, lean * aside_m, aside_m + lean * tall_m])
        lowest_m, highest_m = self.position_m - reach_m, self.position_m + reach_m
        lowest_m[:, 1] += np.minimum(low_m, 0.0)
        highest_m[:, 1] += high_m
        return np.stack([lowest_m.min(axis=0), highest_m.max(axis=0)])


def write_planted_layer(
    path: Path, name: str, levels: Sequence[PlantedLevel], times: Mapping[str, float] = NO_TIMES
) -> None:
    """Write the plants of levels at /name/plants/<level>.

    Args:
        path: Of the layer.
        name: Of the root prim.
        levels: One, or those among which plants change in a shot.
        times: The range of time of a shot, as metadata of the layer.

    Raises:
        WriteError: The file cannot be written.
    """
    stage = new_layer(path, name)
    author_times(stage, times)
    group = UsdGeom.Xform.Define(stage, Sdf.Path(f"/{name}/{PLANTS}"))
    Usd.ModelAPI(group).SetKind(Kind.Tokens.group)
    for level in levels:
        _author_level(stage, group.GetPath().AppendChild(level.name), level, name)
    export_layer(stage, path)


def _author_level(stage: Usd.Stage, root: Sdf.Path, level: PlantedLevel, name: str) -> None:
    """The instancer of a level."""
    instancer = UsdGeom.PointInstancer.Define(stage, root)
    prim = instancer.GetPrim()
    holder = root.AppendChild("Prototypes")
    for model in (prim, UsdGeom.Scope.Define(stage, holder).GetPrim()):
        Usd.ModelAPI(model).SetKind(Kind.Tokens.group)  # the assets below are components
    targets = [_author_prototype(stage, holder, each, name) for each in level.prototypes]
    instancer.CreatePrototypesRel().SetTargets(targets)
    instancer.CreateProtoIndicesAttr(Vt.IntArray.FromNumpy(level.prototype.astype(np.int32)))
    instancer.CreateIdsAttr(Vt.Int64Array.FromNumpy(level.ids.astype(np.int64)))
    instancer.CreatePositionsAttr(Vt.Vec3fArray.FromNumpy(level.position_m.astype(np.float32)))
    instancer.CreateScalesAttr(Vt.Vec3fArray.FromNumpy(level.scale.astype(np.float32)))
    author_turns(instancer, np.roll(level.orientation, -1, axis=1))
    if len(level.ids):
        instancer.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(level.extent_m.astype(np.float32)))
        # An array of none has wrong indices to some validators.
        _author_tint(prim, level)
    for hidden in level.hidden:
        ids = Vt.Int64Array.FromNumpy(hidden.ids.astype(np.int64))
        instancer.CreateInvisibleIdsAttr().Set(ids, hidden.frame)
    _author_forest(prim, level)


def _author_tint(prim: Usd.Prim, level: PlantedLevel) -> None:
    tint = UsdGeom.PrimvarsAPI(prim).CreatePrimvar("tint", Sdf.ValueTypeNames.Color3fArray, UsdGeom.Tokens.varying)
    tint.Set(Vt.Vec3fArray.FromNumpy(level.tint.astype(np.float32)))


def _author_forest(prim: Usd.Prim, level: PlantedLevel) -> None:
    """The species table, and what else FoliageForestAPI has."""
    prim.AddAppliedSchema(FOREST_API)
    types = Sdf.ValueTypeNames
    rows = level.prototypes
    ranges = np.array([each.scale_range for each in rows], np.float32).reshape(-1, 2)
    facts = [
        ("species", types.StringArray, [each.species for each in rows]),
        ("speciesKind", types.TokenArray, [each.kind for each in rows]),
        ("speciesShare", types.FloatArray, [each.share for each in rows]),
        ("speciesScale", types.Float2Array, Vt.Vec2fArray.FromNumpy(ranges)),
        ("seed", types.Int64, level.seed),
        ("lodJitter", types.FloatArray, Vt.FloatArray.FromNumpy(level.jitter.astype(np.float32))),
        ("lodDistance", types.Float2, Gf.Vec2f(*level.lod_distance_m)),
    ]
    if level.orthophoto:
        facts += [
            ("orthophoto", types.Asset, Sdf.AssetPath(level.orthophoto)),
            ("orthophotoBounds", types.Float4, Gf.Vec4f(*level.orthophoto_bounds_m)),
        ]
    for attribute, value_type, value in facts:
        prim.CreateAttribute(f"foliage:forest:{attribute}", value_type, custom=False).Set(value)


def _author_prototype(stage: Usd.Stage, holder: Sdf.Path, prototype: ForestPrototype, name: str) -> Sdf.Path:
    """An Xform with the asset below it, in metres and Y up, and its trunk."""
    path = holder.AppendChild(prototype.name)
    Usd.ModelAPI(UsdGeom.Xform.Define(stage, path)).SetKind(Kind.Tokens.group)
    unit = prototype.asset_to_meters
    # (x, y, z) -> (x, z, -y), for row vectors.
    turn = [[1, 0, 0], [0, 0, -1], [0, 1, 0]] if prototype.is_z_up else [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
    matrix = np.eye(4)
    matrix[:3, :3] = unit * np.array(turn)
    matrix[3, 1] = prototype.raised_m
    place = UsdGeom.Xform.Define(stage, path.AppendChild("Place"))
    Usd.ModelAPI(place).SetKind(Kind.Tokens.group)
    if not np.array_equal(matrix, np.eye(4)):
        place.AddTransformOp().Set(Gf.Matrix4d(matrix.tolist()))
    plant = stage.DefinePrim(place.GetPath().AppendChild("Plant"))  # its asset has the type
    plant.GetReferences().AddReference(prototype.reference)
    spec = stage.GetEditTarget().GetLayer().GetPrimAtPath(plant.GetPath())
    for variant_set, variant in prototype.selections.items():
        spec.variantSelections[variant_set] = variant
    if prototype.crown_form:
        holder = stage.OverridePrim(plant.GetPath().AppendPath(CROWN_HOLDER))
        holder_spec = stage.GetEditTarget().GetLayer().GetPrimAtPath(holder.GetPath())
        holder_spec.variantSelections[FORM] = prototype.crown_form
    if prototype.leaves is not None:
        author_other_leaves(stage, plant.GetPath(), prototype.leaves)
    if prototype.trunk_m is not None:
        _author_trunk(stage, path.AppendChild("Trunk"), prototype.trunk_m, name)
    return path


def _author_trunk(stage: Usd.Stage, path: Sdf.Path, trunk_m: tuple[float, float], name: str) -> None:
    """A tapered and slightly bent trunk (the thesis' section 6.4.1), in the material of bark."""
    height_m, radius_m = trunk_m
    up = np.linspace(0, 1, TRUNK_RINGS)
    angle = np.linspace(0, 2 * np.pi, TRUNK_SIDES, endpoint=False)
    wide_m = radius_m * (1 - (1 - TRUNK_TAPER) * up)
    bend_m = TRUNK_BEND * height_m * np.sin(np.pi * up)
    rings = np.stack(
        [
            bend_m[:, None] + wide_m[:, None] * np.cos(angle),
            np.broadcast_to((height_m * up)[:, None], (TRUNK_RINGS, TRUNK_SIDES)),
            -wide_m[:, None] * np.sin(angle),
        ],
        axis=-1,
    )
    corner = np.arange(TRUNK_RINGS * TRUNK_SIDES).reshape(TRUNK_RINGS, TRUNK_SIDES)
    turned = np.roll(corner, -1, axis=1)
    faces = np.stack([corner[:-1], turned[:-1], turned[1:], corner[1:]], axis=-1).reshape(-1, 4)
    mesh = UsdGeom.Mesh.Define(stage, path)
    points = rings.reshape(-1, 3).astype(np.float32)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray(len(faces), 4))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(faces.reshape(-1).astype(np.int32)))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.catmullClark)
    mesh.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(np.stack([points.min(axis=0), points.max(axis=0)])))
    mesh.CreateDisplayColorAttr(Vt.Vec3fArray([Gf.Vec3f(*BARK_COLOR)]))
    bind_material(stage, path, Sdf.Path(f"/{name}/{BARK_MATERIAL}"))
