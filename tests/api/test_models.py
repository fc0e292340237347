"""Assets are written from models and read back as the same ones."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom
from usdfoliage import api
from usdfoliage.asset.parts.leaf_part import LeafAssetSettings
from usdfoliage.jobs.edits.scatter import read_spray

from tests.support.usd_values import hashes


def spray(count: int = 20) -> api.Leaves:
    return api.scatter_leaves(count, seed=3, settings=read_spray(0.07, 1.0))


def fork() -> api.Skeleton:
    trunk = np.column_stack([np.zeros(7), np.linspace(0, 0.9, 7), np.zeros(7)])
    bough = trunk[3] + np.linspace(0, 1, 5)[:, None] * np.array([0.3, 0.3, 0.0])
    return api.Skeleton(
        points_m=np.concatenate([trunk, bough]).astype(np.float32).astype(np.float64),
        radius_m=np.concatenate([np.linspace(0.02, 0.006, 7), np.linspace(0.008, 0.003, 5)]),
        counts=np.array([7, 5], np.int32),
        parent_curve=np.array([-1, 0], np.int32),
        parent_vertex=np.array([-1, 3], np.int32),
        order=np.array([0, 1], np.int32),
    )


def ball() -> api.CrownModel:
    return api.CrownModel(
        radius_m=np.full((6, 17, 17), 0.6, np.float32),
        color=np.full((6, 17, 17, 3), (0.0625, 0.25, 0.03125), np.float32),
        center_m=np.array([0.0, 0.75, 0.0]),
        relief_weight=0.5,
        asset_from_photo=np.diag([0.01, -0.01, 0.01, 1.0]),
    )


def assert_same_leaves(read: api.Leaves | None, written: api.Leaves) -> None:
    assert read is not None
    for name in api.Leaves.__dataclass_fields__:
        before, after = getattr(written, name), getattr(read, name)
        assert (before is None) == (after is None), name
        if before is not None:
            np.testing.assert_array_equal(np.asarray(after, np.float32), np.asarray(before, np.float32), name)


@pytest.mark.parametrize("crown", [False, True])
@pytest.mark.parametrize("skeleton", [False, True])
@pytest.mark.parametrize("leaves", [False, True])
def test_what_is_written_is_read_back(leaves: bool, skeleton: bool, crown: bool, tmp_path: Path) -> None:
    parts = {"leaves": spray() if leaves else None, "skeleton": fork() if skeleton else None}
    if not (leaves or skeleton or crown):
        with pytest.raises(ValueError, match="none of them was given"):
            api.write_asset(tmp_path / "oak", **parts)
        assert not (tmp_path / "oak").exists()
        return
    matrix = np.diag([2.0, 2.0, 2.0, 1.0])
    written = api.write_asset(
        str(tmp_path / "oak"), **parts, crown=ball() if crown else None, asset_from_capture=matrix, version="7"
    )
    assert written.asset == tmp_path / "oak" / "oak.usda"
    read = api.open_asset(written.asset)
    np.testing.assert_array_equal(read.asset_from_capture, matrix)
    assert read.name == "oak"
    assert read.edits == api.NEUTRAL
    assert (read.leaves is not None, read.skeleton is not None, read.crown is not None) == (leaves, skeleton, crown)
    if leaves:
        assert_same_leaves(read.leaves, spray())
    if skeleton:
        assert read.skeleton is not None
        np.testing.assert_array_equal(read.skeleton.points_m, fork().points_m)
        np.testing.assert_allclose(read.skeleton.radius_m, fork().radius_m, rtol=1e-6)
        np.testing.assert_array_equal(read.skeleton.parent_vertex, fork().parent_vertex)
    if crown:
        assert read.crown is not None
        np.testing.assert_array_equal(read.crown.radius_m, ball().radius_m)
        np.testing.assert_array_equal(read.crown.color, ball().color)
        np.testing.assert_array_equal(read.crown.center_m, ball().center_m)
        assert read.crown.relief_weight == 0.5
    stage = Usd.Stage.Open(str(written.asset))
    assert Usd.ModelAPI(stage.GetDefaultPrim()).GetAssetVersion() == "7"


def test_an_asset_of_all_parts_is_valid(tmp_path: Path) -> None:
    api.write_asset(tmp_path / "oak", leaves=spray(), skeleton=fork(), crown=ball(), representations=("bezier", "mesh"))
    report = api.validate(tmp_path / "oak")
    assert report.open_errors == 0
    assert "lod=both representation=mesh" in " ".join(report.selections)


def test_what_was_opened_and_is_written_again_has_the_same_bytes(tmp_path: Path) -> None:
    written = api.write_asset(tmp_path / "0" / "fern", leaves=spray(), edits=api.LeafEdits(width=1.25))
    for generation in ("1", "2"):  # numbers are single precision from the first asset on
        read = api.open_asset(written.asset)
        written = api.write_asset(
            tmp_path / generation / "fern",
            leaves=read.leaves,
            edits=read.edits,
            appearance=read.appearance,
            provenance=read.provenance,
        )
    assert hashes(tmp_path / "1") == hashes(tmp_path / "2")


def test_leaves_are_those_of_the_plant_where_a_layer_has_moved_them(tmp_path: Path) -> None:
    api.write_asset(tmp_path / "fern", leaves=spray(), representations=("bezier",))
    stage = Usd.Stage.CreateNew(str(tmp_path / "shot.usda"))
    prim = stage.DefinePrim("/fern")
    prim.GetReferences().AddReference("./fern/fern.usda")
    stage.SetDefaultPrim(prim)
    moved = UsdGeom.Xformable(stage.GetPrimAtPath("/fern/geo/render/Leaves"))
    moved.AddTranslateOp().Set(Gf.Vec3d(1, 2, 3))
    UsdGeom.Xformable(prim).AddTranslateOp().Set(Gf.Vec3d(50, 0, 0))  # of the whole plant: not in its own frame
    stage.Save()
    read = api.open_asset(tmp_path / "shot.usda").leaves
    assert read is not None
    np.testing.assert_allclose(read.base_m, spray().base_m.astype(np.float32) + np.array([1.0, 2.0, 3.0]), atol=1e-6)


def test_a_crown_that_a_layer_has_moved_is_refused(tmp_path: Path) -> None:
    written = api.write_asset(tmp_path / "oak", crown=ball())
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "oak" / "payload" / "crown.usdc"))
    stage = Usd.Stage.Open(layer)
    UsdGeom.Xformable(stage.GetPrimAtPath("/oak/geo/proxy/Crown")).AddTranslateOp().Set(Gf.Vec3d(1, 0, 0))
    layer.Save()
    with pytest.raises(api.AssetError, match="a transform moves a part within its plant"):
        api.open_asset(written.asset)


def test_a_crown_without_its_maps_is_refused(tmp_path: Path) -> None:
    written = api.write_asset(tmp_path / "oak", crown=ball())
    (tmp_path / "oak" / "maps" / "oak_crown_color.exr").unlink()
    with pytest.raises(api.AssetError, match=r"the colour map of the crown \S+\.exr is missing"):
        api.open_asset(written.asset)


def test_the_matrix_of_a_crown_is_that_of_its_asset(tmp_path: Path) -> None:
    written = api.write_asset(tmp_path / "oak", crown=ball(), leaves=spray())
    np.testing.assert_array_equal(api.open_asset(written.asset).asset_from_capture, ball().asset_from_photo)


def test_representations_are_those_of_the_promise() -> None:
    names = api.write_asset.__kwdefaults__["representations"]
    assert tuple(names) == tuple(LeafAssetSettings().representations)


def test_an_unknown_representation_leaves_what_was_there(tmp_path: Path) -> None:
    api.write_asset(tmp_path / "fern", leaves=spray())
    before = hashes(tmp_path)
    with pytest.raises(api.FoliageError, match="there is no representation 'voxels'"):
        api.write_asset(tmp_path / "fern", leaves=spray(5), representations=("voxels",))
    assert hashes(tmp_path) == before


def test_somebody_elses_folder_is_kept(tmp_path: Path) -> None:
    (tmp_path / "fern").mkdir()
    (tmp_path / "fern" / "notes.txt").write_text("mine")
    with pytest.raises(api.AssetError, match="other things"):
        api.write_asset(tmp_path / "fern", leaves=spray())
    with pytest.raises(api.AssetError, match="other things"):
        api.write_asset(tmp_path / "fern", leaves=spray(), force=True)
    assert (tmp_path / "fern" / "notes.txt").read_text() == "mine"


def test_points_are_those_of_the_meshes_in_the_asset(tmp_path: Path) -> None:
    edits = api.LeafEdits(width=1.5, curl=(0.0, 0.02, 0.1), jitter_amplitude=0.02, jitter_frequency=6.0)
    written = api.write_asset(tmp_path / "fern", leaves=spray(), edits=edits)
    mesh = api.leaf_mesh(spray(), edits)
    stage = Usd.Stage.Open(str(written.asset))
    stage.GetDefaultPrim().GetVariantSets().SetSelection("representation", "mesh")
    leaves = UsdGeom.Mesh(stage.GetPrimAtPath("/fern/geo/render/Leaves"))
    np.testing.assert_array_equal(np.array(leaves.GetPointsAttr().Get()), mesh.points_m)
    vertices = len(mesh.points_m) // 20
    uv = np.column_stack([2 * mesh.st[:vertices, 0] - 1, mesh.st[:vertices, 1]])
    points_m = api.leaf_points(spray(), uv, edits)
    np.testing.assert_allclose(points_m.reshape(-1, 3), mesh.points_m, atol=1e-6)
    one_thread = api.leaf_points(spray(), uv, edits, threads=1)
    np.testing.assert_array_equal(points_m, one_thread)


def test_normals_stand_on_the_surface() -> None:
    at, step = np.array([[0.4, 0.3], [-0.7, 0.6]]), 1e-5
    leaves = spray()
    normals = api.leaf_normals(leaves, at)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1.0, rtol=1e-12)
    for axis in np.eye(2):
        tangent = api.leaf_points(leaves, at + step * axis) - api.leaf_points(leaves, at - step * axis)
        tangent /= np.linalg.norm(tangent, axis=-1, keepdims=True)
        np.testing.assert_allclose(np.sum(tangent * normals, axis=-1), 0.0, atol=1e-5)


def test_a_bad_jitter_map_is_refused(tmp_path: Path) -> None:
    (tmp_path / "wave.png").write_text("no picture")
    with pytest.raises(api.CaptureError):
        api.leaf_points(spray(), [[0.0, 0.5]], api.LeafEdits(jitter_amplitude=0.1), jitter_map=tmp_path / "wave.png")


def test_looks_and_bakes_take_texts_and_paths(tmp_path: Path) -> None:
    api.write_asset(str(tmp_path / "fern"), leaves=spray(), edits=api.LeafEdits(width=0.5))
    more = api.compose_edits(api.open_asset(str(tmp_path / "fern")).edits, api.LeafEdits(width=3.0))
    look = api.write_look(str(tmp_path / "wide.usda"), str(tmp_path / "fern"), more)
    assert look == tmp_path / "wide.usda"
    assert api.open_asset(look).edits.width == 1.5
    baked = api.bake(str(look), str(tmp_path / "wide"), representations=("mesh",), resolution=(4, 8))
    read = api.open_asset(baked.asset)
    assert read.leaves is not None
    np.testing.assert_allclose(read.leaves.parameters[:, 2:5, 1], 1.5 * spray().parameters[:, 2:5, 1], rtol=1e-6)
    with pytest.raises(api.FoliageError, match="at most 512 cells"):
        api.bake(look, tmp_path / "fine", resolution=(600, 8))


def test_remarks_of_a_bake_have_codes(tmp_path: Path) -> None:
    api.write_asset(tmp_path / "fern", leaves=spray(), edits=replace(api.NEUTRAL, jitter_amplitude=0.05))
    baked = api.bake(tmp_path / "fern", tmp_path / "baked")
    assert [remark.severity for remark in baked.remarks] == ["info"]
    assert all(isinstance(remark, api.Remark) for remark in baked.remarks)
    assert "jitter" in baked.remarks[0].text
