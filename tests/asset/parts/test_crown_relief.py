"""The relief of a crown: its layer, its shader, and that Storm draws it as the mesh."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom
from usdfoliage.asset.materials.crown import RELIEF_SHADER
from usdfoliage.asset.materials.layer import copy_shaders, inline_sections
from usdfoliage.asset.packages.leaf_package import write_crown_asset
from usdfoliage.asset.provenance import Provenance
from usdfoliage.capture.folder.images import read_photo
from usdfoliage.crown.leaf_picture import clean_leaf_picture
from usdfoliage.crown.model import CrownModel
from usdfoliage.geometry.cubemap import face_directions, share_borders
from usdfoliage.geometry.pinhole import look_at
from usdfoliage.jobs.preview.pictures import PreviewSettings, PreviewView, draw_views, finish_picture

from tests.support.leaves.drawn import drawn_leaf

PLAIN = Provenance(capture="crown.jpg", generator="test", seed=0, input_sha256="0")


def bumpy_crown(size: int = 48) -> CrownModel:
    """A crown of waves, in colours that change around it."""
    direction = face_directions(size)
    wave = np.random.default_rng(2).normal(0, 2.5, (5, 3))
    radius_m = 1.5 + 0.12 * np.cos(direction @ wave.T).sum(axis=-1)
    color = 0.15 + 0.1 * np.sin(direction * 4)
    return CrownModel(
        radius_m=share_borders(radius_m.astype(np.float32)),
        color=share_borders(color.astype(np.float32)),
        center_m=np.array([0.2, 2.5, -0.1]),
        relief_weight=0.1,
        asset_from_photo=np.eye(4),
    )


@pytest.fixture(scope="module")
def crown(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("crown") / "oak"
    folder.mkdir()
    return write_crown_asset(folder, "oak", bumpy_crown(), PLAIN)


def test_the_mesh_is_the_default_and_the_relief_a_hull_around_it(crown):
    stage = Usd.Stage.Open(str(crown))
    forms = stage.GetPrimAtPath("/oak/geo/proxy").GetVariantSets().GetVariantSet("crown")
    assert set(forms.GetVariantNames()) == {"mesh", "relief", "leaves"}
    assert forms.GetVariantSelection() == "mesh"
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/oak/geo/proxy/Crown"))
    low, high = (np.array(corner) for corner in mesh.GetExtentAttr().Get())
    assert mesh.GetSubdivisionSchemeAttr().Get() == "catmullClark"
    forms.SetVariantSelection("relief")
    hull = UsdGeom.Mesh(stage.GetPrimAtPath("/oak/geo/proxy/Crown"))
    assert len(hull.GetFaceVertexCountsAttr().Get()) == 80
    assert hull.GetSubdivisionSchemeAttr().Get() == "none"
    around = np.array(hull.GetExtentAttr().Get())
    assert (around[0] < low + 0.05).all()
    assert (around[1] > high - 0.05).all()
    assert hull.GetPrim().GetRelationship("material:binding").GetTargets() == ["/oak/mtl/CrownRelief"]


def test_the_shader_in_an_asset_imports_nothing(tmp_path):
    copy_shaders(tmp_path, (RELIEF_SHADER,))
    text = (tmp_path / RELIEF_SHADER).read_text()
    assert "#import" not in text
    for section in ("Crown.Maps", "Relief.Surface"):
        assert text.count(f"-- glsl {section}\n") == 1
    assert "Crown.Surface" not in text


def test_a_source_without_imports_stays_as_it_is(tmp_path):
    assert inline_sections("-- glslfx version 0.1\n", tmp_path) == "-- glslfx version 0.1\n"


@pytest.mark.preview
def test_storm_draws_the_relief_as_the_mesh(crown):
    settings = PreviewSettings(width_px=260, height_px=260, background=None)
    for direction in ("front", "three-quarter", "top"):
        window = (-2.4, 2.8, 0.0, 5.2) if direction == "front" else (-2.6, 2.6, -2.6, 2.6)
        views = [
            PreviewView(
                output=crown.with_name("none.png"),
                direction=direction,
                orthographic=True,
                window=window,
                variants=(("crown", form),),
            )
            for form in ("mesh", "relief")
        ]
        mesh, relief = (finish_picture(each, None).astype(float) for each in draw_views(crown, views, settings))
        seen = [picture[..., 3] > 127 for picture in (mesh, relief)]
        both = seen[0] & seen[1]
        assert both.sum() > 2000
        assert both.sum() / (seen[0] | seen[1]).sum() > 0.985
        assert np.abs(mesh[both][:, :3].mean(axis=0) - relief[both][:, :3].mean(axis=0)).max() < 4
        assert np.abs(mesh[both][:, :3] - relief[both][:, :3]).mean() < 5


def test_leaves_are_clusters_beside_a_crown_that_is_not_drawn(crown):
    stage = Usd.Stage.Open(str(crown))
    stage.GetPrimAtPath("/oak/geo/proxy").GetVariantSets().GetVariantSet("crown").SetVariantSelection("leaves")
    drawn = UsdGeom.Imageable(stage.GetPrimAtPath("/oak/geo/proxy/Crown"))
    assert drawn.ComputeVisibility() == UsdGeom.Tokens.invisible
    clusters = UsdGeom.PointInstancer(stage.GetPrimAtPath("/oak/geo/proxy/CrownLeaves"))
    assert len(clusters.GetPositionsAttr().Get()) == 320
    assert len(clusters.GetPrototypesRel().GetTargets()) == 3
    cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), [UsdGeom.Tokens.default_])
    box = cache.ComputeWorldBound(stage.GetDefaultPrim()).ComputeAlignedRange()
    hint = np.array(UsdGeom.ModelAPI(stage.GetDefaultPrim()).GetExtentsHint())[:2]
    assert (np.array(box.GetMin()) >= hint[0] - 1e-3).all()
    assert (np.array(box.GetMax()) <= hint[1] + 1e-3).all()


@pytest.fixture(scope="module")
def leafy(crown, tmp_path_factory):
    """The crown with a plain leaf, a slim one and a wide one, by name."""
    assets = {"plain": crown}
    for name, width_px in (("slim", 25), ("wide", 110)):
        folder = tmp_path_factory.mktemp(name) / "oak"
        folder.mkdir()
        leaf = clean_leaf_picture(drawn_leaf(width_px, 100))
        assets[name] = write_crown_asset(folder, "oak", bumpy_crown(), PLAIN, leaf=leaf)
    return assets


@pytest.mark.parametrize(("name", "leaves"), [("plain", 36), ("slim", 82), ("wide", 36)])
def test_the_picture_of_a_leaf_is_in_the_maps_and_gives_leaves_their_form(leafy, name, leaves):
    stage = Usd.Stage.Open(str(leafy[name]))
    stage.GetPrimAtPath("/oak/geo/proxy").GetVariantSets().GetVariantSet("crown").SetVariantSelection("leaves")
    cluster = UsdGeom.Mesh(stage.GetPrimAtPath("/oak/geo/proxy/CrownLeaves/Prototypes/Cluster_1"))
    assert len(cluster.GetFaceVertexCountsAttr().Get()) == pytest.approx(leaves, abs=2)
    texture = stage.GetPrimAtPath("/oak/mtl/CrownLeaves/LeafMap")
    scale = np.array(texture.GetAttribute("inputs:scale").Get())
    assert texture.GetAttribute("inputs:sourceColorSpace").Get() == "sRGB"
    written = read_photo(Path(texture.GetAttribute("inputs:file").Get().resolvedPath))
    assert written.alpha is not None
    np.testing.assert_allclose((written.linear * scale[:3])[written.alpha >= 0.5].mean(axis=0), 1, atol=0.01)
    named = stage.GetPrimAtPath("/oak/geo/proxy/Crown").GetAttribute("foliage:crown:leafTexture").Get()
    assert Path(named.resolvedPath) == written.path


def seen_forms(crown: Path, scene: Path, clusters: int):
    """Silhouettes and pictures of the mesh and of so many clusters of leaves, from the front."""
    scene.write_text(
        f"""#usda 1.0
(
    defaultPrim = "oak"
    upAxis = "Y"
    metersPerUnit = 1
    subLayers = [@{crown}@]
)
over "oak"
{{
    over "mtl"
    {{
        over "CrownLeaves"
        {{
            over "StormSurface"
            {{
                float inputs:mostClusters = {clusters}
            }}
        }}
    }}
}}
"""
    )
    views = [
        PreviewView(
            output=scene.with_name("none.png"),
            orthographic=True,
            window=(-2.4, 2.8, 0.0, 5.2),
            variants=(("crown", form),),
        )
        for form in ("mesh", "leaves")
    ]
    drawn = draw_views(scene, views, PreviewSettings(width_px=400, height_px=400, background=None))
    pictures = [finish_picture(each, None) for each in drawn]
    return [picture[..., 3] > 127 for picture in pictures], pictures


@pytest.mark.preview
@pytest.mark.parametrize("name", ["plain", "slim", "wide"])
@pytest.mark.parametrize(("clusters", "iou"), [(320, 0.9), (32, 0.8)])
def test_leaves_have_the_silhouette_and_the_colors_of_the_mesh(leafy, name, tmp_path, clusters, iou):
    (mesh, leaves), pictures = seen_forms(leafy[name], tmp_path / "few.usda", clusters)
    assert (mesh & leaves).sum() / (mesh | leaves).sum() > iou
    color, own = (picture[mesh & leaves][:, :3].mean(axis=0) for picture in pictures)
    assert np.abs(own - color).max() < 12  # of 255: the leaf is red and green, and the crown keeps its colours


@pytest.mark.preview
@pytest.mark.parametrize(("clusters", "iou"), [(320, 0.9), (32, 0.85)])
def test_leaves_fill_a_crown_of_spikes_and_stay_within_it(tmp_path, clusters, iou):
    direction = face_directions(48)
    axes = np.array([[1.0, 0.2, 0.2], [-0.8, 0.6, 0.1], [-0.6, -0.8, 0.2], [0.5, -0.9, -0.1], [0.1, 1, 0.0]])
    nearest = (direction @ (axes / np.linalg.norm(axes, axis=1, keepdims=True)).T).max(axis=-1)
    radius_m = 0.5 + 1.5 * np.exp(-10 * (1 - nearest))
    spiky = replace(bumpy_crown(), radius_m=share_borders(radius_m.astype(np.float32)))
    (tmp_path / "oak").mkdir()
    asset = write_crown_asset(tmp_path / "oak", "oak", spiky, PLAIN)
    mesh, leaves = seen_forms(asset, tmp_path / "few.usda", clusters)[0]
    assert (mesh & leaves).sum() / (mesh | leaves).sum() > iou


@pytest.mark.preview
def test_leaves_of_a_cluster_point_to_all_sides(tmp_path):
    leaf = drawn_leaf(24, 100)
    folder = tmp_path / "oak"
    folder.mkdir()
    asset = write_crown_asset(folder, "oak", bumpy_crown(), PLAIN, leaf=clean_leaf_picture(leaf))
    view = PreviewView(
        output=tmp_path / "none.png", orthographic=True, window=(-0.4, 0.8, 2.0, 3.2), variants=(("crown", "leaves"),)
    )
    (drawn,) = draw_views(asset, [view], PreviewSettings(width_px=400, height_px=400, background=None))
    grey = finish_picture(drawn, None)[..., :3].astype(np.float64).mean(axis=-1)
    rise, across = np.gradient(grey)
    # Doubled angles of edges: their mean is long where all are parallel.
    doubled = (across + 1j * rise) ** 2
    assert abs(doubled.sum()) / np.abs(doubled).sum() < 0.25


@pytest.mark.preview
@pytest.mark.parametrize("form", ["relief", "leaves"])
def test_instances_are_drawn_as_those_of_the_mesh(crown, tmp_path, form):
    scene = tmp_path / "scene.usda"
    scene.write_text(
        f"""#usda 1.0
(
    defaultPrim = "W"
    upAxis = "Y"
    metersPerUnit = 1
)
def Xform "W"
{{
    double3 xformOp:translate = (1, 0, 2)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def PointInstancer "Trees"
    {{
        rel prototypes = </W/Trees/Oak>
        int[] protoIndices = [0, 0]
        point3f[] positions = [(-3, 0, 0), (3, 1, -1)]
        float3[] scales = [(1, 1.6, 1), (0.8, 0.6, 1.1)]
        quath[] orientations = [(0.92, 0, 0.38, 0), (0.96, 0.1, 0.2, 0.15)]
        def Xform "Oak" (
            references = @{crown}@
        )
        {{
        }}
    }}
}}
"""
    )
    settings = PreviewSettings(width_px=320, height_px=240, background=None)
    views = [
        PreviewView(
            output=tmp_path / "none.png",
            pinhole=look_at(np.array([4.0, 5.0, 14.0]), np.array([1.0, 3.0, 2.0]), 320.0, (320, 240)),
            variants=(("crown", drawn),),
        )
        for drawn in ("mesh", form)
    ]
    mesh, other = (finish_picture(each, None).astype(float) for each in draw_views(scene, views, settings))
    seen = [picture[..., 3] > 127 for picture in (mesh, other)]
    share = (seen[0] & seen[1]).sum() / (seen[0] | seen[1]).sum()
    assert seen[0].sum() > 3000
    assert share > {"relief": 0.98, "leaves": 0.9}[form]
    dark = other[seen[1]][:, :3].sum(axis=1) < 30
    assert dark.mean() < 0.002  # what a driver gives where it knows no instance
