"""Leaf, crown and bark have one look in every description: OpenPBR, UsdPreviewSurface and glslfx."""

import json
import subprocess

import cv2
import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade
from usdfoliage.asset.looks.look import open_asset
from usdfoliage.asset.materials.bark import BarkMaterial, author_bark_material
from usdfoliage.asset.materials.crown import CrownMaterial, author_crown_material
from usdfoliage.asset.materials.leaf import LeafMaterial, author_leaf_material
from usdfoliage.asset.materials.mtlx import OPEN_PBR
from usdfoliage.asset.parts.leaf_part import LeafAppearance
from usdfoliage.errors import PreviewError
from usdfoliage.jobs.edits.bake import BakeRequest, bake_asset
from usdfoliage.jobs.preview.recorder import find_interpreter

from tests.support.leaves.assets import random_leaves, two_leaves, write_spray

CROWN = CrownMaterial(
    color_map="./color.exr",
    radius_map="./radius.exr",
    shader="./crown.glslfx",
    face_size=8,
    center_m=(0, 0, 0),
    radius_range_m=(1, 2),
)
MIDDLE = (0.25, 0.5, 0.125)
LEAF = LeafMaterial(shaders="./shaders", texture="./leaf.png", texture_color=MIDDLE, typical_color=(0.125, 0.5, 0.25))
AUTHORED = {
    "Leaf": lambda stage, path: author_leaf_material(stage, path, LEAF),
    "PlainLeaf": lambda stage, path: author_leaf_material(stage, path, LeafMaterial(shaders="./shaders")),
    "LinearLeaf": lambda stage, path: author_leaf_material(
        stage, path, LeafMaterial(shaders="./shaders", texture="./leaf.EXR", jitter_map="./jitter.png")
    ),
    "Crown": lambda stage, path: author_crown_material(stage, path, CROWN),
    "Bark": lambda stage, path: author_bark_material(stage, path, BarkMaterial(texture="./bark.jpg")),
    "PlainBark": lambda stage, path: author_bark_material(stage, path, BarkMaterial()),
}


@pytest.fixture
def stage():
    stage = Usd.Stage.CreateInMemory()
    for name, author in AUTHORED.items():
        author(stage, Sdf.Path(f"/{name}"))
    return stage


def shader(stage, path) -> UsdShade.Shader:
    return UsdShade.Shader(stage.GetPrimAtPath(path))


def test_every_file_has_its_color_space(stage):
    found = {}
    for prim in stage.Traverse():
        file = shader(stage, prim.GetPath()).GetInput("file") if prim.IsA(UsdShade.Shader) else None
        if not file:
            continue
        space = shader(stage, prim.GetPath()).GetInput("sourceColorSpace")
        found[str(prim.GetPath())] = space.Get() if space else file.GetAttr().GetColorSpace()
    assert found == {
        "/Leaf/PreviewTexture": "sRGB",
        "/Leaf/Texture": "sRGB",
        "/Leaf/TextureOpacity": "sRGB",
        "/Leaf/MtlxImage": "srgb_texture",
        "/LinearLeaf/PreviewTexture": "raw",
        "/LinearLeaf/Texture": "raw",
        "/LinearLeaf/TextureOpacity": "raw",
        "/LinearLeaf/MtlxImage": "lin_rec709",
        "/LinearLeaf/JitterMap": "raw",
        "/Crown/ColorMap": "raw",
        "/Crown/RadiusMap": "raw",
        "/Crown/MtlxImage": "lin_rec709",
        "/Bark/Texture": "sRGB",
        "/Bark/MtlxImage": "srgb_texture",
    }


@pytest.mark.parametrize("name", AUTHORED)
def test_materialx_ends_in_open_pbr(stage, name):
    material = UsdShade.Material(stage.GetPrimAtPath(f"/{name}"))
    surface, output, _ = material.ComputeSurfaceSource("mtlx")
    assert (surface.GetIdAttr().Get(), output) == (OPEN_PBR, "out")
    assert bool(surface.GetInput("geometry_thin_walled")) == ("Bark" not in name)
    assert bool(surface.GetInput("geometry_opacity")) == (name in ("Leaf", "LinearLeaf"))


@pytest.mark.parametrize(("name", "translucency"), [("PlainLeaf", 0.7), ("Crown", 0.25)])
@pytest.mark.parametrize("color", [(0.06, 0.14, 0.03), (0.3, 0.2, 0.4), (0, 0, 0)])
def test_a_thin_sheet_scatters_its_color_back_and_a_part_of_it_through(stage, name, translucency, color):
    surface = shader(stage, f"/{name}/MtlxSurface")
    base, weight, own, forwards = (
        evaluate(surface.GetInput(field), np.array(color))
        for field in ("base_color", "subsurface_weight", "subsurface_color", "subsurface_scatter_anisotropy")
    )
    np.testing.assert_allclose((1 - weight) * base + weight * own * (1 - forwards) / 2, color, rtol=1e-6)
    tint = LEAF.transmission_tint if name == "PlainLeaf" else (1, 1, 1)
    through = translucency * np.array(tint) * color
    np.testing.assert_allclose(weight * own * (1 + forwards) / 2, through, rtol=1e-6)
    if any(color):  # where MaterialX multiplies by the colour twice, its strongest channel is right
        assert weight * own.max() ** 2 == pytest.approx(through.max())


OPERATIONS = {
    "ND_multiply_color3": lambda a, b: a * b,
    "ND_divide_color3FA": lambda a, b: a / b,
    "ND_subtract_float": lambda a, b: a - b,
    "ND_max_float": max,
}


def evaluate(given, color):
    """The value of an input where the picture, or the primvar, has this colour."""
    if not given.HasConnectedSource():
        value = given.Get()
        return float(value) if isinstance(value, float) else np.array(value)
    node = UsdShade.Shader(given.GetConnectedSources()[0][0].source.GetPrim())
    kind = node.GetIdAttr().Get()
    if kind in ("ND_geompropvalue_color3", "ND_UsdUVTexture_23"):
        return color
    if kind == "ND_extract_color3":
        return evaluate(node.GetInput("in"), color)[node.GetInput("index").Get()]
    if kind == "ND_clamp_float":
        return np.clip(evaluate(node.GetInput("in"), color), node.GetInput("low").Get(), node.GetInput("high").Get())
    return OPERATIONS[kind](*(evaluate(node.GetInput(name), color) for name in ("in1", "in2")))


def test_the_tint_is_one_in_all_descriptions(stage):
    assert tints_of(stage, "/Leaf") == {"preview": (0.5, 1, 2), "mtlx": (4, 2, 8), "storm": MIDDLE}
    for name in ("LinearLeaf", "PlainLeaf"):
        assert tints_of(stage, f"/{name}") == {"preview": None, "mtlx": None, "storm": None}


def tints_of(stage, path):
    """What each description multiplies the picture by, beside the leaf's own colour; glslfx divides by its number."""

    def read(place, *inputs):
        node = shader(stage, f"{path}/{place}")
        found = node.GetInput(inputs[0]) if node else None
        return tuple(found.Get())[:3] if found and found.Get() is not None else None

    return {
        "preview": read("PreviewTexture", "scale"),
        "mtlx": read("MtlxTint", "in2"),
        "storm": read("StormSurface", "textureColor"),
    }


def test_the_tint_of_an_asset_is_that_of_its_leaves_and_a_bake_renews_it(tmp_path):
    picture = tmp_path / "leaf.png"
    cv2.imwrite(str(picture), np.full((4, 4, 4), 128, np.uint8))
    interface = write_spray(
        tmp_path / "spray",
        random_leaves(3),
        LeafAppearance(texture=picture, texture_color=MIDDLE, color=MIDDLE),
        representations=("bezier",),
    )
    assert tints_of(open_asset(interface), "/spray/mtl/Leaf")["preview"] == (1, 1, 1)
    scene = Usd.Stage.Open(str(interface))  # somebody paints the leaves, one of them brown
    instancer = UsdGeom.PrimvarsAPI(scene.GetPrimAtPath("/spray/geo/render/Leaves"))
    painted = instancer.CreatePrimvar("displayColor", Sdf.ValueTypeNames.Color3fArray, UsdGeom.Tokens.varying)
    painted.Set([Gf.Vec3f(0.375, 0.375, 0.125), Gf.Vec3f(0.375, 0.5, 0.125), Gf.Vec3f(0.9, 0.1, 0.9)])
    scene.Save()
    request = BakeRequest(
        asset=interface, output=tmp_path / "baked", name="spray", representations=None, resolution=None, source="bezier"
    )
    baked = open_asset(bake_asset(request).asset)
    assert tints_of(baked, "/spray/mtl/Leaf") == {
        "preview": (1.5, 0.75, 1),
        "mtlx": (4, 2, 8),
        "storm": MIDDLE,
    }


def test_leaves_without_colors_have_the_appearances(tmp_path):
    picture = tmp_path / "leaf.png"
    cv2.imwrite(str(picture), np.full((4, 4, 4), 128, np.uint8))
    appearance = LeafAppearance(texture=picture, texture_color=MIDDLE, color=(0.5, 0.25, 0.125))
    interface = write_spray(tmp_path / "spray", two_leaves(), appearance, representations=("bezier",))
    assert tints_of(open_asset(interface), "/spray/mtl/Leaf")["preview"] == (2, 0.5, 1)


CHECK_NODES = """
import json, sys
import bpy
bpy.utils.expose_bundled_modules()
from pxr import Sdr, Usd, UsdShade
registry, wrong, known = Sdr.Registry(), [], 0
stage = Usd.Stage.Open(sys.argv[1])
for prim in stage.Traverse():
    shader = UsdShade.Shader(prim)
    identifier = shader.GetIdAttr().Get() if shader else None
    if not identifier:
        continue
    node = registry.GetShaderNodeByIdentifier(identifier)
    if node is None:
        wrong.append(identifier)
        continue
    known += 1
    for given in shader.GetInputs():
        wanted = node.GetShaderInput(given.GetBaseName())
        if wanted is None or wanted.GetTypeAsSdfType().GetSdfType() != given.GetTypeName():
            wrong.append(f"{prim.GetPath()}.{given.GetBaseName()}: {given.GetTypeName()}")
    names = node.GetShaderOutputNames()
    wrong += [str(output.GetFullName()) for output in shader.GetOutputs() if output.GetBaseName() not in names]
print(json.dumps([known, wrong]))
"""


@pytest.mark.preview
def test_a_library_of_materialx_knows_every_node_and_its_inputs(stage, tmp_path):
    try:
        python = find_interpreter()
    except PreviewError as error:
        pytest.skip(f"the preview interpreter is absent: {error}")
    if subprocess.run([python, "-c", "import bpy"], capture_output=True, check=False).returncode:
        pytest.skip(f"{python} has no bpy, whose USD knows MaterialX")
    file = tmp_path / "materials.usda"
    stage.Export(str(file))
    done = subprocess.run([python, "-c", CHECK_NODES, file], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    known, wrong = json.loads(done.stdout.splitlines()[-1])
    assert known > 40
    assert wrong == []
