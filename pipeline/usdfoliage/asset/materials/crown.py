"""The crown's material: UsdPreviewSurface and MaterialX for any renderer, glslfx for Storm."""

from dataclasses import dataclass

from pxr import Gf, Sdf, Usd, UsdShade

from usdfoliage.asset.materials.mtlx import ThinSheet, author_image, author_thin_open_pbr

CROWN_SHADER = "usdFoliageCrown.glslfx"
RELIEF_SHADER = "usdFoliageCrownRelief.glslfx"
LEAVES_SHADER = "usdFoliageCrownLeaves.glslfx"
LEAF_ROUGHNESS = 0.8  # a crown scatters light; single leaves shine, their sum does not
TRANSLUCENCY = 0.25  # light that shines through, as a part of what is scattered back
MISSING_COLOR = (0.1, 0.2, 0.05)  # linear, where the map is missing


@dataclass(frozen=True, kw_only=True)
class CrownMaterial:
    """What the crown's material needs to know; paths as seen from the layer's folder."""

    color_map: str
    radius_map: str
    shader: str  # the glslfx source
    face_size: int  # texels along an edge of the cubemaps
    center_m: tuple[float, float, float]
    radius_range_m: tuple[float, float]
    mean_color: tuple[float, float, float] = MISSING_COLOR  # linear
    relief_shader: str = ""  # the glslfx source of the relief, where there is one


def author_crown_material(stage: Usd.Stage, path: Sdf.Path, crown: CrownMaterial) -> UsdShade.Material:
    """Define a material that shows the colour cubemap by the mesh's st, for three kinds of renderer."""
    material = UsdShade.Material.Define(stage, path)
    texture = _author_map(stage, path.AppendChild("ColorMap"), crown.color_map, "rgb", Sdf.ValueTypeNames.Float3)
    surface = _author_preview_surface(stage, path.AppendChild("PreviewSurface"), texture)
    material.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    _author_mtlx_surface(stage, material, crown)
    radius = _author_map(stage, path.AppendChild("RadiusMap"), crown.radius_map, "r", Sdf.ValueTypeNames.Float)
    surface = _author_storm_surface(stage, path.AppendChild("StormSurface"), crown, crown.shader, texture, radius)
    material.CreateSurfaceOutput("glslfx").ConnectToSource(surface.ConnectableAPI(), "surface")
    return material


def author_relief_material(stage: Usd.Stage, path: Sdf.Path, crown: CrownMaterial) -> UsdShade.Material:
    """Define the material of a crown's hull, in which Storm draws the crown; others draw the hull in one colour."""
    material = UsdShade.Material.Define(stage, path)
    surface = UsdShade.Shader.Define(stage, path.AppendChild("PreviewSurface"))
    surface.CreateIdAttr("UsdPreviewSurface")
    surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*crown.mean_color))
    surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(LEAF_ROUGHNESS)
    surface.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    material.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    color = _author_map(stage, path.AppendChild("ColorMap"), crown.color_map, "rgb", Sdf.ValueTypeNames.Float3)
    radius = _author_map(stage, path.AppendChild("RadiusMap"), crown.radius_map, "r", Sdf.ValueTypeNames.Float)
    storm = _author_storm_surface(stage, path.AppendChild("StormSurface"), crown, crown.relief_shader, color, radius)
    material.CreateSurfaceOutput("glslfx").ConnectToSource(storm.ConnectableAPI(), "surface")
    return material


@dataclass(frozen=True, kw_only=True)
class CrownLeavesMaterial:
    """What the material of a crown's leaves needs to know; paths as seen from the layer's folder."""

    leaf_map: str  # picture with alpha, sRGB
    leaf_brightness: float = 1.0  # factor on its colours, which makes them 1 on average
    color_map: str  # the colours of all leaves, sRGB
    shader: str  # the glslfx source
    clusters: int
    leaves: int  # of a cluster
    radius_in_clusters: float  # of the crown, in that of its largest clusters


def author_crown_leaves_material(
    stage: Usd.Stage, path: Sdf.Path, crown: CrownMaterial, leaves: CrownLeavesMaterial
) -> UsdShade.Material:
    """Define the material of a crown's leaves, cut out by a picture.

    In Storm each leaf has the crown's colour where it is; elsewhere it has that of its cluster.
    """
    material = UsdShade.Material.Define(stage, path)
    texture = _author_preview_texture(stage, path.AppendChild("LeafMap"), leaves.leaf_map, "sRGB")
    texture.CreateInput("scale", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*[leaves.leaf_brightness] * 3, 1))
    texture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
    texture.CreateOutput("rgba", Sdf.ValueTypeNames.Float4)
    texture.CreateOutput("a", Sdf.ValueTypeNames.Float)
    color = UsdShade.Shader.Define(stage, path.AppendChild("Color"))
    color.CreateIdAttr("UsdPrimvarReader_float3")
    color.CreateInput("varname", Sdf.ValueTypeNames.String).Set("displayColor")
    color.CreateInput("fallback", Sdf.ValueTypeNames.Float3).Set(Gf.Vec3f(*crown.mean_color))
    color.CreateOutput("result", Sdf.ValueTypeNames.Float3)
    surface = UsdShade.Shader.Define(stage, path.AppendChild("PreviewSurface"))
    surface.CreateIdAttr("UsdPreviewSurface")
    number = Sdf.ValueTypeNames.Float
    surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(color.ConnectableAPI(), "result")
    surface.CreateInput("opacity", number).ConnectToSource(texture.ConnectableAPI(), "a")
    surface.CreateInput("opacityThreshold", number).Set(0.5)
    surface.CreateInput("roughness", number).Set(LEAF_ROUGHNESS)
    surface.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    material.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    colors = _author_preview_texture(stage, path.AppendChild("LeafColorMap"), leaves.color_map, "sRGB")
    colors.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
    radius = _author_map(stage, path.AppendChild("RadiusMap"), crown.radius_map, "r", number)
    storm = _author_storm_surface(stage, path.AppendChild("StormSurface"), crown, leaves.shader, colors, radius)
    storm.CreateInput("leafMap", Sdf.ValueTypeNames.Float4).ConnectToSource(texture.ConnectableAPI(), "rgba")
    storm.CreateInput("leaves", number).Set(float(leaves.leaves))
    storm.CreateInput("clusters", number).Set(float(leaves.clusters))
    storm.CreateInput("mostClusters", number).Set(float(leaves.clusters))
    storm.CreateInput("radiusInClusters", number).Set(leaves.radius_in_clusters)
    material.CreateSurfaceOutput("glslfx").ConnectToSource(storm.ConnectableAPI(), "surface")
    return material


def _author_map(stage: Usd.Stage, path: Sdf.Path, file: str, output: str, kind: Sdf.ValueTypeName) -> UsdShade.Shader:
    """A texture of linear numbers with one output."""
    texture = _author_preview_texture(stage, path, file)
    texture.CreateOutput(output, kind)
    return texture


def _author_preview_texture(stage: Usd.Stage, path: Sdf.Path, file: str, color_space: str = "raw") -> UsdShade.Shader:
    """A texture by the mesh's st; raw holds linear numbers, or no colours."""
    reader = UsdShade.Shader.Define(stage, path.GetParentPath().AppendChild("St"))
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
    reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)

    texture = UsdShade.Shader.Define(stage, path)
    texture.CreateIdAttr("UsdUVTexture")
    texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(Sdf.AssetPath(file))
    texture.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set(color_space)
    for wrap in ("wrapS", "wrapT"):
        texture.CreateInput(wrap, Sdf.ValueTypeNames.Token).Set("clamp")
    texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(reader.ConnectableAPI(), "result")
    return texture


def _author_preview_surface(stage: Usd.Stage, path: Sdf.Path, texture: UsdShade.Shader) -> UsdShade.Shader:
    surface = UsdShade.Shader.Define(stage, path)
    surface.CreateIdAttr("UsdPreviewSurface")
    surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(texture.ConnectableAPI(), "rgb")
    surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(LEAF_ROUGHNESS)
    surface.CreateInput("ior", Sdf.ValueTypeNames.Float).Set(1.3)
    surface.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    return surface


def _author_mtlx_surface(stage: Usd.Stage, material: UsdShade.Material, crown: CrownMaterial) -> None:
    image = author_image(stage, material.GetPath(), crown.color_map, MISSING_COLOR, wrap="clamp")
    sheet = ThinSheet(translucency=TRANSLUCENCY)
    number = Sdf.ValueTypeNames.Float
    gloss = {"specular_weight": (number, 0.3), "specular_roughness": (number, LEAF_ROUGHNESS)}
    author_thin_open_pbr(material, image.GetOutput("rgb"), sheet, gloss)


def _author_storm_surface(
    stage: Usd.Stage,
    path: Sdf.Path,
    crown: CrownMaterial,
    shader: str,
    color: UsdShade.Shader,
    radius: UsdShade.Shader,
) -> UsdShade.Shader:
    surface = UsdShade.Shader.Define(stage, path)
    surface.SetSourceAsset(Sdf.AssetPath(shader), "glslfx")
    # The types are those that Storm's parser derives from the shader's defaults: three numbers are a colour to it.
    surface.CreateInput("colorMap", Sdf.ValueTypeNames.Color3f).ConnectToSource(color.ConnectableAPI(), "rgb")
    surface.CreateInput("radiusMap", Sdf.ValueTypeNames.Float).ConnectToSource(radius.ConnectableAPI(), "r")
    surface.CreateInput("center", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*crown.center_m, 1.0))
    surface.CreateInput("radiusRange", Sdf.ValueTypeNames.Float2).Set(Gf.Vec2f(*crown.radius_range_m))
    surface.CreateInput("faceSize", Sdf.ValueTypeNames.Float).Set(float(crown.face_size))
    surface.CreateInput("meanColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*crown.mean_color))
    surface.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    return surface
