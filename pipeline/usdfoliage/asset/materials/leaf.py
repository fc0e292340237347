"""The leaves' material: UsdPreviewSurface and MaterialX for any renderer, glslfx for Storm."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, Vt

from usdfoliage.asset.materials.mtlx import (
    Source,
    ThinSheet,
    author_image,
    author_image_opacity,
    author_primvar_color,
    author_product,
    author_thin_open_pbr,
)
from usdfoliage.asset.materials.picture import usd_color_space
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.jitter import PERIOD

LEAF_SHADERS = ("usdFoliageLeaf.glslfx",)  # what an asset's shaders/ needs for its leaves
LEAF_COLOR = (0.06, 0.14, 0.03)  # linear Rec.709, of a full-grown leaf of a broad-leaved tree
_IOR = 1.45  # of the cuticle, a wax

STORM_SURFACE = "StormSurface"  # below the material
TEXTURE_COLOR = "textureColor"  # an input of it
PACKED = "leaf:packed"  # what Storm reads of leaves beside silhouette3, see pack_leaves
_LENGTH_UNIT = 1 / 2048
_PHASE_UNIT = 1 / 512


@dataclass(frozen=True, kw_only=True)
class LeafMaterial:
    """What the leaves' material needs to know; paths as seen from the layer's folder.

    The numbers are the shader's parameters; their documentation explains each.
    """

    shaders: str  # the folder with LEAF_SHADERS
    texture: str | None = None  # picture of a leaf in its st, with opacity; takes the place of displayColor
    texture_color: tuple[float, float, float] | None = None  # median of the texture: displayColor over it is the tint
    jitter_map: str | None = None  # one cycle of the silhouette's jitter, see FoliageLeafAPI
    color: tuple[float, float, float] = LEAF_COLOR  # where a gprim has no displayColor
    typical_color: tuple[float, float, float] | None = None  # of all leaves, see preview_tint; None: color
    translucency: float = 0.7  # light that shines through, as a part of what is scattered back
    transmission_tint: tuple[float, float, float] = (1.8, 1.3, 0.3)  # factor on the colour of that light
    roughness: float = 0.45
    specular: float = 0.8
    underside: float = 0.35  # how much paler and duller it is
    veins: float = 0.6  # how much they differ from the blade
    vein_pairs: float = 9.0
    relief: float = 0.4  # how much the veins press the surface
    mottling: float = 0.12

    def __post_init__(self) -> None:
        for name in ("roughness", "underside", "veins", "relief", "mottling"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} must be 0 to 1, not {getattr(self, name)}")
        for name in ("translucency", "specular"):
            if not 0 <= getattr(self, name) < np.inf:
                raise ValueError(f"{name} must be 0 or more, not {getattr(self, name)}")
        if not 1 <= self.vein_pairs < np.inf:
            raise ValueError(f"vein_pairs must be 1 or more, not {self.vein_pairs}")
        if self.texture_color is not None and not all(0 < c < np.inf for c in self.texture_color):
            raise ValueError(f"texture_color must be three numbers above 0, not {self.texture_color}")
        for name in ("color", "typical_color", "transmission_tint"):
            value = getattr(self, name)
            if value is not None and (len(value) != 3 or not all(0 <= c < np.inf for c in value)):
                raise ValueError(f"{name} must be three numbers of 0 or more, not {value}")

    @property
    def preview_tint(self) -> tuple[float, float, float] | None:
        """The tint of the texture in UsdPreviewSurface, the same for all leaves: it cannot multiply by a primvar."""
        if self.texture is None or self.texture_color is None:
            return None
        typical = self.color if self.typical_color is None else self.typical_color
        red, green, blue = (own / middle for own, middle in zip(typical, self.texture_color, strict=True))
        return red, green, blue


def author_leaf_material(stage: Usd.Stage, path: Sdf.Path, leaf: LeafMaterial) -> UsdShade.Material:
    """Define a material that shows leaves in their displayColor or their texture, for three kinds of renderer."""
    material = UsdShade.Material.Define(stage, path)
    texture = _author_texture(stage, path, leaf, leaf.texture) if leaf.texture else None
    surface = _author_preview_surface(stage, path.AppendChild("PreviewSurface"), leaf, texture)
    material.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    _author_mtlx_surface(stage, material, leaf)
    surface = _author_storm_surface(stage, path.AppendChild(STORM_SURFACE), leaf, texture)
    material.CreateSurfaceOutput("glslfx").ConnectToSource(surface.ConnectableAPI(), "surface")
    material.CreateDisplacementOutput("glslfx").ConnectToSource(surface.ConnectableAPI(), "displacement")
    if leaf.jitter_map:
        author_jitter_texture(material, leaf.jitter_map)
    return material


def author_jitter_texture(material: UsdShade.Material, file: str) -> None:
    """Let Storm jitter the leaves of a material by a map: the opinions that a look adds to it.

    Args:
        material: What author_leaf_material defined, or an over of it.
        file: The map, as seen from the layer's folder.
    """
    stage, path = material.GetPrim().GetStage(), material.GetPath()
    texture = UsdShade.Shader.Define(stage, path.AppendChild("JitterMap"))
    _set_texture(texture, file, "raw", "repeat")
    texture.CreateInput("fallback", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(0.5))
    texture.CreateOutput("r", Sdf.ValueTypeNames.Float)
    surface = UsdShade.Shader(stage.OverridePrim(path.AppendChild(STORM_SURFACE)))
    surface.CreateInput("jitterMap", Sdf.ValueTypeNames.Float).ConnectToSource(texture.ConnectableAPI(), "r")


def pack_leaves(leaves: Leaves) -> NDArray[np.float32]:
    """What Storm reads of leaves beside silhouette3: (1 + 19 N,) float32, whole numbers.

    The number of leaves N; then, number after number and of all leaves each, axis2, inner and outer in 1/2048 of the
    leaf's length, the phase in 1/512 of a cycle, axis1, silhouette1 and silhouette2 in 1/2048 of
    the length.
    """
    lengths = leaves.parameters[:, (1, 5, 6)].reshape(-1, 9) / _LENGTH_UNIT
    phase = (leaves.phase % PERIOD) / _PHASE_UNIT
    first = leaves.parameters[:, (0, 2, 3)].reshape(-1, 9) / _LENGTH_UNIT
    numbers = np.round(np.column_stack([lengths, phase, first])).T
    return np.concatenate([[len(leaves)], numbers.ravel()]).astype(np.float32)


def author_packed_leaves(instancer: UsdGeom.PointInstancer, leaves: Leaves) -> None:
    """Give Storm what it does not read of an instancer's leaves from the primvars of FoliageLeafAPI.

    Storm binds a storage buffer for each primvar of an instancer that a shader names, and OpenGL often has 16 in all:
    too few for all the primvars, the colours and an instance of the plant. A constant array, which the prototype
    inherits, needs none. Of single floats, because Storm packs an array of float3 more tightly than its shaders read
    it; of whole numbers, because crate files compress those.
    """
    primvar = UsdGeom.PrimvarsAPI(instancer).CreatePrimvar(
        PACKED, Sdf.ValueTypeNames.FloatArray, UsdGeom.Tokens.constant
    )
    primvar.Set(Vt.FloatArray.FromNumpy(pack_leaves(leaves)))


def _author_st(stage: Usd.Stage, path: Sdf.Path) -> UsdShade.Shader:
    reader = UsdShade.Shader.Define(stage, path)
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
    reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    return reader


def _set_texture(texture: UsdShade.Shader, file: str, color_space: str, wrap: str) -> None:
    reader = _author_st(texture.GetPrim().GetStage(), texture.GetPath().GetParentPath().AppendChild("St"))
    texture.CreateIdAttr("UsdUVTexture")
    texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(Sdf.AssetPath(file))
    texture.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set(color_space)
    for direction in ("wrapS", "wrapT"):
        texture.CreateInput(direction, Sdf.ValueTypeNames.Token).Set(wrap)
    texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(reader.ConnectableAPI(), "result")


@dataclass(frozen=True, kw_only=True)
class _Texture:
    """One file, read by three nodes.

    Each names the colour space: with `auto` Blender takes the colours for data where a second node feeds the opacity.
    The first has the tint of UsdPreviewSurface; Storm's shader tints each leaf by itself. The opacity has a node of its
    own, with a fallback of 1: where the file is missing, Storm takes the first number of the fallback for `a`.
    """

    preview: UsdShade.Shader
    color: UsdShade.Shader
    opacity: UsdShade.Shader


def _author_texture(stage: Usd.Stage, path: Sdf.Path, leaf: LeafMaterial, file: str) -> _Texture:
    preview = _author_colors(stage, path.AppendChild("PreviewTexture"), leaf, file)
    preview.CreateOutput("a", Sdf.ValueTypeNames.Float)
    if leaf.preview_tint is not None:
        preview.CreateInput("scale", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*leaf.preview_tint, 1.0))
    color = _author_colors(stage, path.AppendChild("Texture"), leaf, file)
    opacity = UsdShade.Shader.Define(stage, path.AppendChild("TextureOpacity"))
    _set_texture(opacity, file, usd_color_space(file), "clamp")
    opacity.CreateInput("fallback", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(1.0))
    opacity.CreateOutput("a", Sdf.ValueTypeNames.Float)
    return _Texture(preview=preview, color=color, opacity=opacity)


def _author_colors(stage: Usd.Stage, path: Sdf.Path, leaf: LeafMaterial, file: str) -> UsdShade.Shader:
    texture = UsdShade.Shader.Define(stage, path)
    _set_texture(texture, file, usd_color_space(file), "clamp")
    texture.CreateInput("fallback", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*leaf.color, 1.0))
    texture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
    return texture


def _author_preview_surface(
    stage: Usd.Stage, path: Sdf.Path, leaf: LeafMaterial, texture: _Texture | None
) -> UsdShade.Shader:
    surface = UsdShade.Shader.Define(stage, path)
    surface.CreateIdAttr("UsdPreviewSurface")
    color = surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    if texture is None:
        reader = UsdShade.Shader.Define(stage, path.GetParentPath().AppendChild("Color"))
        reader.CreateIdAttr("UsdPrimvarReader_float3")
        reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("displayColor")
        reader.CreateInput("fallback", Sdf.ValueTypeNames.Float3).Set(Gf.Vec3f(*leaf.color))
        reader.CreateOutput("result", Sdf.ValueTypeNames.Float3)
        color.ConnectToSource(reader.ConnectableAPI(), "result")
    else:
        color.ConnectToSource(texture.preview.ConnectableAPI(), "rgb")
        opacity = surface.CreateInput("opacity", Sdf.ValueTypeNames.Float)
        opacity.ConnectToSource(texture.opacity.ConnectableAPI(), "a")
        surface.CreateInput("opacityThreshold", Sdf.ValueTypeNames.Float).Set(0.5)
    surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(leaf.roughness)
    surface.CreateInput("ior", Sdf.ValueTypeNames.Float).Set(_IOR)
    surface.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    return surface


def _author_mtlx_surface(stage: Usd.Stage, material: UsdShade.Material, leaf: LeafMaterial) -> None:
    path, types = material.GetPath(), Sdf.ValueTypeNames
    inputs: dict[str, tuple[Sdf.ValueTypeName, object]] = {
        "specular_weight": (types.Float, leaf.specular),
        "specular_roughness": (types.Float, leaf.roughness),
        "specular_ior": (types.Float, _IOR),
    }
    color: Source
    if leaf.texture is None:
        color = author_primvar_color(stage, path.AppendChild("MtlxColor"), "displayColor", leaf.color)
    else:
        image = author_image(stage, path, leaf.texture, leaf.color, wrap="clamp")
        color = image.GetOutput("rgb")
        inputs["geometry_opacity"] = (types.Float, author_image_opacity(stage, path, image))
        if leaf.texture_color is not None:
            own = author_primvar_color(stage, path.AppendChild("MtlxDisplayColor"), "displayColor", leaf.texture_color)
            red, green, blue = leaf.texture_color
            tint = author_product(stage, path.AppendChild("MtlxTint"), own, (1 / red, 1 / green, 1 / blue))
            color = author_product(stage, path.AppendChild("MtlxTinted"), color, tint)
    sheet = ThinSheet(translucency=leaf.translucency, transmission_tint=leaf.transmission_tint)
    author_thin_open_pbr(material, color, sheet, inputs)


def _author_storm_surface(
    stage: Usd.Stage, path: Sdf.Path, leaf: LeafMaterial, texture: _Texture | None
) -> UsdShade.Shader:
    surface = UsdShade.Shader.Define(stage, path)
    surface.SetSourceAsset(Sdf.AssetPath(f"{leaf.shaders}/{LEAF_SHADERS[0]}"), "glslfx")
    # The types are those that Storm's parser derives from the shader's defaults: three numbers are a colour to it.
    for name, value in (
        ("translucency", leaf.translucency),
        ("roughness", leaf.roughness),
        ("specular", leaf.specular),
        ("underside", leaf.underside),
        ("veins", leaf.veins),
        ("veinPairs", leaf.vein_pairs),
        ("relief", leaf.relief),
        ("mottling", leaf.mottling),
    ):
        surface.CreateInput(name, Sdf.ValueTypeNames.Float).Set(value)
    surface.CreateInput("transmissionTint", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*leaf.transmission_tint))
    if texture is not None:
        color = surface.CreateInput("leafTexture", Sdf.ValueTypeNames.Color3f)
        color.ConnectToSource(texture.color.ConnectableAPI(), "rgb")
        opacity = surface.CreateInput("leafOpacity", Sdf.ValueTypeNames.Float)
        opacity.ConnectToSource(texture.opacity.ConnectableAPI(), "a")
        if leaf.texture_color is not None:
            surface.CreateInput(TEXTURE_COLOR, Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*leaf.texture_color))
    surface.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    surface.CreateOutput("displacement", Sdf.ValueTypeNames.Token)
    return surface
