"""Assets that stand in a forest as prototypes: ours or foreign ones, measured as they are drawn."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from usdfoliage.asset.locate import find_interface, open_layer
from usdfoliage.asset.look_layer import LOD
from usdfoliage.asset.packages.contents import list_files
from usdfoliage.asset.parts.crown import FORM, LEAVES
from usdfoliage.asset.parts.crown_leaves import PlacedClusters, read_placed_clusters
from usdfoliage.asset.plant import CROWN_HOLDER
from usdfoliage.asset.schema import PLANT_API
from usdfoliage.errors import AssetError

CROWN_LODS = ("crown",)
FULL_LODS = ("both", "leaves", "auto")


@dataclass(frozen=True, kw_only=True, eq=False)
class PlantedForm:
    """How an asset is drawn at one level of detail."""

    selections: Mapping[str, str]  # variant by variant set
    extent_m: NDArray[np.float64]  # (2, 3), Y up, metres

    @property
    def height_m(self) -> float:
        """From its foot, the origin, to its top."""
        return float(self.extent_m[1, 1])

    @property
    def radius_m(self) -> float:
        """Half of its width, the mean of both."""
        size_m = self.extent_m[1] - self.extent_m[0]
        return float((size_m[0] + size_m[2]) / 4)


@dataclass(frozen=True, kw_only=True, eq=False)
class PlantedAsset:
    """An asset that is referenced as a prototype."""

    layer: Path  # its interface
    is_ours: bool
    meters_per_unit: float
    is_z_up: bool
    crown: PlantedForm  # as it is drawn in a level of crowns: its crown alone, or all where it has no such variant
    full: PlantedForm | None = None  # as it is drawn near, where that is more
    only_crown: bool = False  # whether it has nothing but a crown, which stands on the ground
    crown_forms: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)  # (2, 3) of what is drawn by form
    clusters: PlacedClusters | None = None  # of its crown in the form leaves, where that has some


def measure_planted_asset(asset: Path) -> PlantedAsset:
    """Open an asset and measure it in the forms that a forest draws it in.

    Args:
        asset: Its folder, or a USD file; of ours or of anybody.

    Raises:
        AssetError: It is missing, cannot be read, has no default prim, or draws nothing.
    """
    layer = find_interface(asset)
    open_layer(layer)
    stage = Usd.Stage.Open(str(layer))
    root = stage.GetDefaultPrim()
    if not root:
        raise AssetError(f"{layer} has no default prim, and cannot be referenced", "author one, or name another file")
    unit = float(UsdGeom.GetStageMetersPerUnit(stage))
    if not 0 < unit < np.inf:
        raise AssetError(f"{layer} has metersPerUnit {unit:g}", "author the unit of its lengths")
    is_z_up = UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z
    variants = root.GetVariantSets()
    lods = list(variants.GetVariantSet(LOD).GetVariantNames()) if variants.HasVariantSet(LOD) else []
    crown = next((name for name in CROWN_LODS if name in lods), None)
    full = next((name for name in FULL_LODS if name in lods), None)
    forms: list[PlantedForm] = []
    known = [{LOD: name} for name in (crown, full) if name is not None]
    for selections in known or [{}]:
        extent_m = _extent(root, selections, unit, is_z_up)
        if extent_m is not None:
            forms.append(PlantedForm(selections=selections, extent_m=extent_m))
    if not forms:
        raise AssetError(f"{layer} draws nothing: it has no extent", "name an asset with geometry")
    if not forms[0].height_m > 0:
        raise AssetError(f"{layer} lies under its origin", "move it, so that its foot is at the origin")
    drawn_forms = _crown_forms(root, forms[0].selections, unit, is_z_up)
    return PlantedAsset(
        layer=layer,
        is_ours=root.HasAPI(PLANT_API),
        meters_per_unit=unit,
        is_z_up=is_z_up,
        crown=forms[0],
        full=forms[1] if len(forms) > 1 and crown is not None else None,
        only_crown=root.HasAPI(PLANT_API) and lods == ["crown"],
        crown_forms=drawn_forms,
        clusters=_clusters(root, forms[0].selections) if LEAVES in drawn_forms else None,
    )


def _crown_forms(
    root: Usd.Prim, selections: Mapping[str, str], unit: float, is_z_up: bool
) -> dict[str, NDArray[np.float64]]:
    """What is drawn of an asset by the form of its crown."""
    _select(root, selections)
    holder = root.GetPrimAtPath(CROWN_HOLDER)
    drawn = {}
    for form in holder.GetVariantSets().GetVariantSet(FORM).GetVariantNames() if holder else ():
        extent_m = _extent(root, selections, unit, is_z_up, form)
        if extent_m is not None:
            drawn[str(form)] = extent_m
    return drawn


def _clusters(root: Usd.Prim, selections: Mapping[str, str]) -> PlacedClusters | None:
    _select(root, selections, LEAVES)
    return read_placed_clusters(root.GetPrimAtPath(CROWN_HOLDER))


def _select(root: Usd.Prim, selections: Mapping[str, str], crown_form: str = "") -> None:
    """Select variants in the session layer of a stage."""
    session = root.GetStage().GetSessionLayer()
    session.Clear()
    with Usd.EditContext(root.GetStage(), session):
        for name, variant in selections.items():
            root.GetVariantSets().GetVariantSet(name).SetVariantSelection(variant)
        if crown_form:
            root.GetPrimAtPath(CROWN_HOLDER).GetVariantSets().GetVariantSet(FORM).SetVariantSelection(crown_form)


def _extent(
    root: Usd.Prim, selections: Mapping[str, str], unit: float, is_z_up: bool, crown_form: str = ""
) -> NDArray[np.float64] | None:
    """(2, 3) of what is drawn with these variants, Y up in metres; None of nothing."""
    _select(root, selections, crown_form)
    tokens = UsdGeom.Tokens
    cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), [tokens.default_, tokens.render, tokens.proxy])
    box = cache.ComputeLocalBound(root).ComputeAlignedRange()
    if box.IsEmpty():
        return None
    corners = np.array([box.GetMin(), box.GetMax()], np.float64) * unit
    if not np.isfinite(corners).all():
        return None
    if is_z_up:  # (x, y, z) -> (x, z, -y)
        low, high = corners
        corners = np.array([[low[0], low[2], -high[1]], [high[0], high[2], -low[1]]])
    return corners


def needed_files(layer: Path) -> tuple[Path, ...]:
    """A layer and the files that it needs, in any variant; the layer alone where it cannot be read."""
    try:
        layers, others, _ = list_files(layer)
    except AssetError:  # who reads it reports that
        return (layer,)
    named = [layer.absolute().parent / each.path for each in (*layers, *others)]
    return (layer, *(each for each in named if each.is_file() and not each.samefile(layer)))


def reference_path(layer: Path, from_folder: Path) -> str:
    """The path of a layer as another one in a folder names it: relative, wherever both are."""
    path = os.path.relpath(os.path.realpath(layer), os.path.realpath(from_folder)).replace(os.sep, "/")
    return path if path.startswith("../") else f"./{path}"
