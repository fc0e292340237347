"""Nodes of MaterialX as UsdShade has them, and the OpenPBR surface that all materials of an asset end in."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

from pxr import Gf, Sdf, Usd, UsdShade

from usdfoliage.asset.materials.picture import is_linear

MTLX = "mtlx"  # the render context
OPEN_PBR = "ND_open_pbr_surface_surfaceshader"
MTLX_SURFACE = "MtlxSurface"  # below the material
MAX_WEIGHT = 0.9  # of the light that shines through; the base is divided by the rest

_TYPES = Sdf.ValueTypeNames
Color = tuple[float, float, float]
Source: TypeAlias = UsdShade.Shader | UsdShade.Output  # a node stands for its output `out`
Inputs = Mapping[str, tuple[Sdf.ValueTypeName, object]]  # a source as the value is connected


@dataclass(frozen=True, kw_only=True)
class ThinSheet:
    """What a thin sheet scatters: back, and through to its other side."""

    translucency: float  # what shines through, as a part of what is scattered back
    transmission_tint: Color = (1.0, 1.0, 1.0)  # factor on the colour of that


def author_node(
    stage: Usd.Stage,
    path: Sdf.Path,
    identifier: str,
    output: Sdf.ValueTypeName | Mapping[str, Sdf.ValueTypeName],
    inputs: Inputs,
) -> UsdShade.Shader:
    """Define a node at path, with these inputs, and an output `out` of a type or several by their names."""
    node = UsdShade.Shader.Define(stage, path)
    node.CreateIdAttr(identifier)
    for name, (value_type, value) in inputs.items():
        given = node.CreateInput(name, value_type)
        if isinstance(value, UsdShade.Shader):
            given.ConnectToSource(value.ConnectableAPI(), "out")
        elif isinstance(value, UsdShade.Output):
            given.ConnectToSource(value)
        else:
            given.Set(value)
    for name, value_type in (output if isinstance(output, Mapping) else {"out": output}).items():
        node.CreateOutput(name, value_type)
    return node


def author_primvar_color(stage: Usd.Stage, path: Sdf.Path, primvar: str, fallback: Color) -> UsdShade.Shader:
    """The colour that a gprim, or an instance, has as a primvar."""
    inputs = {"geomprop": (_TYPES.String, primvar), "default": (_TYPES.Color3f, Gf.Vec3f(*fallback))}
    return author_node(stage, path, "ND_geompropvalue_color3", _TYPES.Color3f, inputs)


def author_product(stage: Usd.Stage, path: Sdf.Path, color: Source, factor: Source | Color) -> UsdShade.Shader:
    """A colour times another, or times three numbers."""
    second = factor if isinstance(factor, UsdShade.Shader | UsdShade.Output) else Gf.Vec3f(*factor)
    inputs = {"in1": (_TYPES.Color3f, color), "in2": (_TYPES.Color3f, second)}
    return author_node(stage, path, "ND_multiply_color3", _TYPES.Color3f, inputs)


def author_image(
    stage: Usd.Stage, path: Sdf.Path, file: str, fallback: Color, *, wrap: str, scale: float = 1.0
) -> UsdShade.Shader:
    """A picture by the primvar st, with its colour as the output `rgb` and its opacity as `a`.

    It is MaterialX' node UsdUVTexture. Storm gives the nodes `image` a transform of st that lies in a buffer, which
    Mesa's software renderer reads as 0 beside a face: the picture has dots of its coarsest level on small faces.

    Args:
        stage: Where it is authored.
        path: The material.
        file: The picture, as seen from the layer's folder.
        fallback: Linear colour where the picture is missing.
        wrap: "clamp" or "periodic".
        scale: Factor on st.
    """
    name = {"geomprop": (_TYPES.String, "st")}
    st = author_node(stage, path.AppendChild("MtlxSt"), "ND_geompropvalue_vector2", _TYPES.Float2, name)
    if scale != 1:
        inputs = {"in1": (_TYPES.Float2, st), "in2": (_TYPES.Float2, Gf.Vec2f(scale))}
        st = author_node(stage, path.AppendChild("MtlxScaledSt"), "ND_multiply_vector2", _TYPES.Float2, inputs)
    inputs = {
        "file": (_TYPES.Asset, Sdf.AssetPath(file)),
        "fallback": (_TYPES.Color4f, Gf.Vec4f(*fallback, 1.0)),
        "st": (_TYPES.Float2, st),
        "wrapS": (_TYPES.String, wrap),
        "wrapT": (_TYPES.String, wrap),
    }
    outputs = {"rgb": _TYPES.Color3f, "a": _TYPES.Float}
    image = author_node(stage, path.AppendChild("MtlxImage"), "ND_UsdUVTexture_23", outputs, inputs)
    image.GetInput("file").GetAttr().SetColorSpace("lin_rec709" if is_linear(file) else "srgb_texture")
    return image


def author_image_opacity(stage: Usd.Stage, path: Sdf.Path, image: UsdShade.Shader) -> UsdShade.Shader:
    """1 where a texel of the picture is opaque by half or more, else 0, for the material at path."""
    numbers = {"value1": image.GetOutput("a"), "value2": 0.5, "in1": 1.0, "in2": 0.0}
    inputs = {name: (_TYPES.Float, number) for name, number in numbers.items()}
    return author_node(stage, path.AppendChild("MtlxOpacity"), "ND_ifgreatereq_float", _TYPES.Float, inputs)


def author_open_pbr(material: UsdShade.Material, color: Source, inputs: Inputs) -> UsdShade.Shader:
    """Let a material end in an OpenPBR surface of a colour, for renderers that know MaterialX."""
    stage, path = material.GetPrim().GetStage(), material.GetPath().AppendChild(MTLX_SURFACE)
    all_inputs = {"base_color": (_TYPES.Color3f, color), **inputs}
    surface = author_node(stage, path, OPEN_PBR, _TYPES.Token, all_inputs)
    material.CreateSurfaceOutput(MTLX).ConnectToSource(surface.ConnectableAPI(), "out")
    return surface


def author_thin_open_pbr(
    material: UsdShade.Material, color: Source, sheet: ThinSheet, inputs: Inputs
) -> UsdShade.Shader:
    """The same for a thin sheet, which scatters its colour back as a surface that is not thin does.

    OpenPBR mixes the base and the subsurface light by a weight w; of a sheet, anisotropy 1 sends all subsurface light
    through. What is scattered back is (1 - w) base_color, what shines through w subsurface_color. The weight is the
    strongest channel of what shines through, and subsurface_color the rest of it, so 1 in that channel: MaterialX up to
    1.39.5 multiplies by that colour twice (its issue 3027). So base_color is little more than the colour itself, for
    applications that know no light through a sheet.
    """
    stage, path = material.GetPrim().GetStage(), material.GetPath()
    red, green, blue = (sheet.translucency * factor for factor in sheet.transmission_tint)
    through = author_product(stage, path.AppendChild("MtlxThrough"), color, (red, green, blue))
    weight = _author_strongest(stage, path, through)
    numbers: Inputs = {"in1": (_TYPES.Float, 1.0), "in2": (_TYPES.Float, weight)}
    rest = author_node(stage, path.AppendChild("MtlxRest"), "ND_subtract_float", _TYPES.Float, numbers)
    own = _author_ratio(stage, path.AppendChild("MtlxTransmitted"), through, weight)
    thin = {
        "subsurface_weight": (_TYPES.Float, weight),
        "subsurface_color": (_TYPES.Color3f, own),
        "subsurface_scatter_anisotropy": (_TYPES.Float, 1.0),
        "geometry_thin_walled": (_TYPES.Bool, True),
    }
    scattered = _author_ratio(stage, path.AppendChild("MtlxScattered"), color, rest)
    return author_open_pbr(material, scattered, {**thin, **inputs})


def _author_strongest(stage: Usd.Stage, path: Sdf.Path, color: UsdShade.Shader) -> UsdShade.Shader:
    """The largest of a colour's three numbers, kept above 0 and below 1."""
    number = _TYPES.Float
    channels = [
        author_node(
            stage,
            path.AppendChild(f"MtlxThrough{name}"),
            "ND_extract_color3",
            number,
            {"in": (_TYPES.Color3f, color), "index": (_TYPES.Int, index)},
        )
        for index, name in enumerate(("Red", "Green", "Blue"))
    ]
    largest = channels[0]
    for step, channel in enumerate(channels[1:], 1):
        pair: Inputs = {"in1": (number, largest), "in2": (number, channel)}
        largest = author_node(stage, path.AppendChild(f"MtlxLarger{step}"), "ND_max_float", number, pair)
    limits: Inputs = {"in": (number, largest), "low": (number, 1e-4), "high": (number, MAX_WEIGHT)}
    return author_node(stage, path.AppendChild("MtlxWeight"), "ND_clamp_float", number, limits)


def _author_ratio(stage: Usd.Stage, path: Sdf.Path, color: Source, number: UsdShade.Shader) -> UsdShade.Shader:
    inputs: Inputs = {"in1": (_TYPES.Color3f, color), "in2": (_TYPES.Float, number)}
    return author_node(stage, path, "ND_divide_color3FA", _TYPES.Color3f, inputs)
