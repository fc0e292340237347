"""What holds of every export: it needs no plug-in of ours, no file but its own, and no guess of who draws it."""

from collections.abc import Iterator
from pathlib import Path, PurePosixPath

from pxr import Sdf, Usd, UsdGeom, UsdShade

from usdfoliage.asset.export.flat import listed_schemas
from usdfoliage.asset.schema import SCHEMAS
from usdfoliage.asset.validation.findings import Finding


def finding(validator: str, error: str, path: object, message: str) -> Finding:
    """An error of an export."""
    return Finding(severity="error", validator=f"export:{validator}", error=error, path=str(path), message=message)


def check_plain(stage: Usd.Stage, *, instances: bool) -> list[Finding]:
    """Whether a stage is one layer that every renderer draws.

    Args:
        stage: Opened from the file of the export.
        instances: Whether it may have a PointInstancer.
    """
    return [*_check_layers(stage), *(each for prim in stage.Traverse() for each in _check_prim(prim, instances))]


def _check_layers(stage: Usd.Stage) -> Iterator[Finding]:
    root = stage.GetRootLayer()
    used = [layer for layer in stage.GetUsedLayers() if layer not in (root, stage.GetSessionLayer())]
    if used:
        yield finding("plain", "OneLayer", "/", f"needs {len(used)} more layers, the first is {used[0].identifier}")
    if not stage.GetDefaultPrim():
        yield finding("plain", "DefaultPrim", "/", "has no default prim")
    for name in ("metersPerUnit", "upAxis"):
        if not stage.HasAuthoredMetadata(name):
            yield finding("plain", "Units", "/", f"does not state {name}")
    if len(stage.GetPseudoRoot().GetAllChildren()) != 1:
        yield finding("plain", "OneRoot", "/", "has more than one prim at its root")


def _check_prim(prim: Usd.Prim, instances: bool) -> Iterator[Finding]:
    path = prim.GetPath()
    ours = [name for name in listed_schemas(prim) if name in SCHEMAS]
    if ours:
        yield finding("plain", "NoSchemas", path, f"applies {', '.join(ours)}, which need a plug-in")
    if prim.GetVariantSets().GetNames():
        yield finding("plain", "NoVariants", path, "has variant sets")
    if prim.IsA(UsdGeom.PointInstancer) and not instances:
        yield finding("plain", "NoInstancer", path, "is a PointInstancer, which some applications leave out")
    mesh = UsdGeom.Mesh(prim)
    if mesh:
        if mesh.GetSubdivisionSchemeAttr().Get() != UsdGeom.Tokens.none:
            yield finding("plain", "Polygons", path, "is a subdivision surface, of which some draw the cage")
        if not mesh.GetNormalsAttr().HasAuthoredValue():
            yield finding("plain", "Normals", path, "has no normals")
    shader = UsdShade.Shader(prim)
    if shader and shader.GetImplementationSource() != UsdShade.Tokens.id:
        yield finding("plain", "NoShaderSource", path, "is a shader of a file, which one renderer alone reads")
    for attribute in prim.GetAuthoredAttributes():
        if attribute.GetTypeName() == Sdf.ValueTypeNames.Asset and attribute.HasAuthoredValue():
            yield from _check_path(attribute)


def _check_path(attribute: Usd.Attribute) -> Iterator[Finding]:
    value = attribute.Get()
    if value is None or not value.path:
        return
    name = PurePosixPath(value.path)
    if name.is_absolute() or ".." in name.parts:
        yield finding("plain", "RelativePaths", attribute.GetPath(), f"names {value.path}, which is no path within it")
    elif not value.resolvedPath or ("[" not in value.resolvedPath and not Path(value.resolvedPath).is_file()):
        yield finding("plain", "Files", attribute.GetPath(), f"names {value.path}, which is not there")
