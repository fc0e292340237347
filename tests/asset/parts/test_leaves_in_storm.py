"""What Storm draws of leaves: the shader's leaves are those of the mesh, edits, jitter and light included."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdValidation
from scipy.spatial.transform import Rotation
from usdfoliage.asset.materials.leaf import LeafMaterial, author_leaf_material, pack_leaves
from usdfoliage.asset.parts.leaf_primvars import author_edits, author_leaf_primvars
from usdfoliage.jobs.preview.pictures import PreviewSettings, PreviewView, draw_views, encode_png, finish_picture
from usdfoliage.leaf.shape.edits import LeafEdits
from usdfoliage.leaf.shape.jitter import PERIOD
from usdfoliage.leaf.shape.mesh import PrototypeSettings
from usdfoliage.leaf.shape.surface import axis_points
from usdfoliage.leaf.shape.variation import default_leaf

from tests.support.leaves.storm import (
    COLOR,
    EDITED,
    JITTER_WAVE,
    SHADERS,
    Scene,
    author_baked,
    author_instancer,
    author_material,
    heap,
    move,
    new_stage,
    one_leaf,
)

pytestmark = pytest.mark.preview

SIZE_PX = 320
HALF_M = 1.1  # of a picture's side
APART_M = 10.0
VARIATION = "foliage:variation"
JITTERED = replace(EDITED, jitter_amplitude=0.06, jitter_frequency=5.0)


def draw(file: Path, places, azimuths=("front",)):
    """A picture (H, W, 4), linear, around each (x, 0.4) of the stage, from each direction."""
    views = []
    for direction in azimuths:
        turned = -1 if direction == "back" else 1
        for x in places:
            window = (turned * x - HALF_M, turned * x + HALF_M, 0.4 - HALF_M, 0.4 + HALF_M)
            views.append(PreviewView(output=Path("unused.png"), direction=direction, orthographic=True, window=window))
    return draw_views(file, views, PreviewSettings(width_px=SIZE_PX, height_px=SIZE_PX))


def silhouette_iou(first, second):
    a, b = first[..., 3] > 0.5, second[..., 3] > 0.5
    return np.count_nonzero(a & b) / np.count_nonzero(a | b)


def color_difference(first, second):
    """Mean over the union of the silhouettes and the channels, in 255ths of sRGB."""
    union = (first[..., 3] > 0) | (second[..., 3] > 0)
    a, b = (finish_picture(picture, (0.36, 0.37, 0.38))[union].astype(float) for picture in (first, second))
    return np.abs(a - b).mean()


@pytest.fixture(scope="module")
def jitter_map(tmp_path_factory):
    """The wave in the first of two rows; the other is nothing but wrong."""
    path = tmp_path_factory.mktemp("maps") / "jitter.exr"
    rows = np.float32([JITTER_WAVE * 0.5 + 0.5, np.ones(len(JITTER_WAVE))])
    OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, {"R": rows}).write(str(path))
    return path


def repeat_once(stage, path, plant):
    """Place a plant by a PointInstancer, where the others of its kind are placed by transforms."""
    instancer = UsdGeom.PointInstancer.Define(stage, path)
    prototype = UsdGeom.Xform.Define(stage, f"{path}/Prototypes/Plant")
    prototype.GetPrim().GetReferences().AddInternalReference(plant)
    instancer.CreatePrototypesRel().SetTargets([prototype.GetPath()])
    instancer.CreateProtoIndicesAttr([0])
    instancer.CreatePositionsAttr([Gf.Vec3f(0.1, 0.2, 0.0)])
    x, y, z, w = map(float, Rotation.from_euler("xyz", [20, 130, 35], degrees=True).as_quat())
    instancer.CreateOrientationsfAttr([Gf.Quatf(w, x, y, z)])
    instancer.CreateScalesAttr([Gf.Vec3f(-0.9, 1.2, 0.7)])


@pytest.fixture(scope="module")
def pairs(tmp_path_factory, jitter_map):
    """Pictures (of the instancer, of the mesh) of every scene, from the front and from the back."""
    one, many = one_leaf(default_leaf()), heap()
    scenes = {
        "plain": Scene(leaves=one),
        "plain heap": Scene(leaves=many),
        "edited": Scene(leaves=one, edits=EDITED),
        "edited heap": Scene(leaves=many, edits=EDITED),
        "jittered": Scene(leaves=one, edits=JITTERED),
        "jittered heap": Scene(leaves=many, edits=JITTERED),
        "jitter map": Scene(leaves=one, edits=JITTERED, jitter_map=jitter_map),
        "jitter map heap": Scene(leaves=many, edits=JITTERED, jitter_map=jitter_map),
        "nested": Scene(leaves=many, edits=JITTERED),
        "instance": Scene(leaves=many, edits=JITTERED),
        "point instancer": Scene(leaves=many, edits=JITTERED),
    }
    file = tmp_path_factory.mktemp("storm") / "pairs.usda"
    stage = new_stage(file)
    plain = author_material(stage, "/Leaf")
    mapped = author_material(stage, "/LeafWithMap", jitter_map=str(jitter_map))
    places = []
    for number, (name, scene) in enumerate(scenes.items()):
        material = mapped if scene.jitter_map else plain
        for form, author in enumerate((author_instancer, author_baked)):
            x = APART_M * (2 * number + form)
            places.append(x)
            path = f"/Place_{number}_{form}"
            move(stage, path, x)
            if name not in ("nested", "instance", "point instancer"):
                author(stage, f"{path}/Leaves", scene, material)
                continue
            plant = stage.CreateClassPrim(f"/_Plant_{number}_{form}")
            UsdGeom.Xform.Define(stage, plant.GetPath())
            author(stage, f"{plant.GetPath()}/Leaves", scene, author_material(stage, f"{plant.GetPath()}/Leaf"))
            plant.SetSpecifier(Sdf.SpecifierClass)
            if form == 0:  # OpenGL has few storage buffers, and this takes one more
                color_leaves(stage.GetPrimAtPath(f"{plant.GetPath()}/Leaves"), [COLOR] * len(many))
            if name == "point instancer" and form == 0:
                repeat_once(stage, f"{path}/Plants", plant.GetPath())
                continue
            placed = UsdGeom.Xform.Define(stage, f"{path}/Plant")
            placed.AddTranslateOp().Set(Gf.Vec3d(0.1, 0.2, 0.0))
            placed.AddRotateXYZOp().Set(Gf.Vec3f(20, 130, 35))
            placed.AddScaleOp().Set(Gf.Vec3f(-0.9, 1.2, 0.7))
            placed.GetPrim().GetReferences().AddInternalReference(plant.GetPath())
            placed.GetPrim().SetInstanceable(name == "instance")
    stage.Save()
    pictures = draw(file, places, ("front", "back"))
    half = len(pictures) // 2
    pairs = {}
    for number, name in enumerate(scenes):
        for direction, first in (("front", 0), ("back", half)):
            pairs[name, direction] = pictures[first + 2 * number : first + 2 * number + 2]
    return pairs


SCENES = (
    "plain",
    "plain heap",
    "edited",
    "edited heap",
    "jittered",
    "jittered heap",
    "jitter map",
    "jitter map heap",
    "nested",
    "instance",
    "point instancer",
)


@pytest.mark.parametrize("direction", ["front", "back"])
@pytest.mark.parametrize("scene", SCENES)
def test_shader_and_mesh_are_the_same_leaves(pairs, scene, direction):
    evaluated, baked = pairs[scene, direction]
    assert np.count_nonzero(baked[..., 3] > 0.5) > 2500
    assert silhouette_iou(evaluated, baked) >= 0.995
    assert color_difference(evaluated, baked) <= 2.0


def test_the_prototype_that_assets_have_is_fine_enough(tmp_path):
    stage = new_stage(tmp_path / "prototype.usda")
    material = author_material(stage, "/Leaf")
    for number, edits in enumerate((EDITED, JITTERED)):
        scene = Scene(leaves=one_leaf(default_leaf()), edits=edits)
        move(stage, f"/Bezier_{number}", APART_M * 2 * number)
        author_instancer(stage, f"/Bezier_{number}/Leaves", scene, material, PrototypeSettings())
        move(stage, f"/Mesh_{number}", APART_M * (2 * number + 1))
        author_baked(stage, f"/Mesh_{number}/Leaves", scene, material)
    stage.Save()
    pictures = draw(tmp_path / "prototype.usda", [APART_M * place for place in range(4)])
    for evaluated, baked in (pictures[:2], pictures[2:]):
        assert silhouette_iou(evaluated, baked) >= 0.995
        assert color_difference(evaluated, baked) <= 2.0


@pytest.fixture(scope="module")
def picture_of_a_leaf(tmp_path_factory):
    """Red on the left of the axis, blue on the right of it, opaque below the middle only; file to linear."""
    path = tmp_path_factory.mktemp("maps") / "leaf.png"
    pixels = np.zeros((64, 64, 4), np.uint8)
    pixels[:, :32, 0] = 200
    pixels[:, 32:, 2] = 200
    pixels[32:, :, 3] = 255
    path.write_bytes(encode_png(pixels))
    return path


@pytest.fixture(scope="module")
def variations(tmp_path_factory, picture_of_a_leaf, jitter_map):
    """Pictures of the default leaf, by what its material and its primvars have or lack."""
    leaf = one_leaf(default_leaf())
    folder = tmp_path_factory.mktemp("variations")
    stage = new_stage(folder / "variations.usda")
    texture, wave = str(picture_of_a_leaf), str(jitter_map)
    jittered = LeafEdits(jitter_amplitude=0.06, jitter_frequency=5.0)
    cases = {
        "plain": (Scene(leaves=leaf), {}),
        "texture": (Scene(leaves=leaf), {"texture": texture}),
        "tinted": (Scene(leaves=leaf), {"texture": texture, "texture_color": (0.25, 0.5, 0.125)}),
        "map": (Scene(leaves=leaf, edits=jittered, jitter_map=jitter_map), {"jitter_map": wave}),
        "both": (Scene(leaves=leaf, edits=jittered, jitter_map=jitter_map), {"texture": texture, "jitter_map": wave}),
        "jittered": (Scene(leaves=leaf, edits=jittered), {}),
        "no edits": (Scene(leaves=leaf), {}),
        "no edits, other prototype": (Scene(leaves=leaf), {}),
        "lost texture": (Scene(leaves=leaf), {"texture": str(folder / "lost.png")}),
        "lost map": (Scene(leaves=leaf, edits=jittered), {"jitter_map": str(folder / "lost.exr")}),
        "red": (Scene(leaves=leaf), {}),
        "hero": (Scene(leaves=leaf), {}),
    }
    for number, (name, (scene, fields)) in enumerate(cases.items()):
        path = f"/Place_{number}"
        move(stage, path, APART_M * number)
        material = author_material(stage, f"{path}/Leaf", **fields)
        if name == "hero":  # parameters on the gprim itself: its points are what counts
            mesh = author_baked(stage, f"{path}/Leaves", scene, material).GetPrim()
            author_leaf_primvars(mesh, replace_parameters(leaf, 0.5 * default_leaf()), UsdGeom.Tokens.constant)
            author_edits(mesh, EDITED)
            continue
        instancer = author_instancer(stage, f"{path}/Leaves", scene, material).GetPrim()
        if name.startswith("no edits"):
            for attribute in instancer.GetAuthoredAttributes():
                if attribute.GetName().startswith(("primvars:leaf:edit:", "primvars:leaf:phase")):
                    instancer.RemoveProperty(attribute.GetName())
        if name.endswith("other prototype"):
            prototype = UsdGeom.Mesh(instancer.GetChild("Prototypes").GetChild("Leaf"))
            prototype.GetPointsAttr().Set([(x, y, 0.3) for x, y, _ in prototype.GetPointsAttr().Get()])
        if name == "tinted":
            color_leaves(instancer, [(0.125, 0.5, 0.25)])
        if name == "red":
            color_leaves(instancer, [(0.5, 0.0, 0.0)])
    stage.Save()
    pictures = draw(folder / "variations.usda", [APART_M * number for number in range(len(cases))])
    return dict(zip(cases, pictures, strict=True))


@pytest.mark.parametrize("name", ["no edits", "no edits, other prototype", "hero"])
def test_what_is_not_authored_changes_nothing(variations, name):
    assert silhouette_iou(variations[name], variations["plain"]) >= 0.999
    assert color_difference(variations[name], variations["plain"]) <= 0.3


def test_texture_is_the_color_and_its_opacity_cuts(variations):
    plain, cut = variations["plain"][..., 3] > 0.5, variations["texture"][..., 3] > 0.5
    middle = row_of(default_leaf_height(0.5))
    np.testing.assert_array_equal(cut[middle + 16 :], plain[middle + 16 :])
    assert not cut[: middle - 8].any()
    assert cut[middle + 16 :].sum() > 600
    rgb = variations["texture"][row_of(0.3), :, :3]
    left, right = SIZE_PX // 2 - 20, SIZE_PX // 2 + 20
    assert rgb[left, 0] > 4 * rgb[left, 2]
    assert rgb[right, 2] > 4 * rgb[right, 0]


def test_a_texture_is_tinted_by_the_color_of_each_leaf(variations):
    plain, tinted = (variations[name][row_of(0.3), :, :3] for name in ("texture", "tinted"))
    left, right = SIZE_PX // 2 - 20, SIZE_PX // 2 + 20
    assert tinted[left, 0] / plain[left, 0] == pytest.approx(0.5, rel=0.15)
    assert tinted[right, 2] / plain[right, 2] == pytest.approx(2.0, rel=0.15)


def test_texture_and_map_do_not_need_each_other(variations):
    both, by_map = variations["both"][..., 3] > 0.5, variations["map"][..., 3] > 0.5
    below = slice(row_of(default_leaf_height(0.5)) + 16, None)
    np.testing.assert_array_equal(both[below], by_map[below])
    assert silhouette_iou(variations["map"], variations["plain"]) < 0.97
    assert silhouette_iou(variations["map"], variations["jittered"]) < 0.97


@pytest.mark.parametrize("name", ["lost texture", "lost map"])
def test_lost_file_leaves_a_leaf(variations, name):
    lost, plain = variations[name], variations["plain"]
    assert silhouette_iou(lost, plain) >= 0.999
    assert color_difference(lost, plain) <= 8.0


def test_leaf_has_its_own_color_where_the_instancer_has_one(variations):
    picture = variations["red"]
    rgb = picture[picture[..., 3] > 0.5][:, :3].mean(axis=0)
    assert rgb[0] > 4 * rgb[1]


def test_each_instance_of_a_plant_has_its_own_variation_of_colour(tmp_path):
    """By native instances, by a PointInstancer, and of a plant that is no instance, with a colour a leaf."""
    file, factors = tmp_path / "set.usda", ((1.0, 1.0, 1.0), (3.0, 0.5, 1.0))
    stage = new_stage(file)
    plant = stage.CreateClassPrim("/_Plant")
    UsdGeom.Xform.Define(stage, plant.GetPath())
    author_instancer(
        stage, "/_Plant/Leaves", Scene(leaves=one_leaf(flat_leaf())), author_material(stage, "/_Plant/Leaf")
    )
    color_leaves(stage.GetPrimAtPath("/_Plant/Leaves"), [COLOR])
    plant.SetSpecifier(Sdf.SpecifierClass)
    for number, factor in enumerate(factors):
        for form in (0, 1):
            move(stage, f"/Place_{number}_{form}", APART_M * (2 * number + form))
            placed = UsdGeom.Xform.Define(stage, f"/Place_{number}_{form}/Plant")
            placed.GetPrim().GetReferences().AddInternalReference(plant.GetPath())
            placed.GetPrim().SetInstanceable(form == 0)
            variation = UsdGeom.PrimvarsAPI(placed).CreatePrimvar(VARIATION, Sdf.ValueTypeNames.Color3f, "constant")
            variation.Set(Gf.Vec3f(*factor))
    instancer = UsdGeom.PointInstancer.Define(stage, "/Plants")
    prototype = UsdGeom.Xform.Define(stage, "/Plants/Prototypes/Plant")
    prototype.GetPrim().GetReferences().AddInternalReference(plant.GetPath())
    instancer.CreatePrototypesRel().SetTargets([prototype.GetPath()])
    instancer.CreateProtoIndicesAttr([0, 0])
    instancer.CreatePositionsAttr([Gf.Vec3f(APART_M * (4 + number), 0, 0) for number in (0, 1)])
    variation = UsdGeom.PrimvarsAPI(instancer).CreatePrimvar(VARIATION, Sdf.ValueTypeNames.Color3fArray, "varying")
    variation.Set([Gf.Vec3f(*factor) for factor in factors])
    stage.Save()
    pictures = draw(file, [APART_M * place for place in range(6)])
    colors = [picture[picture[..., 3] > 0.5][:, :3].mean(axis=0) for picture in pictures]
    for plain, varied in ((0, 2), (1, 3), (4, 5)):
        ratio = colors[varied] / colors[plain]
        assert ratio[0] / ratio[2] == pytest.approx(3, rel=0.15)  # the cuticle's mirrored light has no such colour
        assert ratio[1] / ratio[2] == pytest.approx(0.5, rel=0.2)


@pytest.mark.parametrize("author", [author_instancer, author_baked])
def test_light_from_behind_shines_through_yellower(tmp_path, author):
    stage = new_stage(tmp_path / "backlit.usda")
    author(stage, "/Leaves", Scene(leaves=one_leaf(flat_leaf())), author_material(stage, "/Leaf"))
    sun = UsdLux.DistantLight.Define(stage, "/Sun")  # shines towards -Z
    sun.CreateIntensityAttr(1000.0)
    sun.CreateAngleAttr(2.0)
    stage.Save()
    lit, through = draw(tmp_path / "backlit.usda", [0.0], ("front", "back"))
    lit, through = (picture[picture[..., 3] > 0.5][:, :3].mean(axis=0) for picture in (lit, through))
    assert 0.2 < through[1] / lit[1] < 1.0
    assert through[0] / through[2] > 2 * lit[0] / lit[2]
    assert lit[1] > 0.05


def test_material_is_accepted_by_the_registry():
    stage = Usd.Stage.CreateInMemory()
    material = LeafMaterial(shaders=SHADERS, texture="./leaf.png", jitter_map="./jitter.exr")
    author_leaf_material(stage, Sdf.Path("/Leaf"), material)
    validator = UsdValidation.ValidationRegistry().GetOrLoadValidatorByName("usdShadeValidators:ShaderSdrCompliance")
    errors = [error.GetMessage() for prim in stage.Traverse() for error in validator.Validate(prim)]
    unknown_here = ("shaderId 'ND_", "sourceType 'glslfx'")  # without usdMtlx and sdrGlslfx
    assert [error for error in errors if not error.startswith(unknown_here)] == []


def test_packed_leaves_are_whole_numbers_near_enough():
    leaves = heap()
    packed = pack_leaves(leaves)
    np.testing.assert_array_equal(packed, np.round(packed))
    assert packed[0] == len(leaves)
    numbers = packed[1:].reshape(19, len(leaves)).T
    for first, row in ((0, 1), (3, 5), (6, 6), (10, 0), (13, 2), (16, 3)):
        np.testing.assert_allclose(numbers[:, first : first + 3] / 2048, leaves.parameters[:, row], atol=2.5e-4)
    np.testing.assert_allclose(numbers[:, 9] / 512, leaves.phase % PERIOD, atol=1e-3)


@pytest.mark.parametrize(
    "field",
    [
        {"roughness": 1.5},
        {"translucency": -1.0},
        {"vein_pairs": 0.0},
        {"color": (0.1, 0.2)},
        {"specular": float("nan")},
    ],
)
def test_material_out_of_range_is_refused(field):
    with pytest.raises(ValueError, match=next(iter(field))):
        LeafMaterial(shaders="../shaders", **field)


def color_leaves(instancer, colors):
    primvar = UsdGeom.PrimvarsAPI(instancer).CreatePrimvar(
        "displayColor", Sdf.ValueTypeNames.Color3fArray, UsdGeom.Tokens.varying
    )
    primvar.Set([Gf.Vec3f(*color) for color in colors])


def flat_leaf():
    leaf = default_leaf()
    leaf[:2, 2] = 0.0
    leaf[2:5, 2] = 0.0
    leaf[5:] = 0.0
    return leaf


def replace_parameters(leaves, parameters):
    return replace(leaves, parameters=parameters[None])


def default_leaf_height(v):
    """The y of the default leaf's axis at v."""
    return float(axis_points(default_leaf()[None], [v])[0, 0, 1])


def row_of(y):
    return round((0.4 + HALF_M - y) / (2 * HALF_M) * SIZE_PX)
