"""The bark's material: UsdPreviewSurface and MaterialX, which all renderers draw."""

from dataclasses import dataclass

import numpy as np
from pxr import Gf, Sdf, Usd, UsdShade

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
    mtlx = _author_mtlx_surface(stage, path, bark)
    material.CreateSurfaceOutput("mtlx").ConnectToSource(mtlx.ConnectableAPI(), "out")
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
    texture.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set("auto")
    for direction in ("wrapS", "wrapT"):
        texture.CreateInput(direction, Sdf.ValueTypeNames.Token).Set("repeat")
    texture.CreateInput("fallback", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*bark.color, 1))
    texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(scale.ConnectableAPI(), "result")
    texture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
    return texture


def _author_mtlx_surface(stage: Usd.Stage, path: Sdf.Path, bark: BarkMaterial) -> UsdShade.Shader:
    color = UsdShade.Shader.Define(stage, path.AppendChild("MtlxColor"))
    color.CreateOutput("out", Sdf.ValueTypeNames.Color3f)
    if bark.texture is None:
        color.CreateIdAttr("ND_geompropvalue_color3")
        color.CreateInput("geomprop", Sdf.ValueTypeNames.String).Set("displayColor")
        color.CreateInput("default", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*bark.color))
    else:
        reader = UsdShade.Shader.Define(stage, path.AppendChild("MtlxSt"))
        reader.CreateIdAttr("ND_geompropvalue_vector2")
        reader.CreateInput("geomprop", Sdf.ValueTypeNames.String).Set("st")
        reader.CreateOutput("out", Sdf.ValueTypeNames.Float2)
        scale = UsdShade.Shader.Define(stage, path.AppendChild("MtlxMetres"))
        scale.CreateIdAttr("ND_multiply_vector2")
        scale.CreateInput("in1", Sdf.ValueTypeNames.Float2).ConnectToSource(reader.ConnectableAPI(), "out")
        scale.CreateInput("in2", Sdf.ValueTypeNames.Float2).Set(Gf.Vec2f(1 / bark.texture_m))
        scale.CreateOutput("out", Sdf.ValueTypeNames.Float2)
        color.CreateIdAttr("ND_image_color3")
        file = color.CreateInput("file", Sdf.ValueTypeNames.Asset)
        file.Set(Sdf.AssetPath(bark.texture))
        linear = bark.texture.lower().endswith((".exr", ".hdr", ".pfm"))
        file.GetAttr().SetColorSpace("lin_rec709" if linear else "srgb_texture")
        color.CreateInput("texcoord", Sdf.ValueTypeNames.Float2).ConnectToSource(scale.ConnectableAPI(), "out")
    surface = UsdShade.Shader.Define(stage, path.AppendChild("MtlxSurface"))
    surface.CreateIdAttr("ND_standard_surface_surfaceshader")
    surface.CreateInput("base", Sdf.ValueTypeNames.Float).Set(1.0)
    surface.CreateInput("base_color", Sdf.ValueTypeNames.Color3f).ConnectToSource(color.ConnectableAPI(), "out")
    surface.CreateInput("specular_roughness", Sdf.ValueTypeNames.Float).Set(bark.roughness)
    surface.CreateOutput("out", Sdf.ValueTypeNames.Token)
    return surface
