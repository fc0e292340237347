"""The leaves' material: UsdPreviewSurface and MaterialX for any renderer, glslfx for Storm."""

from dataclasses import dataclass

from pxr import Sdf, Usd, UsdShade

# Everything that Storm needs; an asset's shaders/ gets all of it, so that a look can choose another.
LEAF_SHADERS = ("usdFoliageLeaf.glslfx",)
LEAF_COLOR = (0.06, 0.14, 0.03)  # linear Rec.709, of a full-grown leaf of a broad-leaved tree


@dataclass(frozen=True, kw_only=True)
class LeafMaterial:
    """What the leaves' material needs to know; paths as seen from the layer's folder."""

    shaders: str  # the folder with LEAF_SHADERS
    texture: str | None = None  # picture of a leaf in its st, with opacity; takes the place of displayColor
    jitter_map: str | None = None  # one cycle of the silhouette's jitter, see FoliageLeafAPI
    roughness: float = 0.5
    translucency: float = 0.4  # share of the light that a leaf returns that leaves it on the other side

    def __post_init__(self) -> None:
        for name in ("roughness", "translucency"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} must be 0 to 1, not {getattr(self, name)}")


def author_leaf_material(stage: Usd.Stage, path: Sdf.Path, leaf: LeafMaterial) -> UsdShade.Material:
    """Define a material that shows leaves in their displayColor or their texture, for three kinds of renderer."""
    material = UsdShade.Material.Define(stage, path)
    surface = _author_preview_surface(stage, path.AppendChild("PreviewSurface"), leaf)
    material.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    return material


def _author_preview_surface(stage: Usd.Stage, path: Sdf.Path, leaf: LeafMaterial) -> UsdShade.Shader:
    reader = UsdShade.Shader.Define(stage, path.GetParentPath().AppendChild("Color"))
    reader.CreateIdAttr("UsdPrimvarReader_float3")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("displayColor")
    reader.CreateInput("fallback", Sdf.ValueTypeNames.Float3).Set(LEAF_COLOR)
    reader.CreateOutput("result", Sdf.ValueTypeNames.Float3)
    surface = UsdShade.Shader.Define(stage, path)
    surface.CreateIdAttr("UsdPreviewSurface")
    surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(reader.ConnectableAPI(), "result")
    surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(leaf.roughness)
    surface.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    return surface
