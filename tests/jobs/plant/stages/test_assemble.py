"""The stage that makes one asset of the parts: what it shows first, and what it warns of."""

import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from pxr import Usd, UsdGeom, UsdSkel
from usdfoliage.asset.packages.contents import interface_of
from usdfoliage.asset.parts.branch_part import BranchAssetSettings, PlantBranches
from usdfoliage.asset.parts.branches import SkeletonPrim
from usdfoliage.asset.parts.leaf_part import BranchLeaves
from usdfoliage.asset.validation.validate import validate_asset
from usdfoliage.branch.cage.build import build_branch_cage
from usdfoliage.branch.cage.surfaces import BranchSurfaces
from usdfoliage.branch.foliage.species import load_library
from usdfoliage.branch.model_file import BranchesModel, TracedPlant, write_branches_model, write_traced_plant
from usdfoliage.capture.cloud.model import Cloud
from usdfoliage.capture.cloud_files.ply import write_cloud
from usdfoliage.capture.folder.images import read_photo
from usdfoliage.crown.model_file import MadeCrown, write_crown_model
from usdfoliage.errors import FitError, WriteError
from usdfoliage.jobs.plant.asset_facts import read_asset_facts
from usdfoliage.jobs.plant.settings import BuildSettings, PictureStageSettings
from usdfoliage.jobs.plant.stages import assemble
from usdfoliage.jobs.plant.stages.assemble import assemble_asset, average_crown_leaf, describe_guessed_leaves
from usdfoliage.jobs.plant.stages.foliage import ChosenFoliage
from usdfoliage.jobs.plant.stages.models import AVERAGE_LEAF, read_captured_leaves
from usdfoliage.jobs.plant.summary import StageSummary, read_summary, write_summary
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.model_file import LeavesModel, write_leaves_model
from usdfoliage.leaf.shape.surface import evaluate_points, grid_places

from tests.support.asset_shapes import list_shape, read_shape
from tests.support.branch_shapes import fork
from tests.support.leaves.assets import two_leaves
from tests.support.leaves.drawn import write_leaf
from tests.support.leaves.proposals import flat_leaves
from tests.support.plant_assets import round_crown

LEAVES_FROM_CAPTURE = np.array([[1.0, 0, 0, 2], [0, 0, 1, 0.5], [0, -1, 0, 0], [0, 0, 0, 1]])


def points_on(leaves: Leaves) -> np.ndarray:
    places = grid_places(np.linspace(-0.9, 0.9, 7), np.linspace(0.05, 0.95, 9))
    return evaluate_points(leaves.parameters, places, placements=leaves.asset_from_leaf()).reshape(-1, 3)


@pytest.mark.parametrize(
    ("away", "with_crown", "overlap", "confidence", "lod"),
    [
        (9, True, 0.8, 0.9, "crown"),
        (1, True, 0.8, 0.9, "leaves"),
        (1, True, 0.8, 0.3, "crown"),
        (1, False, 0.0, 0.3, "leaves"),
        (9, False, 0.0, 0.9, "leaves"),
        (9, True, 0.1, 0.9, "leaves"),
    ],
)
def test_leaves_that_cover_little_or_are_wrong_do_not_stand_for_the_plant(
    tmp_path, away, with_crown, overlap, confidence, lod
):
    results = {name: tmp_path / name for name in ("isolation", "leaves", "crown")}
    write_leaves_model(
        results["leaves"] / "leaves.npz",
        LeavesModel(
            leaves=replace(two_leaves(), confidence=np.full(2, confidence)), asset_from_capture=LEAVES_FROM_CAPTURE
        ),
    )
    write_summary(results["leaves"], StageSummary(rows=[], remarks=[]))
    captured = read_captured_leaves(results["leaves"])
    assert captured is not None
    # The leaves' own points, and `away` times as many that are of nothing found.
    on_m = points_on(captured.fitted.leaves)
    points_m = np.concatenate([on_m, *(on_m + np.array([30.0 * number, 0, 0]) for number in range(1, away))])
    points_m = (points_m - captured.own_from_capture[:3, 3]) @ np.linalg.inv(captured.own_from_capture[:3, :3]).T
    capture = results["isolation"] / "capture" / "fern"
    capture.mkdir(parents=True)
    count = len(points_m)
    write_cloud(
        capture / "cloud.ply",
        Cloud(
            points_m=points_m, normals=np.zeros((count, 3), np.float32), srgb=np.zeros((count, 3), np.uint8),
            confidence=np.ones(count, np.float32), views=np.full(count, 2, np.int32),
        ),
    )  # fmt: skip
    if with_crown:
        write_crown_model(results["crown"] / "crown.npz", MadeCrown(model=round_crown(), overlap=overlap))
    call = SimpleNamespace(
        out=tmp_path / "out",
        inputs=SimpleNamespace(name="fern", source=Path("fern"), digests=()),
        settings=replace(BuildSettings(), pictures=PictureStageSettings(make=False)),
        request=SimpleNamespace(name="fern", capture=Path("fern")),
        result_of=results.__getitem__,
        has=lambda name: name in ("cloud", "isolation", "leaves", *(["crown"] if with_crown else [])),
    )
    call.out.mkdir()
    assemble_asset(call)  # type: ignore[arg-type]
    stage = Usd.Stage.Open(str(interface_of(call.out / "asset")[0]))
    assert stage.GetDefaultPrim().GetVariantSet("lod").GetVariantSelection() == lod
    facts = read_asset_facts(call.out)
    assert (facts.leaves, facts.foliage, facts.branches) == (2, "captured", 0)
    assert list_shape(facts.shape) == list_shape(read_shape(call.out / "asset"))
    rows = read_summary(call.out).rows
    assert [(row.name, row.value) for row in rows[:2]] == [("leaves", "2"), ("branches", "0")]
    summary = read_summary(call.out)
    coverage_warnings = [warning for warning in summary.warning_texts() if "cover 11% of the cloud" in warning]
    assert len(coverage_warnings) == (away > 1)
    has_crown = with_crown and overlap > 0.5
    assert any("lod crown" in warning for warning in coverage_warnings) == (has_crown and away > 1)
    (guessed,) = (
        [each for each in summary.remarks if each.code == "plant-leaves-guessed"] if confidence < 0.5 else [None]
    )
    assert guessed is None or ("the lod crown is shown" in guessed.text) == has_crown
    assert any("crown is left out" in warning for warning in summary.warning_texts()) == (with_crown and not has_crown)
    assert ("crown" in stage.GetDefaultPrim().GetVariantSet("lod").GetVariantNames()) == has_crown


@pytest.mark.parametrize("picture", ["good", "clear", "cut short", "none"])
def test_the_crown_of_a_plant_has_its_average_leaf(tmp_path, picture):
    call = fork_call(tmp_path, np.zeros((0, 3)), BuildSettings(), two_leaves())
    folder = tmp_path / "leaves"
    if picture != "none":
        write_leaves_model(
            folder / "leaves.npz",
            LeavesModel(leaves=two_leaves(), asset_from_capture=np.eye(4), texture_color=(0.3, 0.4, 0.1)),
        )
        texture = np.full((64, 32, 4), 0.3, np.float32)
        texture[..., 3] = 0.0 if picture == "clear" else 1.0
        texture[0, 0, 3] = 0.2
        texture[32:, :, 1] = 0.8  # towards the base
        write_leaf(folder / AVERAGE_LEAF, texture)
        if picture == "cut short":
            (folder / AVERAGE_LEAF).write_bytes((folder / AVERAGE_LEAF).read_bytes()[:60])
    leaf, remarks = average_crown_leaf(read_captured_leaves(folder))
    assert [each.code for each in remarks] == (["crown-leaf-plain"] if picture in ("clear", "cut short") else [])
    assert (leaf is not None) == (picture == "good")
    if picture == "cut short":
        return  # the leaves themselves cannot have such a picture
    assemble_asset(call)
    written = read_photo(call.out / "asset" / "maps" / "fork_crown_leaf.png")
    assert ("crown-leaf-plain" in [each.code for each in read_summary(call.out).remarks]) == (picture == "clear")
    rows, columns = written.linear.shape[:2]
    base, apex = (written.linear[row, columns // 2, 1] for row in (-rows // 4, rows // 4))
    assert (base > 2 * apex) == (picture == "good")
    assert (columns == rows) == (picture != "good")


def fork_call(folder: Path, points_m: np.ndarray, settings: BuildSettings, leaves: Leaves | None = None):
    """The stage's call for a fork in a cloud, with a crown, and leaves if any."""
    results = {name: folder / name for name in ("branches", "crown", *(["leaves"] if leaves is not None else []))}
    skeleton = fork()
    write_branches_model(
        results["branches"] / "branches.npz",
        BranchesModel(
            skeleton=skeleton,
            surfaces=BranchSurfaces(whole=build_branch_cage(skeleton)),
            color=(0.2, 0.1, 0.05),
        ),
    )
    write_traced_plant(
        results["branches"] / "plant.npz",
        TracedPlant(
            points_m=np.concatenate([skeleton.points_m, points_m]),
            wood=np.zeros(len(skeleton.points_m) + len(points_m), bool),
            knows_leaves=True,
            colors=None,
            plant_from_capture=np.eye(4),
            skeleton=skeleton,
        ),
    )
    write_crown_model(results["crown"] / "crown.npz", MadeCrown(model=round_crown(), overlap=0.8))
    if leaves is not None:
        write_leaves_model(results["leaves"] / "leaves.npz", LeavesModel(leaves=leaves, asset_from_capture=np.eye(4)))
        write_summary(results["leaves"], StageSummary(rows=[], remarks=[]))
    call = SimpleNamespace(
        out=folder / "out",
        inputs=SimpleNamespace(name="fork", source=Path("fork.ply"), digests=()),
        settings=replace(settings, pictures=PictureStageSettings(make=False)),
        request=SimpleNamespace(name="fork", capture=Path("fork.ply")),
        result_of=results.__getitem__,
        has=results.__contains__,
    )
    call.out.mkdir()
    return call


@pytest.mark.parametrize(("width_m", "lod"), [(0.1, "leaves"), (3.0, "crown")])
def test_branches_that_reach_little_of_the_cloud_do_not_stand_for_the_plant(tmp_path, width_m, lod):
    """A fork in a cloud as slim as it is, and in one that is much wider."""
    rng = np.random.default_rng(0)
    around_m = rng.uniform([-width_m, 0, -width_m], [width_m, 2, width_m], (3000, 3))
    settings = BuildSettings()
    call = fork_call(tmp_path, around_m, replace(settings, foliage=replace(settings.foliage, kind="none")))
    assemble_asset(call)  # type: ignore[arg-type]
    stage = Usd.Stage.Open(str(interface_of(call.out / "asset")[0]))
    assert stage.GetDefaultPrim().GetVariantSet("lod").GetVariantSelection() == lod
    crown_warnings = [
        warning for warning in read_summary(call.out).warning_texts() if "the lod crown is shown" in warning
    ]
    assert len(crown_warnings) == (lod == "crown")


@pytest.mark.parametrize("clips", [False, True])
def test_a_build_sways_with_the_leaves_that_were_found(tmp_path, clips):
    """The twig's own leaf turns as the twig's joint does, wherever beside it the leaf was found."""
    tip_m = fork().points_m[6]
    found = flat_leaves(np.stack([tip_m + np.array([0.02, 0.01, 0]), [0.06, 0.1, 0]]))
    settings = BuildSettings()
    settings = replace(
        settings,
        plant=replace(settings.plant, sway_frames=6, sway_clips=clips),
        foliage=replace(settings.foliage, kind="captured"),
    )
    call = fork_call(tmp_path, points_on(found), settings, replace(found, confidence=np.full(2, 0.9)))
    assemble_asset(call)  # type: ignore[arg-type]
    stage = Usd.Stage.Open(str(interface_of(call.out / "asset")[0]))
    plant = stage.GetDefaultPrim()
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (1, 6)
    leaves = UsdGeom.PointInstancer(stage.GetPrimAtPath("/fork/geo/render/Leaves"))
    assert leaves.GetPositionsAttr().GetNumTimeSamples() == 0  # rig=none
    plant.GetVariantSets().SetSelection("rig", "skel")
    joints = UsdSkel.Skeleton(stage.GetPrimAtPath("/fork/geo/render/Rig/Joints"))
    query = UsdSkel.Cache().GetSkelQuery(joints)
    twig = list(joints.GetJointsAttr().Get()).index("branch_0/branch_1/branch_2")
    far_m, near_m = [], []
    for frame in range(1, 7):
        turned = np.array(query.ComputeSkinningTransforms(frame)[twig]).T
        expected_m = turned[:3, :3] @ found.base_m[0] + turned[:3, 3]
        at_m = np.array(leaves.GetPositionsAttr().Get(frame), float)
        assert at_m[0] == pytest.approx(expected_m, abs=1e-5)
        far_m.append(np.linalg.norm(at_m[0] - found.base_m[0]))
        near_m.append(np.linalg.norm(at_m[1] - found.base_m[1]))
    assert max(far_m) > 0.02
    assert max(near_m) < 0.1 * max(far_m)  # at the trunk's foot hardly anything moves
    assert (call.out / "asset" / "payload" / "rig_clips.usda").is_file() == clips
    # The crown is wider than the fork: the box of what sways holds the fork alone.
    findings = validate_asset(call.out / "asset").findings
    assert [each for each in findings if each.severity == "error"] == []


def test_a_build_grows_with_the_leaves_that_were_found(tmp_path):
    """A leaf beside the twig waits on the tip of what is there, and unfolds after one at the trunk's foot."""
    tip_m = fork().points_m[6]
    found = flat_leaves(np.stack([tip_m + np.array([0.02, 0.01, 0]), [0.06, 0.1, 0]]))
    settings = BuildSettings()
    settings = replace(
        settings,
        plant=replace(settings.plant, growth_frames=13),
        foliage=replace(settings.foliage, kind="captured"),
    )
    call = fork_call(tmp_path, points_on(found), settings, replace(found, confidence=np.full(2, 0.9)))
    assemble_asset(call)  # type: ignore[arg-type]
    stage = Usd.Stage.Open(str(interface_of(call.out / "asset")[0]))
    leaves = UsdGeom.PointInstancer(stage.GetPrimAtPath("/fork/geo/render/Leaves"))
    assert leaves.GetScalesAttr().GetNumTimeSamples() == 0  # growth=still
    stage.GetDefaultPrim().GetVariantSets().SetSelection("growth", "growing")
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (1, 13)
    scales = np.array([leaves.GetScalesAttr().Get(frame) for frame in range(1, 14)], float)[..., 0]
    assert scales[-1] == pytest.approx(found.length_m)
    assert (scales[0] < 0.01 * found.length_m).all()
    born = (scales > 0.5 * found.length_m).argmax(axis=0)
    assert born[1] < born[0]  # the foot is first
    waits_m = np.array(leaves.GetPositionsAttr().Get(1), float)[0]
    assert waits_m[1] < 0.5 * found.base_m[0, 1]
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/fork/geo/render/Branches"))
    assert mesh.GetPointsAttr().GetNumTimeSamples() == 13
    assert mesh.GetFaceVertexIndicesAttr().GetNumTimeSamples() == 0  # points are interpolated between frames
    findings = validate_asset(call.out / "asset").findings
    assert [each for each in findings if each.severity == "error"] == []


@pytest.mark.parametrize("kind", ["captured", "none"])
def test_variations_are_assets_beside_the_plant(tmp_path, kind):
    found = flat_leaves(np.array([[0.06, 0.1, 0], [0.06, 0.3, 0]]))
    settings = BuildSettings()
    settings = replace(
        settings,
        plant=replace(settings.plant, growth_frames=4),
        branches=replace(settings.branches, variations=2),
        foliage=replace(settings.foliage, kind=kind),
    )
    call = fork_call(tmp_path, points_on(found), settings, replace(found, confidence=np.full(2, 0.9)))
    plant = replace(fork(), radius_m=0.1 * fork().radius_m)  # twigs, which carry leaves
    for number in (1, 2):
        surfaces = BranchSurfaces(whole=build_branch_cage(plant), by_order=())
        model = BranchesModel(skeleton=plant, surfaces=surfaces, color=(0.1, 0.1, 0.1))
        write_branches_model(tmp_path / "branches" / f"variation_{number:02d}.npz", model)
    assemble_asset(call)  # type: ignore[arg-type]
    for name in ("fork_01", "fork_02"):
        own = call.out / "asset" / "variations" / name
        stage = Usd.Stage.Open(str(own / f"{name}.usda"))
        root = stage.GetDefaultPrim()
        assert root.GetName() == name
        assert root.GetVariantSet("growth").GetVariantNames() == ["growing", "still"]
        curves = UsdGeom.BasisCurves(stage.GetPrimAtPath(f"/{name}/geo/guide/Skeleton"))
        assert np.array(curves.GetPointsAttr().Get()) == pytest.approx(plant.points_m, abs=1e-5)
        assert bool(stage.GetPrimAtPath(f"/{name}/geo/render/Leaves")) == (kind == "captured")
        assert [each for each in validate_asset(own).findings if each.severity == "error"] == []
    assert sorted(each.name for each in (call.out / "asset" / "variations").iterdir()) == ["fork_01", "fork_02"]


def test_variations_that_fail_are_left_out_and_counted(tmp_path, monkeypatch):
    """Of four variations the first was not made, the second has no surface, of the third no asset can be written."""
    settings = BuildSettings()
    settings = replace(
        settings,
        plant=replace(settings.plant, growth_frames=4, sway_frames=4),
        branches=replace(settings.branches, variations=4),
        foliage=replace(settings.foliage, kind="none"),
    )
    call = fork_call(tmp_path, fork().points_m, settings)
    whole = build_branch_cage(fork())
    bare = replace(
        whole,
        faces=whole.faces[:0], face_st=whole.face_st[:0], curve=whole.curve[:0], order=whole.order[:0],
        fork_faces=whole.fork_faces[:0], fork_counts=whole.fork_counts[:0], fork_curve=whole.fork_curve[:0],
    )  # fmt: skip
    for number, cage in ((2, bare), (3, whole), (4, whole)):
        model = BranchesModel(skeleton=fork(), surfaces=BranchSurfaces(whole=cage), color=(0.1, 0.1, 0.1))
        write_branches_model(tmp_path / "branches" / f"variation_{number:02d}.npz", model)
    write = assemble.write_plant_asset

    def write_all_but_one(folder, name, **parts):
        write(folder, name, **parts)
        if name == "fork_03":
            raise FitError("its leaves need more memory than there is", "ask for fewer leaves")

    monkeypatch.setattr(assemble, "write_plant_asset", write_all_but_one)
    assemble_asset(call)  # type: ignore[arg-type]
    summary = read_summary(call.out)
    assert {row.name: row.value for row in summary.rows}["variations"] == "2 of 4"
    (failed,) = [each for each in summary.remarks if each.code == "variation-failed"]
    assert failed.severity == "warning"
    assert failed.text == "variation 3 is left out: its leaves need more memory than there is"
    assert [each.text.split(" does")[0] for each in summary.remarks if each.code.endswith("-without-branches")] == [
        "variation 2",
        "variation 2",
    ]
    assert sorted(each.name for each in (call.out / "asset" / "variations").iterdir()) == ["fork_02", "fork_04"]

    def fail_now(folder, name, **parts):
        write(folder, name, **parts)
        if name == "fork_03":
            raise WriteError("the disk is full")

    monkeypatch.setattr(assemble, "write_plant_asset", fail_now)
    shutil.rmtree(call.out)
    call.out.mkdir()
    with pytest.raises(WriteError, match="disk is full"):
        assemble_asset(call)  # type: ignore[arg-type]


@pytest.mark.parametrize(("growth", "exponent"), [({"allometryExponent": 0.6}, 0.6), ({}, 0.42)])
def test_a_build_grows_by_the_exponent_that_was_traced(monkeypatch, growth, exponent):
    """As the command branches has it; that of the species where nothing was traced."""
    used = []
    monkeypatch.setattr(assemble, "grow_near_leaves", lambda *given: used.append(given[4]))
    surfaces = BranchSurfaces(whole=build_branch_cage(fork()))
    branches = PlantBranches(
        skeleton=SkeletonPrim(skeleton=fork(), growth=growth), surfaces=surfaces, settings=BranchAssetSettings()
    )
    species = next(name for name, each in load_library(None).items() if each.exponent == 0.42)
    settings = replace(BuildSettings(), plant=replace(BuildSettings().plant, growth_frames=4, species=species))
    assemble.add_growth(branches, None, settings)
    assert used == [exponent]


@pytest.mark.parametrize(
    ("table", "wanted", "code"),
    [
        ("plant", {"sway_frames": 6}, "sway-without-branches"),
        ("plant", {"growth_frames": 6}, "growth-without-branches"),
        ("branches", {"variations": 1}, "variations-without-branches"),
    ],
)
def test_motion_and_variations_without_branches_are_a_warning(tmp_path, table, wanted, code):
    write_leaves_model(
        tmp_path / "leaves" / "leaves.npz", LeavesModel(leaves=two_leaves(), asset_from_capture=np.eye(4))
    )
    write_summary(tmp_path / "leaves", StageSummary(rows=[], remarks=[]))
    settings = BuildSettings()
    call = SimpleNamespace(
        out=tmp_path / "out",
        inputs=SimpleNamespace(name="fern", source=Path("fern"), digests=()),
        settings=replace(
            settings,
            pictures=PictureStageSettings(make=False),
            **{table: replace(getattr(settings, table), **wanted)},
        ),
        request=SimpleNamespace(name="fern", capture=Path("fern")),
        result_of=lambda name: tmp_path / name,
        has=lambda name: name == "leaves",
    )
    call.out.mkdir()
    assemble_asset(call)  # type: ignore[arg-type]
    summary = read_summary(call.out)
    assert [each.severity for each in summary.remarks if each.code == code] == ["warning"]


@pytest.mark.parametrize(
    ("kind", "found", "others", "explained", "confidence", "words"),
    [
        ("filled", 475, 1123, 0.57, 0.9, "475 of 1,598 leaves were found"),  # as of the tree of the README
        ("captured", 85, 0, 0.95, 0.85, ""),  # as of the basil
        ("filled", 60, 40, 0.7, 0.9, ""),
        ("captured", 12, 0, 0.3, 0.9, "30% of those that the cloud shows"),  # stems of photographs keep few
        ("captured", 12, 0, None, 0.9, ""),
        ("captured", 10, 0, 0.95, 0.35, "some 4 of 10 leaves that were found are right"),
        ("drawn", 40, 400, 0.1, 0.9, ""),  # none of the plant's is one that was found: foliage-chosen has that
    ],
)
def test_a_plant_of_guessed_leaves_is_reported(kind, found, others, explained, confidence, words):
    leaves = flat_leaves(np.zeros((found + others, 3)))
    rated = replace(leaves.take(np.arange(found)), confidence=np.full(found, confidence))
    chosen = ChosenFoliage(
        leaves=BranchLeaves(leaves=leaves), kind=kind, remarks=(), rows=(), found=rated, explained=explained
    )
    text = describe_guessed_leaves(chosen)
    assert words in text
    assert bool(text) == bool(words)
