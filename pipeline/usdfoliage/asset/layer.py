"""One USD layer of an asset: how it begins, how it reaches the disk."""

import uuid
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from pxr import Sdf, Tf, Usd, UsdGeom, UsdShade

from usdfoliage.files.unwritten import describe_failed

FIRST_FRAME = 1
FRAMES_PER_SECOND = 24.0
NO_TIMES: Mapping[str, float] = MappingProxyType({})


def new_layer(path: Path, name: str) -> Usd.Stage:
    """An empty stage for the layer at path: metres, Y up, the default prim /name, an Xform.

    It stays in memory until export_layer, so a layer on the disk is whole or absent. Relative paths authored in it
    count from path's folder; payloads are not loaded.
    """
    # Under a name of its own: a layer of path may be open in this process, with its earlier content.
    identifier = path.absolute().with_name(f".{uuid.uuid4().hex}{path.suffix}")
    layer = Sdf.Layer.New(Sdf.FileFormat.FindByExtension(path.suffix), str(identifier))
    stage = Usd.Stage.Open(layer, Usd.Stage.LoadNone)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetDefaultPrim(stage.DefinePrim(f"/{name}", "Xform"))
    return stage


def export_layer(stage: Usd.Stage, path: Path) -> None:
    """Write the stage's root layer; path's suffix chooses text (.usda) or crate (.usdc).

    Raises:
        WriteError: The file cannot be written.
    """
    save_layer(stage.GetRootLayer(), path)


def save_layer(layer: Sdf.Layer, path: Path) -> None:
    """Write a layer as export_layer."""
    try:
        written = layer.Export(str(path))
    except Tf.ErrorException as error:
        # One line of USD's own, without its C++ function and source file.
        reasons = [line.split(" : ", 1)[-1].strip("'") for line in str(error).splitlines() if " : " in line]
        raise describe_failed(path, reasons[0] if reasons else error) from error
    if not written:
        raise describe_failed(path, "USD states no reason")


def author_scopes(stage: Usd.Stage, path: Sdf.Path) -> None:
    """Define path and what is between it and the default prim as Scopes."""
    for prefix in path.GetPrefixes()[1:]:
        UsdGeom.Scope.Define(stage, prefix)


def author_frames(stage: Usd.Stage, count: int) -> None:
    """Give the stage so many frames, from FIRST_FRAME on."""
    stage.SetStartTimeCode(FIRST_FRAME)
    stage.SetEndTimeCode(FIRST_FRAME + count - 1)
    stage.SetTimeCodesPerSecond(FRAMES_PER_SECOND)
    stage.SetFramesPerSecond(FRAMES_PER_SECOND)


def author_times(stage: Usd.Stage, times: Mapping[str, float]) -> None:
    """Give the stage's root layer a range of time, by the names of its metadata."""
    for field, value in times.items():
        stage.GetRootLayer().pseudoRoot.SetInfo(field, value)


def bind_material(stage: Usd.Stage, path: Sdf.Path, material: Sdf.Path) -> None:
    """Bind the material, which another layer may hold, on the prim at path.

    The layer gets no spec of the material: such an over would be an empty prim wherever the layer is brought in alone.
    """
    prim = stage.GetPrimAtPath(path)
    UsdShade.MaterialBindingAPI.Apply(prim)
    prim.CreateRelationship(UsdShade.Tokens.materialBinding, custom=False).SetTargets([material])
