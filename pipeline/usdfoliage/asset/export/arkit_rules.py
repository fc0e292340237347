"""The rules of usdz for augmented reality, as `usdchecker` of OpenUSD before 26.8 has them for ARKit.

Later versions of USD have no such check. docs/export.md lists the rules.

Source:
    OpenUSD 26.3, pxr/usd/usdUtils/complianceChecker.py, and https://openusd.org/release/spec_usdz.html
"""

from collections.abc import Iterator
from pathlib import Path, PurePosixPath

from pxr import Sdf, Tf, Usd, UsdGeom, UsdShade

from usdfoliage.asset.export.plain_rules import check_plain, finding
from usdfoliage.asset.locate import first_reason
from usdfoliage.asset.validation.findings import Finding

PRIM_TYPES = frozenset(
    (
        "", "Scope", "Xform", "Camera", "Shader", "Material", "Mesh", "Sphere", "Cube", "Cylinder", "Cone", "Capsule",
        "GeomSubset", "Points", "SkelRoot", "Skeleton", "SkelAnimation", "BlendShape", "SpatialAudio",
    )
)  # fmt: skip
SHADERS = ("UsdPreviewSurface", "UsdUVTexture", "UsdTransform2d", "UsdPrimvarReader")  # how ids begin
PICTURES = (".png", ".jpg", ".jpeg")
_ALIGNMENT = 64  # bytes, of each file in the package


def check_arkit(package: Path) -> list[Finding]:
    """What a usdz breaks of the rules; none for a good one."""
    zipped = Sdf.ZipFile.Open(str(package))
    if zipped is None:
        return [finding("arkit", "Package", "/", "is no usdz package")]
    findings = list(check_package(zipped))
    try:
        stage = Usd.Stage.Open(str(package))
    except Tf.ErrorException as error:
        return [*findings, finding("arkit", "Package", "/", f"cannot be read: {first_reason(error)}")]
    findings += check_plain(stage, instances=False)
    if UsdGeom.GetStageUpAxis(stage) != UsdGeom.Tokens.y:
        findings.append(finding("arkit", "UpAxis", "/", f"has {UsdGeom.GetStageUpAxis(stage)} up, Y is needed"))
    return findings + [each for prim in stage.TraverseAll() for each in _check_prim(prim)]


def check_package(zipped: Sdf.ZipFile) -> Iterator[Finding]:
    """What the package breaks of the rules, whatever is in its files."""
    names = zipped.GetFileNames()
    layers = [name for name in names if PurePosixPath(name).suffix in (".usd", ".usda", ".usdc", ".usdz")]
    if not names or PurePosixPath(names[0]).suffix != ".usdc":
        yield finding("arkit", "RootLayer", "/", "does not begin with a layer .usdc")
    if len(layers) > 1:
        yield finding("arkit", "OneLayer", "/", f"holds {len(layers)} layers, one is allowed")
    for name in names:
        info = zipped.GetFileInfo(name)
        if info.compressionMethod or info.encrypted:
            yield finding("arkit", "Stored", "/", f"holds {name} compressed or encrypted")
        if info.dataOffset % _ALIGNMENT:
            yield finding("arkit", "Alignment", "/", f"holds {name} at no multiple of {_ALIGNMENT} bytes")
        if name not in layers and PurePosixPath(name).suffix.lower() not in PICTURES:
            yield finding("arkit", "FileTypes", "/", f"holds {name}, which is neither PNG nor JPEG")


def _check_prim(prim: Usd.Prim) -> Iterator[Finding]:
    path = prim.GetPath()
    if str(prim.GetTypeName()) not in PRIM_TYPES:
        yield finding("arkit", "PrimTypes", path, f"is a {prim.GetTypeName()}, which AR does not show")
    shader = UsdShade.Shader(prim)
    if shader:
        identifier = str(shader.GetIdAttr().Get() or "")
        if not identifier.startswith(SHADERS):
            yield finding("arkit", "Shaders", path, f"is a {identifier or 'shader without id'}")
        for entry in shader.GetInputs():
            connections = entry.GetAttr().GetConnections()
            if len(connections) > 1:
                yield finding("arkit", "Connections", entry.GetAttr().GetPath(), "is connected more than once")
            elif connections and not UsdShade.ConnectableAPI(
                prim.GetStage().GetPrimAtPath(connections[0].GetPrimPath())
            ):
                yield finding("arkit", "Connections", entry.GetAttr().GetPath(), "is connected to no shader")
    if not prim.IsA(UsdGeom.Gprim):
        return
    bound, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
    targets = UsdShade.MaterialBindingAPI(prim).GetDirectBindingRel().GetTargets()
    if targets and not bound:
        yield finding("arkit", "MaterialBinding", path, f"is bound to <{targets[0]}>, which is no material")
