"""Materials of an export: the shading networks that others know, and no node that none of them needs."""

from collections.abc import Collection, Iterable, Iterator

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade


def keep_networks(stage: Usd.Stage, with_materialx: Collection[Sdf.Path] = ()) -> None:
    """Leave of every material its UsdPreviewSurface, and the nodes that it reaches.

    Args:
        stage: Flat; it is changed.
        with_materialx: Materials that keep MaterialX too.
    """
    _drop_unbound(stage)
    for prim in [prim for prim in stage.Traverse() if prim.IsA(UsdShade.Material)]:
        material = UsdShade.Material(prim)
        kept = {"surface", "mtlx:surface"} if prim.GetPath() in with_materialx else {"surface"}
        for output in material.GetOutputs():
            if output.GetBaseName() not in kept:
                prim.RemoveProperty(output.GetFullName())
        reached = set(_reach(stage, material.GetOutputs()))
        nodes = [node.GetPath() for node in Usd.PrimRange(prim) if node.IsA(UsdShade.Shader)]
        for path in nodes:
            if path not in reached:
                stage.RemovePrim(path)


def _drop_unbound(stage: Usd.Stage) -> None:
    """Materials that nothing is bound to go: those of what the export leaves out."""
    bound = set()
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.Gprim) or prim.IsA(UsdGeom.Subset):
            material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
            bound |= {material.GetPath()} if material else set()
    materials = [prim.GetPath() for prim in stage.Traverse() if prim.IsA(UsdShade.Material)]
    for path in materials:
        if path not in bound:
            stage.RemovePrim(path)


def _reach(stage: Usd.Stage, outputs: Iterable[UsdShade.Output]) -> Iterator[Sdf.Path]:
    """The nodes that outputs are connected to, themselves or through others."""
    waiting = [path.GetPrimPath() for output in outputs for path in output.GetAttr().GetConnections()]
    seen: set[Sdf.Path] = set()
    while waiting:
        path = waiting.pop()
        if path in seen:
            continue
        seen.add(path)
        yield path
        shader = UsdShade.Shader(stage.GetPrimAtPath(path))
        for entry in shader.GetInputs() if shader else ():
            waiting += [source.GetPrimPath() for source in entry.GetAttr().GetConnections()]


def settle_colors(stage: Usd.Stage) -> list[str]:
    """Give materials whose colour a preview surface reads from displayColor that colour itself: one for all.

    Returns:
        The names of the materials whose surfaces have several colours, of which the mean is left.
    """
    several = []
    for prim in list(stage.Traverse()):
        surface = UsdShade.Shader(prim)
        if not surface or surface.GetIdAttr().Get() != "UsdPreviewSurface":
            continue
        color = surface.GetInput("diffuseColor")
        source = color.GetConnectedSources()[0] if color and color.HasConnectedSource() else []
        if not source or not _reads_display_color(UsdShade.Shader(source[0].source.GetPrim())):
            continue
        material = prim.GetPath().GetParentPath()
        colors = _display_colors(stage, material)
        if not len(colors):
            fallback = UsdShade.Shader(source[0].source.GetPrim()).GetInput("fallback")
            colors = np.array([fallback.Get() if fallback else (0.18, 0.18, 0.18)])
        if np.ptp(colors, axis=0).max() > 0:
            several.append(material.name)
        color.ClearSources()
        color.Set(Gf.Vec3f(*map(float, colors.mean(axis=0))))
    return several


def _reads_display_color(reader: UsdShade.Shader) -> bool:
    if not str(reader.GetIdAttr().Get() or "").startswith("UsdPrimvarReader"):
        return False
    name = reader.GetInput("varname")
    return bool(name) and str(name.Get()) == "displayColor"


def _display_colors(stage: Usd.Stage, material: Sdf.Path) -> NDArray[np.float64]:
    """The colours (C, 3) of everything that a material is bound to; a colour counts as often as it is used."""
    found = []
    for prim in stage.Traverse():
        if not prim.IsA(UsdGeom.Gprim):
            continue
        bound, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
        if not bound or bound.GetPath() != material:
            continue
        values = UsdGeom.Gprim(prim).GetDisplayColorPrimvar().ComputeFlattened()
        if values is not None and len(values):
            found.append(np.array(values, np.float64))
    return np.concatenate(found) if found else np.zeros((0, 3))
