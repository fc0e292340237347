"""The primvars of FoliageLeafAPI, on an instancer of many leaves as on the patch of one.

schemas/usdFoliage/schema.usda explains them.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, Vt

from usdfoliage.asset.look_layer import EDITS, EditValue, author_edit
from usdfoliage.asset.packed_files import is_packed
from usdfoliage.asset.stored_numbers import stored_numbers
from usdfoliage.errors import AssetError
from usdfoliage.files.reading import explain_refusal
from usdfoliage.leaf.model import PARAMETERS, Leaves
from usdfoliage.leaf.shape.edits import NEUTRAL, LeafEdits

JITTER_MAP = "foliage:leaf:jitterMap"

DISPLAY_COLOR = "displayColor"

# Optional facts of each leaf: field of Leaves, primvar.
_FACTS = (
    ("phase", "leaf:phase"),
    ("color", DISPLAY_COLOR),
    ("confidence", "leaf:confidence"),
    ("residual_m", "leaf:residual"),
    ("view", "leaf:view"),
    ("origin", "leaf:origin"),
)
_WHOLE = ("view", "origin")  # whole numbers

Array = NDArray[np.float32 | np.int32]


def leaf_arrays(leaves: Leaves) -> dict[str, Array]:
    """The primvars of leaves, one element a leaf: (N, 3) or (N,) float32, (N,) int32 for view and origin."""
    arrays: dict[str, Array] = {}
    for row, name in enumerate(PARAMETERS):
        arrays[f"leaf:{name}"] = np.ascontiguousarray(leaves.parameters[:, row], np.float32)
    for field, name in _FACTS:
        value = getattr(leaves, field)
        if value is not None:
            kind: type[np.int32 | np.float32] = np.int32 if field in _WHOLE else np.float32
            arrays[name] = np.ascontiguousarray(value, kind)
    return arrays


def usd_array(array: Array) -> Vt.Vec3fArray | Vt.FloatArray | Vt.IntArray:
    """The same numbers as USD holds them."""
    return _usd_types(array)[1].FromNumpy(array)


def author_leaf_primvars(prim: Usd.Prim, leaves: Leaves, interpolation: str) -> None:
    """The parameters, the phase and the facts of leaves, one element a leaf."""
    for name, array in leaf_arrays(leaves).items():
        color = name == DISPLAY_COLOR
        value_type = Sdf.ValueTypeNames.Color3fArray if color else _usd_types(array)[0]
        _author(prim, name, value_type, usd_array(array), interpolation)


def author_edits(prim: Usd.Prim, edits: LeafEdits) -> None:
    """Every edit, the neutral ones too: a fallback of the schema does not reach a shader."""
    for field, name in EDITS.items():
        author_edit(prim, name, getattr(edits, field))


def edit_values(edits: LeafEdits) -> dict[str, EditValue]:
    """Every edit by its name."""
    return {field: getattr(edits, field) for field in EDITS}


def author_jitter_map(prim: Usd.Prim, path: str) -> None:
    """The map of the jitter, as seen from the layer's folder."""
    prim.CreateAttribute(JITTER_MAP, Sdf.ValueTypeNames.Asset, custom=False).Set(Sdf.AssetPath(path))


def read_leaf_primvars(prim: Usd.Prim, count: int) -> dict[str, NDArray[Any]]:
    """The fields of Leaves that are primvars: parameters, phase, and what is there of the facts.

    Raises:
        AssetError: A parameter is missing, an array is not of count elements, or has a number that is not finite.
    """
    parameters = np.empty((count, len(PARAMETERS), 3))
    for row, name in enumerate(PARAMETERS):
        parameters[:, row] = read_array(prim, f"primvars:leaf:{name}", (count, 3))
    found: dict[str, NDArray[Any]] = {"parameters": parameters, "phase": np.zeros(count)}
    for field, name in _FACTS:
        attribute = prim.GetAttribute(f"primvars:{name}")
        if not attribute or not attribute.HasAuthoredValue():
            continue
        if field == "color" and count != 1 and UsdGeom.Primvar(attribute).GetInterpolation() == UsdGeom.Tokens.constant:
            continue  # one for all: no leaf has a colour of its own
        found[field] = read_array(prim, f"primvars:{name}", (count, 3) if field == "color" else (count,))
    for field in found.keys() & set(_WHOLE):
        found[field] = found[field].astype(np.int32)
    return found


def read_edits(prim: Usd.Prim) -> LeafEdits:
    """The edits as composed; neutral where none is authored.

    Raises:
        AssetError: An edit is not finite, or out of its range.
    """
    stored: dict[str, Any] = {}
    for field, name in EDITS.items():
        attribute = prim.GetAttribute(f"primvars:{name}")
        if not attribute or not attribute.HasAuthoredValue():
            continue
        value = attribute.Get(Usd.TimeCode.EarliestTime())
        single = isinstance(getattr(NEUTRAL, field), float)
        numbers = stored_numbers(value, () if single else (3,))
        if numbers is None:
            needed = "one number is" if single else "three numbers are"
            raise AssetError(f"primvars:{name} holds {value}, {needed} needed ({place(prim)})", "set the edit again")
        stored[field] = float(numbers) if single else tuple(map(float, numbers))
    try:
        return LeafEdits(**stored)
    except ValueError as error:
        raise AssetError(f"{error} ({place(prim)})", "set the edit again") from error


def animated_edits(prim: Usd.Prim) -> list[str]:
    """The edits that change over time, by their primvars; read_edits takes them at the earliest time."""
    attributes = {name: prim.GetAttribute(f"primvars:{name}") for name in EDITS.values()}
    return [name for name, attribute in attributes.items() if attribute and attribute.ValueMightBeTimeVarying()]


def read_jitter_map_path(prim: Usd.Prim) -> Path | None:
    """The file of the jitter's map, None where the jitter is procedural.

    Raises:
        AssetError: The file is missing.
    """
    attribute = prim.GetAttribute(JITTER_MAP)
    value = attribute.Get() if attribute and attribute.HasAuthoredValue() else None
    if not isinstance(value, Sdf.AssetPath) or not value.path:
        return None
    path = Path(value.resolvedPath)
    if not value.resolvedPath or not (path.is_file() or is_packed(path)):
        raise describe_unfound("jitter map", attribute, "put the file there or block the map")
    return path


def read_array(prim: Usd.Prim, name: str, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """An attribute's numbers, float64 of that shape; an indexed primvar is flattened.

    Raises:
        AssetError: It is missing, of another length, or has a number that is not finite.
    """
    attribute = prim.GetAttribute(name)
    value = None
    if attribute and attribute.HasAuthoredValue():
        time = time_of(attribute)
        primvar = UsdGeom.Primvar(attribute)
        value = primvar.ComputeFlattened(time) if primvar and primvar.IsIndexed() else attribute.Get(time)
    if value is None:
        raise AssetError(f"{name} is missing ({place(prim)}); {shape[0]} elements are needed, one a leaf")
    values = np.asarray(value)
    if values.dtype.kind not in "iuf" or not values.ndim:
        raise AssetError(
            f"{name} holds no numbers, and {shape[0]} elements are needed, one a leaf ({place(prim)})",
            "write the leaves again, or drop the layer that changed them",
        )
    if values.shape != shape:
        raise AssetError(
            f"{name} has {len(values)} elements where {shape[0]} are needed, one a leaf ({place(prim)})",
            "write the leaves again, or drop the layer that changed them",
        )
    finite = np.isfinite(values)
    if not finite.all():
        wrong = np.flatnonzero(~finite.reshape(len(values), -1).all(axis=1))
        raise AssetError(
            f"{name} is not finite in {len(wrong)} of {len(values)} leaves, the first is leaf {wrong[0]} "
            f"({place(prim)})",
            "drop these leaves or fit them again",
        )
    return values.astype(np.float64)


def time_of(attribute: Usd.Attribute) -> Usd.TimeCode:
    """When an attribute is read: outside time, where a plant that moves is as it was made, else at its earliest."""
    default = Usd.TimeCode.Default()
    return default if attribute.Get(default) is not None else Usd.TimeCode.EarliestTime()


def place(prim: Usd.Prim) -> str:
    """Where a prim is, for a message: the file that was opened and the prim's path."""
    layer = prim.GetStage().GetRootLayer()
    return f"{layer.realPath or layer.GetDisplayName()} <{prim.GetPath()}>"


def describe_unfound(what: str, attribute: Usd.Attribute, remedy: str = "put the file there") -> AssetError:
    """The error about a file that an attribute names and that is not there, or that the user may not open.

    Args:
        what: The file is.
        attribute: With a path to it.
        remedy: Where it is not there.
    """
    named = attribute.Get().path
    specs = (spec for spec in attribute.GetPropertyStack(Usd.TimeCode.Default()) if spec.HasInfo("default"))
    layer = next((spec.layer for spec in specs if not spec.layer.anonymous), None)
    path = Path(named if layer is None else layer.ComputeAbsolutePath(named))
    try:
        path.stat()
    except OSError as error:
        refusal = explain_refusal(error)
        if refusal is not None:
            return AssetError(f"the {what} {refusal[0]} ({place(attribute.GetPrim())})", refusal[1])
    return AssetError(f"the {what} {named} is missing ({place(attribute.GetPrim())})", remedy)


def _usd_types(array: Array) -> tuple[Sdf.ValueTypeName, Any]:
    if array.ndim == 2:
        return Sdf.ValueTypeNames.Float3Array, Vt.Vec3fArray
    if array.dtype == np.int32:
        return Sdf.ValueTypeNames.IntArray, Vt.IntArray
    return Sdf.ValueTypeNames.FloatArray, Vt.FloatArray


def _author(prim: Usd.Prim, name: str, value_type: Sdf.ValueTypeName, value: object, interpolation: str) -> None:
    UsdGeom.PrimvarsAPI(prim).CreatePrimvar(name, value_type, interpolation).Set(value)
