"""The ground's material: the orthophoto, as UsdPreviewSurface and MaterialX draw it everywhere; glslfx for Storm.

Storm's has more: it is darker under plants, and has noise that is finer than the orthophoto.
"""

from dataclasses import dataclass

from pxr import Gf, Sdf, Usd, UsdShade

from usdfoliage.asset.materials.mtlx import Source, author_image, author_open_pbr, author_primvar_color
from usdfoliage.asset.materials.picture import usd_color_space

GROUND_SHADER = "usdFoliageGround.glslfx"
GROUND_COLOR = (0.09, 0.1, 0.05)  # linear Rec.709, of dry grass and soil


@dataclass(frozen=True, kw_only=True)
class GroundMaterial:
    """What the ground's material needs to know; paths as seen from the layer's folder."""

    texture: str = ""  # the orthophoto, over the whole st; empty: one colour
    contact_map: str = ""  # the part of the sky that plants leave open, over the whole st; empty: all of it
    grass_map: str = ""  # the part of the ground that is vegetated, likewise; empty: none of it
    shader: str = ""  # the glslfx source; empty: Storm draws what others draw
    photo_pixel_m: float = 0.5  # of the orthophoto on the ground; noise begins at twice that
    color: tuple[float, float, float] = GROUND_COLOR
    roughness: float = 0.95


def author_ground_material(stage: Usd.Stage, path: Sdf.Path, ground: GroundMaterial) -> UsdShade.Material:
    """Define the material of the ground.

    A photograph has all of the ground's look in it, so that no description mirrors the sky besides.
    """
    material = UsdShade.Material.Define(stage, path)
    surface = UsdShade.Shader.Define(stage, path.AppendChild("PreviewSurface"))
    surface.CreateIdAttr("UsdPreviewSurface")
    color = surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    texture = None
    if ground.texture:
        texture = _author_texture(stage, path.AppendChild("Texture"), ground.texture, usd_color_space(ground.texture))
        texture.CreateInput("fallback", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*ground.color, 1))
        texture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
        color.ConnectToSource(texture.ConnectableAPI(), "rgb")
    else:
        color.Set(Gf.Vec3f(*ground.color))
    surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(ground.roughness)
    surface.CreateInput("ior", Sdf.ValueTypeNames.Float).Set(1.0)
    surface.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    material.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    _author_mtlx_surface(material, ground)
    if ground.shader:
        _author_storm_surface(material, ground, texture)
    return material


def _author_texture(stage: Usd.Stage, path: Sdf.Path, file: str, color_space: str) -> UsdShade.Shader:
    reader = UsdShade.Shader.Define(stage, path.GetParentPath().AppendChild("St"))
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
    reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    texture = UsdShade.Shader.Define(stage, path)
    texture.CreateIdAttr("UsdUVTexture")
    texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(Sdf.AssetPath(file))
    texture.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set(color_space)
    for direction in ("wrapS", "wrapT"):
        texture.CreateInput(direction, Sdf.ValueTypeNames.Token).Set("clamp")
    texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(reader.ConnectableAPI(), "result")
    return texture


def _author_mtlx_surface(material: UsdShade.Material, ground: GroundMaterial) -> None:
    stage, path = material.GetPrim().GetStage(), material.GetPath()
    color: Source
    if ground.texture:
        color = author_image(stage, path, ground.texture, ground.color, wrap="clamp").GetOutput("rgb")
    else:
        color = author_primvar_color(stage, path.AppendChild("MtlxColor"), "displayColor", ground.color)
    number = Sdf.ValueTypeNames.Float
    author_open_pbr(
        material, color, {"specular_weight": (number, 0.0), "specular_roughness": (number, ground.roughness)}
    )


def _author_storm_surface(material: UsdShade.Material, ground: GroundMaterial, texture: UsdShade.Shader | None) -> None:
    stage, path = material.GetPrim().GetStage(), material.GetPath()
    storm = UsdShade.Shader.Define(stage, path.AppendChild("StormSurface"))
    storm.SetSourceAsset(Sdf.AssetPath(ground.shader), "glslfx")
    types = Sdf.ValueTypeNames
    if texture is not None:
        storm.CreateInput("colorMap", types.Color3f).ConnectToSource(texture.ConnectableAPI(), "rgb")
    for name, file, fallback in (("contactMap", ground.contact_map, 1.0), ("grassMap", ground.grass_map, 0.0)):
        if file:
            picture = _author_texture(stage, path.AppendChild(name[0].upper() + name[1:]), file, "raw")
            picture.CreateInput("fallback", types.Float4).Set(Gf.Vec4f(fallback))
            picture.CreateOutput("r", types.Float)
            storm.CreateInput(name, types.Float).ConnectToSource(picture.ConnectableAPI(), "r")
    storm.CreateInput("groundColor", types.Color3f).Set(Gf.Vec3f(*ground.color))
    storm.CreateInput("photoPixel", types.Float).Set(ground.photo_pixel_m)
    storm.CreateOutput("surface", types.Token)
    material.CreateSurfaceOutput("glslfx").ConnectToSource(storm.ConnectableAPI(), "surface")
