"""The material of blades of grass: the orthophoto's colour at their roots; glslfx for Storm has more."""

from dataclasses import dataclass

from pxr import Gf, Sdf, Usd, UsdShade

from usdfoliage.asset.materials.mtlx import author_open_pbr, author_primvar_color

GRASS_SHADER = "usdFoliageGrass.glslfx"
GRASS_COLOR = (0.08, 0.12, 0.04)  # linear Rec.709, where there is no orthophoto
TINT = "tint"  # primvar, one colour an instance


@dataclass(frozen=True, kw_only=True)
class GrassMaterial:
    """What the material of grass needs to know; paths as seen from the layer's folder."""

    shader: str = ""  # the glslfx source; empty: Storm draws what others draw
    color: tuple[float, float, float] = GRASS_COLOR  # where a renderer reads no primvars of instances
    roughness: float = 0.9


def author_grass_material(stage: Usd.Stage, path: Sdf.Path, grass: GrassMaterial) -> UsdShade.Material:
    """Define the material of grass."""
    types = Sdf.ValueTypeNames
    material = UsdShade.Material.Define(stage, path)
    reader = UsdShade.Shader.Define(stage, path.AppendChild("Tint"))
    reader.CreateIdAttr("UsdPrimvarReader_float3")
    reader.CreateInput("varname", types.String).Set(TINT)
    reader.CreateInput("fallback", types.Float3).Set(Gf.Vec3f(*grass.color))
    reader.CreateOutput("result", types.Float3)
    surface = UsdShade.Shader.Define(stage, path.AppendChild("PreviewSurface"))
    surface.CreateIdAttr("UsdPreviewSurface")
    surface.CreateInput("diffuseColor", types.Color3f).ConnectToSource(reader.ConnectableAPI(), "result")
    surface.CreateInput("roughness", types.Float).Set(grass.roughness)
    surface.CreateInput("ior", types.Float).Set(1.0)  # as the ground, which mirrors nothing either
    surface.CreateOutput("surface", types.Token)
    material.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    color = author_primvar_color(stage, path.AppendChild("MtlxTint"), TINT, grass.color)
    numbers = {"specular_weight": (types.Float, 0.0), "specular_roughness": (types.Float, grass.roughness)}
    author_open_pbr(material, color, numbers)
    if grass.shader:
        storm = UsdShade.Shader.Define(stage, path.AppendChild("StormSurface"))
        storm.SetSourceAsset(Sdf.AssetPath(grass.shader), "glslfx")
        storm.CreateInput("grassColor", types.Color3f).Set(Gf.Vec3f(*grass.color))
        storm.CreateOutput("surface", types.Token)
        material.CreateSurfaceOutput("glslfx").ConnectToSource(storm.ConnectableAPI(), "surface")
    return material
