"""The ground's material: the orthophoto, as UsdPreviewSurface and MaterialX draw it everywhere."""

from dataclasses import dataclass

from pxr import Gf, Sdf, Usd, UsdShade

from usdfoliage.asset.materials.mtlx import Source, author_image, author_open_pbr, author_primvar_color
from usdfoliage.asset.materials.picture import usd_color_space

GROUND_COLOR = (0.09, 0.1, 0.05)  # linear Rec.709, of dry grass and soil


@dataclass(frozen=True, kw_only=True)
class GroundMaterial:
    """What the ground's material needs to know; paths as seen from the layer's folder."""

    texture: str = ""  # the orthophoto, over the whole st; empty: one colour
    color: tuple[float, float, float] = GROUND_COLOR
    roughness: float = 0.95


def author_ground_material(stage: Usd.Stage, path: Sdf.Path, ground: GroundMaterial) -> UsdShade.Material:
    """Define the material of the ground."""
    material = UsdShade.Material.Define(stage, path)
    surface = UsdShade.Shader.Define(stage, path.AppendChild("PreviewSurface"))
    surface.CreateIdAttr("UsdPreviewSurface")
    color = surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    if ground.texture:
        reader = UsdShade.Shader.Define(stage, path.AppendChild("St"))
        reader.CreateIdAttr("UsdPrimvarReader_float2")
        reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
        reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
        texture = UsdShade.Shader.Define(stage, path.AppendChild("Texture"))
        texture.CreateIdAttr("UsdUVTexture")
        texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(Sdf.AssetPath(ground.texture))
        texture.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set(usd_color_space(ground.texture))
        for direction in ("wrapS", "wrapT"):
            texture.CreateInput(direction, Sdf.ValueTypeNames.Token).Set("clamp")
        texture.CreateInput("fallback", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*ground.color, 1))
        texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(reader.ConnectableAPI(), "result")
        texture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
        color.ConnectToSource(texture.ConnectableAPI(), "rgb")
    else:
        color.Set(Gf.Vec3f(*ground.color))
    surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(ground.roughness)
    surface.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    material.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    _author_mtlx_surface(material, ground)
    return material


def _author_mtlx_surface(material: UsdShade.Material, ground: GroundMaterial) -> None:
    stage, path = material.GetPrim().GetStage(), material.GetPath()
    color: Source
    if ground.texture:
        color = author_image(stage, path, ground.texture, ground.color, wrap="clamp").GetOutput("rgb")
    else:
        color = author_primvar_color(stage, path.AppendChild("MtlxColor"), "displayColor", ground.color)
    author_open_pbr(material, color, {"specular_roughness": (Sdf.ValueTypeNames.Float, ground.roughness)})
