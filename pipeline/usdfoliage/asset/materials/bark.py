"""The bark's material: UsdPreviewSurface and MaterialX, which all renderers draw."""

from dataclasses import dataclass

import numpy as np
from pxr import Gf, Sdf, Usd, UsdShade

from usdfoliage.asset.materials.mtlx import Source, author_image, author_open_pbr, author_primvar_color
from usdfoliage.asset.materials.picture import usd_color_space

BARK_COLOR = (0.11, 0.075, 0.05)  # linear Rec.709, of a dry trunk


@dataclass(frozen=True, kw_only=True)
class BarkMaterial:
    """What the bark's material needs to know; paths as seen from the layer's folder."""

    color: tuple[float, float, float] = BARK_COLOR  # linear, where a gprim has no displayColor
    texture: str | None = None  # picture that repeats; takes the place of the colour
    texture_m: float = 0.5  # width of what the picture shows: st is in metres
    roughness: float = 0.85

    def __post_init__(self) -> None:
        if len(self.color) != 3 or not all(0 <= c < np.inf for c in self.color):
            raise ValueError(f"color must be three numbers of 0 or more, not {self.color}")
        if not 0 <= self.roughness <= 1 or not (np.isfinite(self.texture_m) and self.texture_m > 0):
            raise ValueError("roughness must be 0 to 1, texture_m above 0")


def author_bark_material(stage: Usd.Stage, path: Sdf.Path, bark: BarkMaterial) -> UsdShade.Material:
    """Define a material that shows branches in their displayColor or a texture that is as large as on the tree."""
    material = UsdShade.Material.Define(stage, path)
    surface = UsdShade.Shader.Define(stage, path.AppendChild("PreviewSurface"))
    surface.CreateIdAttr("UsdPreviewSurface")
    color = surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    if bark.texture is None:
        reader = _author_reader(stage, path.AppendChild("Color"), "UsdPrimvarReader_float3", "displayColor")
        reader.CreateInput("fallback", Sdf.ValueTypeNames.Float3).Set(Gf.Vec3f(*bark.color))
        reader.CreateOutput("result", Sdf.ValueTypeNames.Float3)
        color.ConnectToSource(reader.ConnectableAPI(), "result")
    else:
        color.ConnectToSource(_author_texture(stage, path, bark, bark.texture).ConnectableAPI(), "rgb")
    surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(bark.roughness)
    surface.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    material.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    _author_mtlx_surface(stage, material, bark)
    return material


def _author_reader(stage: Usd.Stage, path: Sdf.Path, kind: str, varname: str) -> UsdShade.Shader:
    reader = UsdShade.Shader.Define(stage, path)
    reader.CreateIdAttr(kind)
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set(varname)
    return reader


def _author_texture(stage: Usd.Stage, path: Sdf.Path, bark: BarkMaterial, file: str) -> UsdShade.Shader:
    reader = _author_reader(stage, path.AppendChild("St"), "UsdPrimvarReader_float2", "st")
    reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    scale = UsdShade.Shader.Define(stage, path.AppendChild("Metres"))
    scale.CreateIdAttr("UsdTransform2d")
    scale.CreateInput("in", Sdf.ValueTypeNames.Float2).ConnectToSource(reader.ConnectableAPI(), "result")
    scale.CreateInput("scale", Sdf.ValueTypeNames.Float2).Set(Gf.Vec2f(1 / bark.texture_m))
    scale.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    texture = UsdShade.Shader.Define(stage, path.AppendChild("Texture"))
    texture.CreateIdAttr("UsdUVTexture")
    texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(Sdf.AssetPath(file))
    texture.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set(usd_color_space(file))
    for direction in ("wrapS", "wrapT"):
        texture.CreateInput(direction, Sdf.ValueTypeNames.Token).Set("repeat")
    texture.CreateInput("fallback", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*bark.color, 1))
    texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(scale.ConnectableAPI(), "result")
    texture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
    return texture


def _author_mtlx_surface(stage: Usd.Stage, material: UsdShade.Material, bark: BarkMaterial) -> None:
    path = material.GetPath()
    color: Source
    if bark.texture is None:
        color = author_primvar_color(stage, path.AppendChild("MtlxColor"), "displayColor", bark.color)
    else:
        image = author_image(stage, path, bark.texture, bark.color, wrap="periodic", scale=1 / bark.texture_m)
        color = image.GetOutput("rgb")
    author_open_pbr(material, color, {"specular_roughness": (Sdf.ValueTypeNames.Float, bark.roughness)})
