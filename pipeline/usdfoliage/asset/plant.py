"""The plant itself: the root prim of an asset, as the interface layer describes it."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Kind, Sdf, Usd, UsdGeom, UsdMedia, Vt

from usdfoliage.asset.provenance import Provenance
from usdfoliage.asset.schema import PLANT_API

# Below the root prim.
LEAVES = "geo/render/Leaves"  # in every representation
LEAVES_GUIDE = "geo/guide/Leaves"  # in every representation but bezier: the leaves themselves are below
CROWN_HOLDER = "geo/proxy"  # the scope that has the forms of the crown as variants
CROWN_NAME = "Crown"
CROWN = f"{CROWN_HOLDER}/{CROWN_NAME}"
BRANCHES = "geo/render/Branches"
BARE_BRANCHES = "geo/proxy/Branches"  # those that stand out of the crown
SKELETON = "geo/guide/Skeleton"

COLLECTIONS = ("leaves", "branches", "crown")  # of a whole plant

TO_LEAVES, TO_CROWN, TO_SKELETON = "foliage:leaves", "foliage:crown", "foliage:skeleton"  # relationships of the root


@dataclass(frozen=True, kw_only=True, eq=False)
class PurposeBoxes:
    """Boxes (2, 3) in metres around what has each purpose; None where nothing has it."""

    default: NDArray[np.float64] | None = None
    render: NDArray[np.float64] | None = None
    proxy: NDArray[np.float64] | None = None
    guide: NDArray[np.float64] | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Plant:
    """What is authored on the root prim, whatever parts the asset has."""

    provenance: Provenance
    asset_from_capture: NDArray[np.float64]  # (4, 4), column vectors
    extent_m: NDArray[np.float64]  # (2, 3), smallest and largest corner of everything below, but guides
    guide_extent_m: NDArray[np.float64] | None = None  # (2, 3), of the guides of any variant
    relationships: Mapping[str, str]  # each to a prim below the root, as TO_LEAVES to LEAVES
    version: str  # of the asset
    kind: str = Kind.Tokens.component
    lods: Mapping[str, PurposeBoxes] = field(
        default_factory=dict
    )  # where several hold different things: what each does
    collections: Mapping[str, Sequence[str]] = field(default_factory=dict)  # what each includes, by COLLECTIONS
    thumbnail: str = ""  # picture, as a path from the interface layer
    cards: Mapping[str, str] = field(default_factory=dict)  # pictures by side, as usdfoliage.asset.packages.cards


def asset_name(text: str) -> str:
    """A prim and file name from what a user or a folder calls the asset: "5 oaks" becomes "_5_oaks".

    Letters of any alphabet stay; what USD does not allow in an identifier becomes an underscore. Empty text, or text of
    nothing else, gives "plant".
    """
    text = text.encode("utf-8", "replace").decode("utf-8")  # a file name may hold bytes that are no text
    name = "".join(c if Sdf.Path.IsValidIdentifier(f"_{c}") else "_" for c in text)
    if not Sdf.Path.IsValidIdentifier(name):  # begins with a digit
        name = f"_{name}"
    return name if re.search(r"[^_]", name) else "plant"


def author_plant(stage: Usd.Stage, path: Sdf.Path, plant: Plant) -> Usd.Prim:
    """Make the prim at path a model with the facts of the plant, inheriting the class /__class__/<its name>."""
    name = path.name
    for prefix in Sdf.Path(f"/__class__/{name}").GetPrefixes():
        stage.CreateClassPrim(prefix)
    prim = UsdGeom.Xform.Define(stage, path).GetPrim()
    prim.GetInherits().AddInherit(f"/__class__/{name}")

    model = Usd.ModelAPI(prim)
    model.SetKind(plant.kind)
    model.SetAssetIdentifier(Sdf.AssetPath(f"./{name}.usda"))
    model.SetAssetName(name)
    model.SetAssetVersion(plant.version)
    geometry = UsdGeom.ModelAPI.Apply(prim)
    if not plant.lods:  # else an opinion here would be stronger than those of the variants
        geometry.SetExtentsHint(_extents_hint(PurposeBoxes(default=plant.extent_m, guide=plant.guide_extent_m)))
    if plant.thumbnail:
        thumbnails = UsdMedia.AssetPreviewsAPI.Thumbnails(defaultImage=Sdf.AssetPath(plant.thumbnail))
        UsdMedia.AssetPreviewsAPI.Apply(prim).SetDefaultThumbnails(thumbnails)

    prim.AddAppliedSchema(PLANT_API)
    facts = (
        ("foliage:species", Sdf.ValueTypeNames.String, plant.provenance.species),
        ("foliage:capture", Sdf.ValueTypeNames.String, plant.provenance.capture),
        ("foliage:generator", Sdf.ValueTypeNames.String, plant.provenance.generator),
        # USD multiplies row vectors from the left.
        ("foliage:captureToAsset", Sdf.ValueTypeNames.Matrix4d, Gf.Matrix4d(plant.asset_from_capture.T.tolist())),
    )
    for attribute, value_type, value in facts:
        prim.CreateAttribute(attribute, value_type, custom=False).Set(value)
    for relationship, part in plant.relationships.items():
        prim.CreateRelationship(relationship, custom=False).SetTargets([path.AppendPath(part)])
    for collection, parts in plant.collections.items():
        members = Usd.CollectionAPI.Apply(prim, collection)
        for part in parts:
            members.IncludePath(path.AppendPath(part))
    return prim


def author_lod_extents(layer: Sdf.Layer, path: Sdf.Path, lods: Mapping[str, PurposeBoxes]) -> None:
    """Author an extentsHint in each variant of the set lod, which the prim at path has, so that it holds while nothing
    is loaded."""
    variants = layer.GetPrimAtPath(path).variantSets["lod"].variants
    for name, boxes in lods.items():
        hint = Sdf.AttributeSpec(variants[name].primSpec, "extentsHint", Sdf.ValueTypeNames.Float3Array)
        hint.default = Vt.Vec3fArray(_extents_hint(boxes))


def box_around(boxes: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    """The box (2, 3) around boxes (2, 3), of which there is at least one."""
    return np.stack([np.min(boxes, axis=0)[0], np.max(boxes, axis=0)[1]])


def _extents_hint(boxes: PurposeBoxes) -> list[Gf.Vec3f]:
    """A pair of corners for each of the purposes default, render, proxy and guide, to the last that has something."""
    corners = [boxes.default, boxes.render, boxes.proxy, boxes.guide]
    while corners and corners[-1] is None:
        corners.pop()
    nothing = np.array([np.full(3, np.finfo(np.float32).max), np.full(3, np.finfo(np.float32).min)])
    return [Gf.Vec3f(*map(float, corner)) for box in corners for corner in (nothing if box is None else box)]
