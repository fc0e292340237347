"""usdview's plug-in: in a stand-in of usdview with its documented interface, and what it does to stages by itself."""

import io
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pxr import Gf, Sdf, Usd, UsdGeom
from usdfoliage.asset.looks.look import open_asset, read_look, write_look_layer
from usdfoliage.asset.parts.leaf_primvars import edit_values, read_edits
from usdfoliage.asset.parts.leaves import edited_leaves
from usdfoliage.jobs.preview.recorder import recorder_environment
from usdfoliage.jobs.preview.viewer import answer_requests
from usdfoliage.leaf.shape.bounds import common_bounds, leaf_bounds_m
from usdfoliage.leaf.shape.curves import leaf_curves
from usdfoliage.leaf.shape.edits import NEUTRAL, LeafEdits, bend_axis
from usdfoliage.leaf.shape.jitter import Jitter
from usdfoliage.leaf.shape.surface import evaluate_points
from usdviewFoliage import look_layer, plants, reach
from usdviewFoliage.edit_rows import ROWS, row_value, with_row
from usdviewFoliage.live_look import LiveLook
from usdviewFoliage.product import Product, ProductError, ProductGoneError

from tests.support.leaves.assets import FLAT, random_leaves, two_leaves, write_spray
from tests.support.plant_assets import write_whole_plant
from tests.support.virtual_display import python_with_qt

ROOT = Path(__file__).resolve().parents[2]
FOLDER = Path(__file__).resolve().parent / "usdview"
EDITED = LeafEdits(width=1.5, axis1=(0, 0, 0.25), axis2=(0, 0, 0.25), jitter_amplitude=0.02)

edits_of_any_kind = st.builds(
    LeafEdits,
    width=st.floats(0, 3),
    **{
        name: st.tuples(*[st.floats(-1, 1)] * 3)
        for name in ("axis1", "axis2", "silhouette1", "silhouette2", "silhouette3", "curl")
    },
    jitter_amplitude=st.floats(0, 0.3),
)


def open_live(asset: Path) -> tuple[Usd.Stage, LiveLook]:
    stage = Usd.Stage.Open(str(asset))
    return stage, LiveLook(stage, stage.GetDefaultPrim())


def leaves_of(stage: Usd.Stage) -> Usd.Prim:
    return stage.GetDefaultPrim().GetPrimAtPath("geo/render/Leaves")


# Rows


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row.group} {row.label}")
def test_a_row_shows_what_it_was_set_to(row) -> None:
    moved = with_row(row, edit_values(NEUTRAL), 0.4)
    assert row_value(row, moved) == pytest.approx(0.4)
    LeafEdits(**moved)


def test_rows_reach_every_number_of_the_edits() -> None:
    reached = {part for row in ROWS for part in row.parts}
    numbers = {
        (name, k)
        for name, value in edit_values(NEUTRAL).items()
        for k in (range(3) if isinstance(value, tuple) else [None])
    }
    assert reached == numbers
    assert set(look_layer.EDITS) == {name for name, _ in reached}


def test_a_row_that_moves_two_points_keeps_them_apart() -> None:
    start = edit_values(bend_axis(NEUTRAL, 0.2, points=(1,)))
    bend = next(row for row in ROWS if row.label == "bend")
    moved = with_row(bend, start, 0.5)
    assert moved["axis1"][2] - moved["axis2"][2] == pytest.approx(0.2)
    assert row_value(bend, moved) == pytest.approx(0.5)


# Reach


@given(edits=edits_of_any_kind, seed=st.integers(0, 5))
def test_the_guessed_box_holds_every_edited_leaf(edits, seed) -> None:
    stage = Usd.Stage.CreateInMemory()
    leaves = random_leaves(7, seed=seed)
    prim = UsdGeom.PointInstancer.Define(stage, "/Leaves")
    prim.CreatePositionsAttr([Gf.Vec3f(*map(float, base)) for base in leaves.base_m])
    prim.CreateScalesAttr([Gf.Vec3f(float(length)) for length in leaves.length_m])
    for row, name in enumerate(("axis1", "axis2", "silhouette1", "silhouette2", "silhouette3", "inner", "outer")):
        points = [Gf.Vec3f(*map(float, numbers)) for numbers in leaves.parameters[:, row]]
        UsdGeom.PrimvarsAPI(prim).CreatePrimvar(f"leaf:{name}", Sdf.ValueTypeNames.Float3Array).Set(points)
    known = reach.read_range(prim.GetPrim())
    box = reach.box_in_leaf_space(known, edit_values(edits))
    among = reach.box_among_leaves(known, box)
    drawn = edited_leaves(leaves, edits)
    jitter = Jitter(amplitude=edits.jitter_amplitude, frequency=edits.jitter_frequency)
    for guessed, exact in (
        (box, common_bounds(drawn.parameters, jitter)),
        (among, leaf_bounds_m(drawn, jitter)),
    ):
        # Boxes of usdfoliage stand off the surface by up to 2 %.
        slack = 0.02 * np.ptp(exact, axis=0).max()
        assert (np.array(guessed.min) <= exact[0] + slack).all()
        assert (np.array(guessed.max) >= exact[1] - slack).all()
    uv = np.stack(np.meshgrid(np.linspace(-1, 1, 9), np.linspace(0, 1, 17)), axis=-1).reshape(-1, 2)
    points = evaluate_points(drawn.parameters, uv, jitter, leaves.phase)
    assert (np.array(box.min) <= points.min(axis=(0, 1)) + 1e-6).all()
    assert (np.array(box.max) >= points.max(axis=(0, 1)) - 1e-6).all()


def test_no_leaves_have_no_range() -> None:
    stage = Usd.Stage.CreateInMemory()
    assert reach.read_range(UsdGeom.PointInstancer.Define(stage, "/Leaves").GetPrim()) is None


# Looks that are being made


def test_edits_act_in_the_session_and_the_asset_stays(tmp_path) -> None:
    stage, live = open_live(write_spray(tmp_path / "spray"))
    live.apply(edit_values(EDITED))
    assert read_edits(leaves_of(stage)) == LeafEdits(
        **{**edit_values(EDITED), "jitter_amplitude": np.float32(0.02).item()}
    )
    session = stage.GetSessionLayer()
    assert not session.subLayerPaths  # "Save Overrides As" of usdview would write an anonymous one by its name
    assert session.GetPrimAtPath(live.class_path)
    live.show(False)
    assert read_edits(leaves_of(stage)) == NEUTRAL
    assert not live.is_visible()
    live.show(True)
    live.reset()
    assert read_edits(leaves_of(stage)) == NEUTRAL
    assert live.layer.empty
    assert not session.rootPrims


def test_edits_leave_other_opinions_of_the_session_alone(tmp_path) -> None:
    stage, live = open_live(write_spray(tmp_path / "spray"))
    session = stage.GetSessionLayer()
    plants.select_variant(stage, "representation", "mesh")
    plants.select_variant(stage, "representation", "bezier")
    before = session.ExportToString()
    live.apply(edit_values(EDITED))
    assert "bezier" in session.ExportToString()
    assert LiveLook(stage, stage.GetDefaultPrim()).values()["width"] == 1.5  # an earlier panel's edits go on
    live.reset()
    assert session.ExportToString() == before


def test_extents_follow_and_come_back(tmp_path) -> None:
    """A slider that goes to and fro leaves what the same edits gave at once."""
    stage, live = open_live(write_spray(tmp_path / "spray"))

    def extent():
        return [tuple(corner) for corner in UsdGeom.Boundable(leaves_of(stage)).GetExtentAttr().Get()]

    start = extent()
    live.apply(edit_values(LeafEdits(width=2.0)))
    wide = extent()
    assert wide != start
    live.apply(edit_values(LeafEdits(width=2.0)))
    assert extent() == wide
    live.apply(edit_values(LeafEdits(width=3.0)))
    live.apply(edit_values(LeafEdits(width=2.0)))
    assert extent() == wide
    live.apply(edit_values(NEUTRAL))
    assert read_edits(leaves_of(stage)) == NEUTRAL


def test_edits_reach_every_placement_of_the_asset_instances_too(tmp_path) -> None:
    write_spray(tmp_path / "spray")
    stage = Usd.Stage.CreateInMemory()
    for name in ("one", "two"):
        prim = stage.DefinePrim(f"/World/{name}")
        prim.GetReferences().AddReference(str(tmp_path / "spray" / "spray.usda"))
        prim.SetInstanceable(name == "two")
    found = plants.find_plants(stage)
    assert [str(plant.GetPath()) for plant in found] == ["/World/one", "/World/two"]
    (plant,) = plants.one_of_each(found)
    live = LiveLook(stage, plant)
    live.apply(edit_values(EDITED))
    for name in ("one", "two"):
        assert read_edits(stage.GetPrimAtPath(f"/World/{name}/geo/render/Leaves")).width == 1.5
    assert plants.select_variant(stage, "representation", "mesh", live.interface) == 2
    assert stage.GetPrimAtPath("/World/two/geo/render/Leaves").GetTypeName() == "Mesh"
    assert plants.select_variant(stage, "representation", "voxels") == 0
    assert "bezier" in live.why_not()


def test_a_look_that_plain_usd_writes_is_one_of_usdfoliage(tmp_path) -> None:
    asset = write_spray(tmp_path / "spray")
    _, live = open_live(asset)
    (tmp_path / "looks").mkdir()
    live.write(str(tmp_path / "looks" / "plain.usda"), edit_values(EDITED))
    write_look_layer(tmp_path / "looks" / "ours.usda", asset, EDITED)
    plain, ours = (Sdf.Layer.FindOrOpen(str(tmp_path / "looks" / f"{name}.usda")) for name in ("plain", "ours"))
    assert read_look(plain).asset == read_look(ours).asset == asset
    stages = [open_asset(tmp_path / "looks" / f"{name}.usda") for name in ("plain", "ours")]
    prims = [leaves_of(stage) for stage in stages]
    assert read_edits(prims[0]) == read_edits(prims[1])
    wide, exact = (np.array(UsdGeom.Boundable(prim).GetExtentAttr().Get()) for prim in prims)
    assert (wide[0] <= exact[0] + 1e-6).all()
    assert (wide[1] >= exact[1] - 1e-6).all()
    with_exact_bounds = json.loads(_answer({"op": "bounds", "asset": str(asset), "edits": edit_values(EDITED)}))[
        "bounds"
    ]
    live.apply(edit_values(EDITED), with_exact_bounds)
    lines = [layer.ExportToString().split(")\n", 1)[1] for layer in (live.layer, ours)]
    assert lines[0] == lines[1]  # all but the look's own metadata


def test_a_look_is_refused_where_it_cannot_be(tmp_path) -> None:
    _, live = open_live(write_spray(tmp_path / "spray"))
    with pytest.raises(ValueError, match=r"\.usda"):
        live.write(str(tmp_path / "look.usdc"), edit_values(EDITED))


@pytest.mark.parametrize(
    ("primvar", "value_type", "value"),
    [
        ("curl", Sdf.ValueTypeNames.String, "x"),
        ("curl", Sdf.ValueTypeNames.Float, 1.0),
        ("width", Sdf.ValueTypeNames.Float3, Gf.Vec3f(1)),
    ],
)
def test_an_edit_of_another_type_is_as_none(tmp_path, primvar, value_type, value) -> None:
    stage = Usd.Stage.Open(str(write_spray(tmp_path / "spray", random_leaves(2))))
    layer = Sdf.Layer.CreateAnonymous(".usda")
    spec = Sdf.CreatePrimInLayer(layer, leaves_of(stage).GetPath())
    Sdf.AttributeSpec(spec, f"primvars:leaf:edit:{primvar}", value_type).default = value
    stage.GetSessionLayer().subLayerPaths.append(layer.identifier)
    live = LiveLook(stage, stage.GetDefaultPrim())
    assert primvar not in live.values()
    assert "axis1" in live.values()


def test_what_cannot_be_edited_is_reported(tmp_path) -> None:
    stage, live = open_live(write_spray(tmp_path / "spray"))
    assert live.why_not() == ""
    plants.select_variant(stage, "representation", "nurbs")
    assert "choose it" in live.why_not()
    bare = Usd.Stage.CreateInMemory()
    prim = bare.DefinePrim("/plant", "Xform")
    prim.AddAppliedSchema(plants.PLANT_API)
    assert "inherits no class" in LiveLook(bare, prim).why_not()
    assert plants.interface_file(prim) == ""


def test_guides_are_switched_by_name(tmp_path) -> None:
    stage = Usd.Stage.Open(str(write_spray(tmp_path / "spray")))
    skeleton = UsdGeom.Scope.Define(stage, "/spray/geo/guide/Skeleton")
    cloud = UsdGeom.Scope.Define(stage, "/spray/geo/guide/Cloud")
    plants.show_guides(stage, {"Cloud"})
    assert (skeleton.ComputeVisibility(), cloud.ComputeVisibility()) == ("invisible", "inherited")
    plants.show_guides(stage, set())
    assert (skeleton.ComputeVisibility(), cloud.ComputeVisibility()) == ("inherited", "inherited")


def test_the_wood_is_hidden_for_as_long_as_the_skeleton_is_visible(tmp_path) -> None:
    stage = Usd.Stage.Open(str(write_whole_plant(tmp_path / "oak")))
    wood = UsdGeom.Imageable(stage.GetPrimAtPath("/oak/geo/render/Branches"))
    before = stage.GetSessionLayer().ExportToString()
    plants.show_guides(stage, {"Skeleton"})
    assert wood.ComputeVisibility() == "invisible"
    plants.show_guides(stage, {"Cloud"})
    assert wood.ComputeVisibility() == "inherited"
    plants.show_guides(stage, {"Skeleton"})
    plants.show_guides(stage, set())
    assert wood.ComputeVisibility() == "inherited"
    assert "Branches" not in stage.GetSessionLayer().ExportToString()
    assert "Branches" not in before
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        wood.MakeInvisible()  # by the user, which stays
    for visible in ({"Skeleton"}, set()):
        plants.show_guides(stage, visible)
        assert wood.ComputeVisibility() == "invisible"


# What usdfoliage answers


def _answer(*requests: dict) -> bytes:
    replies = io.BytesIO()
    answer_requests(io.BytesIO(b"".join(json.dumps(request).encode() + b"\n" for request in requests)), replies)
    return replies.getvalue()


def test_curves_are_those_of_the_leaf() -> None:
    curves = leaf_curves(FLAT)
    assert [curve.name for curve in curves] == ["axis", "silhouette", "outer", "inner", "inner", "outer", "silhouette"]
    v = np.linspace(0, 1, 65)
    np.testing.assert_allclose(curves[0].points, np.column_stack([0 * v, v, 0 * v]), atol=1e-12)
    half_width = 4 * 0.25 * (1 - v) ** 3 * v + 6 * 0.5 * (1 - v) ** 2 * v**2 + 4 * 0.25 * (1 - v) * v**3
    for number, part in ((1, -1), (2, -2 / 3), (3, -1 / 3), (4, 1 / 3), (5, 2 / 3), (6, 1)):
        np.testing.assert_allclose(curves[number].points[:, 0], part * half_width, atol=1e-12)
        np.testing.assert_allclose(curves[number].controls[2], (part * 0.5, 0.5, 0), atol=1e-12)


def test_jitter_moves_the_silhouette_alone() -> None:
    plain, waved = leaf_curves(FLAT), leaf_curves(FLAT, Jitter(amplitude=0.1))
    for first, second in zip(plain, waved, strict=True):
        assert (np.abs(first.points - second.points).max() > 0.01) == (first.name == "silhouette")


def test_the_average_leaf_and_faults_are_answered(tmp_path) -> None:
    asset = str(write_spray(tmp_path / "spray"))
    narrow, wide, *faults = map(
        json.loads,
        _answer(
            {"op": "leaf", "asset": asset, "edits": {}},
            {"op": "leaf", "asset": asset, "edits": {"width": 2.0}},
            {"op": "leaf", "asset": str(tmp_path), "edits": {}},
            {"op": "leaf", "asset": asset, "edits": {"colour": 1.0}},
            {"op": "leaf", "asset": asset, "edits": {"width": -1.0}},
            {"op": "save", "asset": asset, "edits": {}, "path": str(tmp_path / "spray" / "look.usda")},
            {"op": "fly", "asset": asset, "edits": {}},
            {"op": "leaf"},
        ).splitlines(),
    )
    first, second = (np.array(reply["curves"][6]["controls"]) for reply in (narrow, wide))
    np.testing.assert_allclose(second[1:4, 0], 2 * first[1:4, 0])
    np.testing.assert_allclose(first[2], (0.5, 0.5, 0), atol=0.2)
    assert all(list(fault) == ["error"] and fault["error"] for fault in faults)


def test_a_product_that_is_gone_is_reported() -> None:
    with pytest.raises(ProductGoneError):
        Product(io.BytesIO(), io.BytesIO()).ask(op="leaf")
    with pytest.raises(ProductError, match="no leaf"):
        Product(io.BytesIO(), io.BytesIO(b'{"error": "no leaf"}\n')).ask(op="leaf")


# usdview


def usdview_session(tmp_path: Path, path: str) -> tuple[dict, Path]:
    """What a stand-in of usdview saw on a spray, with programs on this path."""
    asset = write_spray(tmp_path / "spray", two_leaves())
    return in_usdview("session.py", asset, tmp_path, path), asset


def in_usdview(session: str, asset: Path, folder: Path, path: str) -> dict:
    """What a session saw."""
    python = python_with_qt()
    modules = os.pathsep.join(str(ROOT / name) for name in ("hydra_preview", "usd_plugins"))
    environment = {**recorder_environment(folder), "QT_QPA_PLATFORM": "offscreen", "PATH": path, "PYTHONPATH": modules}
    outcome = subprocess.run(
        [str(python), str(FOLDER / session), str(asset), str(folder)],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert outcome.returncode == 0, outcome.stderr
    return json.loads(outcome.stdout.splitlines()[-1])


@pytest.mark.preview
def test_the_menu_and_the_panel_in_usdview_without_usdfoliage(tmp_path) -> None:
    seen, asset = usdview_session(tmp_path, "/nowhere")
    assert list(seen["menus"]) == ["Foliage"]
    menu = seen["menus"]["Foliage"]
    assert list(menu["Representation"]) == ["bezier", "nurbs", "subdiv", "mesh"]
    assert list(menu["Level of detail"]) == ["leaves", "both", "crown", "auto"]
    assert {"Show skeleton", "Show cloud", "Show cameras", "Leaf edits…", "Reset edits", "Save edits as look…"} < set(
        menu
    )
    assert seen["mesh"] == ["mesh", "Mesh"]
    assert seen["no_crown"] == ["leaves", "No plant has the lod crown."]
    assert seen["panel"]
    assert seen["sentence"] == "The leaves have no edits yet."
    assert seen["boxes"] == ["lod", "representation"]
    assert (seen["product"], seen["curves"]) == (False, 0)
    assert seen["edited"] == [1.5, True]
    assert seen["helpers"] == 0
    assert seen["status"].startswith("The look is saved with wide extents")
    assert ".usda" in seen["refused"]
    assert seen["hidden"] == [1.0, 1.0, "The edits are hidden. Show them to change them."]
    assert seen["visible"] == [1.5, 1.5, "The leaves are edited."]
    assert seen["subdiv"] == ["subdiv", False, "Edits act on the representation bezier: choose it."]
    assert seen["back"] == [True, 1.5]
    assert seen["reset"] == [1.0, 1.0, "All edits are taken back."]
    assert seen["guide"] == [True, "inherited", "The skeleton is visible now."]
    assert seen["no_guide"] == [False, "The skeleton is hidden now."]
    assert seen["no_cloud"] == "No plant has a cloud."
    assert seen["untouched"]
    assert seen["elsewhere"] == ["mesh", False]
    assert seen["again"] == {"closed": True, "widths": [1.25, 1.0], "same_product": True}
    overrides = Usd.Stage.Open(str(asset), load=Usd.Stage.LoadAll)
    overrides.GetSessionLayer().TransferContent(Sdf.Layer.FindOrOpen(str(tmp_path / "overrides.usda")))
    assert read_edits(leaves_of(overrides)).width == 1.5
    look = open_asset(tmp_path / "saved.usda")
    saved = read_edits(leaves_of(look))
    for name, value in edit_values(EDITED).items():
        np.testing.assert_allclose(getattr(saved, name), value, atol=1e-7)
    drawn = leaf_bounds_m(edited_leaves(two_leaves(), EDITED), Jitter(amplitude=0.02))
    low, high = np.array(seen["extent"])
    assert (low <= drawn[0] + 1e-6).all()
    assert (high >= drawn[1] - 1e-6).all()


@pytest.mark.preview
def test_a_whole_plant_in_usdview_without_usdfoliage(tmp_path) -> None:
    asset = write_whole_plant(tmp_path / "oak")
    seen = in_usdview("plant_session.py", asset, tmp_path, "/nowhere")
    assert seen["lods"] == ["auto", "both", "crown", "leaves"]
    assert seen["crown"] == [False, "The lod crown shows no leaves to edit: choose leaves or both or auto."]
    assert seen["again"] == [True, "The leaves have no edits yet."]
    assert seen["widths"] == {"leaves": 1.5, "both": 1.5, "crown": None, "auto": 1.5}
    # USD alone writes what usdfoliage writes, but for extents, which are as large or larger.
    write_look_layer(tmp_path / "ours.usda", asset, LeafEdits(width=1.5))
    ours, theirs = (Sdf.Layer.FindOrOpen(str(tmp_path / name)) for name in ("ours.usda", "saved.usda"))
    assert edits_in(theirs) == edits_in(ours)
    assert len(edits_in(ours)) == 3
    assert ours.customLayerData == theirs.customLayerData
    for lod in ("leaves", "both", "auto"):
        boxes = [hint_of(layer, asset, lod) for layer in (ours, theirs)]
        assert all(wide.Contains(box) for box, wide in zip(*boxes, strict=True) if not box.IsEmpty())
    assert hint_of(theirs, asset, "crown") == hint_of(ours, asset, "crown")


@pytest.mark.preview
def test_the_panel_has_room_in_a_small_window_for_long_names(tmp_path) -> None:
    names = ("Rosa_gallica_officinalis_of_the_old_garden_wall_v0012_publish", "b" * 80)
    assets = [write_spray(tmp_path / name, two_leaves()) for name in ("spray", "other")]
    scene = Usd.Stage.CreateNew(str(tmp_path / "scene.usda"))
    for name, asset in zip(names, assets, strict=True):
        prim = scene.DefinePrim(f"/World/{name}")
        prim.GetReferences().AddReference(str(asset))
        seasons = prim.GetVariantSets().AddVariantSet("season_and_weather_of_the_year")
        seasons.AddVariant("late_summer_after_three_weeks_without_any_rain")
    scene.Save()
    seen = in_usdview("small_session.py", tmp_path, tmp_path, "/nowhere")
    assert seen["on_screen"]
    assert seen["size"][0] <= 340
    assert seen["size"][1] <= 240
    assert seen["cut"] == []
    assert seen["sideways"] == 0
    assert names[0] in seen["tip"]
    assert seen["wheel"] == [True, True]
    assert seen["reached"]


def edits_in(layer: Sdf.Layer) -> dict[Sdf.Path, object]:
    """The edits in a look, by their paths with variants."""
    found: dict[Sdf.Path, object] = {}

    def look(path: Sdf.Path) -> None:
        if path.IsPropertyPath() and "leaf:edit" in path.name:
            found[path] = layer.GetAttributeAtPath(path).default

    layer.Traverse(Sdf.Path.absoluteRootPath, look)
    return found


def hint_of(look: Sdf.Layer, asset: Path, lod: str) -> list[Gf.Range3d]:
    """The boxes of the purposes of a plant under a look."""
    root = Sdf.Layer.CreateAnonymous()
    root.subLayerPaths.append(look.identifier)
    stage = Usd.Stage.Open(root)
    plant = stage.DefinePrim("/oak")
    plant.GetReferences().AddReference(str(asset))
    plant.GetVariantSets().SetSelection("lod", lod)
    corners = [Gf.Vec3d(corner) for corner in UsdGeom.ModelAPI(plant).GetExtentsHintAttr().Get()]
    return [Gf.Range3d(*corners[first : first + 2]) for first in range(0, len(corners), 2)]


@pytest.mark.preview
def test_usdview_saves_through_the_usdfoliage_on_the_path(tmp_path) -> None:
    (tmp_path / "bin").mkdir()
    program = tmp_path / "bin" / "usdfoliage"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m usdfoliage "$@"\n', encoding="utf-8")
    program.chmod(0o755)
    seen, asset = usdview_session(tmp_path, os.pathsep.join([str(tmp_path / "bin"), os.environ["PATH"]]))
    assert (seen["product"], seen["curves"]) == (True, 7)
    assert seen["again"]["same_product"]
    assert seen["helpers"] == 1  # however often the panel was opened
    write_look_layer(tmp_path / "ours.usda", asset, EDITED)
    assert (tmp_path / "saved.usda").read_bytes() == (tmp_path / "ours.usda").read_bytes()
    assert "must end with .usda" in seen["refused"]


def test_usd_without_usdview_takes_no_notice(tmp_path) -> None:
    root = FOLDER.parents[2]
    program = (
        "from pxr import Plug, Usd\n"
        "assert Plug.Registry().GetPluginWithName('usdviewFoliage')\n"
        "Usd.Stage.CreateInMemory()\n"
        "import usdviewFoliage\n"
    )
    environment = {
        **os.environ,
        "PXR_PLUGINPATH_NAME": str(root / "usd_plugins" / "usdviewFoliage"),
        "PYTHONPATH": str(root / "usd_plugins"),
    }
    outcome = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=False
    )
    assert (outcome.returncode, outcome.stderr) == (0, "")
