"""Looks: what they reach, what they leave alone, what they refuse, and how assets and looks are opened."""

import os
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pxr import Sdf, Usd, UsdGeom, UsdShade
from usdfoliage.asset.locate import find_leaves, find_plants, require_leaves, select_representation
from usdfoliage.asset.look_layer import EDITS
from usdfoliage.asset.looks.look import open_asset, read_look, write_look_layer
from usdfoliage.asset.packages.leaf_package import write_leaf_asset
from usdfoliage.asset.parts.leaf_part import LeafAssetSettings
from usdfoliage.asset.parts.leaf_primvars import read_edits
from usdfoliage.asset.parts.leaves import read_leaves
from usdfoliage.asset.provenance import Provenance
from usdfoliage.asset.validation.validate import validate_asset
from usdfoliage.errors import AssetError, FoliageError
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.edits import NEUTRAL, LeafEdits, apply_edits
from usdfoliage.leaf.shape.jitter import Jitter
from usdfoliage.leaf.shape.spray import scatter_spray
from usdfoliage.leaf.shape.surface import evaluate_grid

LEAVES = "geo/render/Leaves"
PLACEMENTS = ("/World/deep/plant_1", "/World/deep/plant_2", "/World/instance")
WIDE = LeafEdits(width=2.5, curl=(0.0, 0.125, 0.25))


def write_oak(folder: Path, leaves: Leaves, edits: LeafEdits = NEUTRAL, **chosen: object) -> Path:
    folder.mkdir(parents=True)
    provenance = Provenance(capture="spray", generator="a test", seed=1, input_sha256="")
    return write_leaf_asset(folder, "oak", leaves, provenance, LeafAssetSettings(**chosen), edits)


def spray(count: int = 6) -> Leaves:
    return scatter_spray(count, np.random.default_rng(3))


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the asset oak in bezier and mesh; tests write into folders of their own."""
    folder = tmp_path_factory.mktemp("a show")
    write_oak(folder / "oak", spray(), representations=("bezier", "mesh"))
    return folder


@pytest.fixture
def oak(shared: Path) -> Path:
    return shared / "oak"


@pytest.fixture
def scene(oak: Path, tmp_path: Path) -> Usd.Stage:
    """A scene that knows nothing of us: centimetres, Z up, and three placements, of which one is an instance."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "scene.usda"))
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    UsdGeom.SetStageUpAxis(stage, "Z")
    for path in PLACEMENTS:
        prim = stage.DefinePrim(path)
        prim.GetReferences().AddReference(os.path.relpath(oak / "oak.usda", tmp_path))
        prim.SetInstanceable("instance" in path)
    stage.GetRootLayer().Save()
    return stage


def edits_of(stage: Usd.Stage) -> dict[str, LeafEdits]:
    """By placement."""
    found = {}
    for prim in find_leaves(stage):
        assert prim.GetPath().name == "Leaves"
        found[str(prim.GetPath()).removesuffix(f"/{LEAVES}")] = read_edits(prim)
    return found


def authored(path: Path) -> set[str]:
    """Names of all attributes that a layer has opinions of."""
    layer, found = Sdf.Layer.FindOrOpen(str(path)), set()

    def note(place: Sdf.Path) -> None:
        if place.IsPropertyPath():
            found.add(place.name)

    layer.Traverse(Sdf.Path.absoluteRootPath, note)
    return found


def values(stage: Usd.Stage) -> dict[str, str]:
    return {
        str(attribute.GetPath()): repr(attribute.Get())
        for prim in stage.Traverse(Usd.TraverseInstanceProxies())
        for attribute in prim.GetAttributes()
    }


def test_look_reaches_every_placement_and_muting_it_takes_it_back(scene: Usd.Stage, oak: Path, tmp_path: Path) -> None:
    before = values(Usd.Stage.Open(scene.GetRootLayer()))
    look = write_look_layer(tmp_path / "looks" / "wide.usda", oak, WIDE)
    scene.GetRootLayer().subLayerPaths.append("./looks/wide.usda")
    stage = Usd.Stage.Open(scene.GetRootLayer())
    assert edits_of(stage) == dict.fromkeys(PLACEMENTS, WIDE)
    assert stage.GetPrimAtPath(PLACEMENTS[2]).IsInstance()
    stage.MuteLayer(str(look))
    assert edits_of(stage) == dict.fromkeys(PLACEMENTS, NEUTRAL)
    assert values(stage) == before
    stage.UnmuteLayer(str(look))
    assert edits_of(stage) == dict.fromkeys(PLACEMENTS, WIDE)


def test_look_reaches_a_scene_within_a_shot(scene: Usd.Stage, oak: Path, tmp_path: Path) -> None:
    write_look_layer(tmp_path / "wide.usda", oak, WIDE)
    shot = Usd.Stage.CreateNew(str(tmp_path / "shot.usda"))
    shot.GetRootLayer().subLayerPaths.append("./wide.usda")
    shot.DefinePrim("/Set").GetReferences().AddReference("./scene.usda", "/World")
    assert edits_of(shot) == {path.replace("/World", "/Set"): WIDE for path in PLACEMENTS}


@pytest.mark.parametrize("load", [Usd.Stage.LoadAll, Usd.Stage.LoadNone])
def test_look_brings_no_plant_of_its_own(
    scene: Usd.Stage, oak: Path, tmp_path: Path, load: Usd.Stage.InitialLoadSet
) -> None:
    write_look_layer(tmp_path / "wide.usda", oak, WIDE, write_map(tmp_path / "map.exr", [0.0, 1.0]))
    stage = Usd.Stage.Open(scene.GetRootLayer(), load)
    before = {prim.GetPath() for prim in stage.Traverse()}
    scene.GetRootLayer().subLayerPaths.append("./wide.usda")
    added = {prim.GetPath() for prim in stage.Traverse()} - before
    assert {path.name for path in added} == ({"JitterMap", "St"} if load == Usd.Stage.LoadAll else set())


def test_a_look_authors_only_what_differs_from_the_asset(oak: Path, tmp_path: Path) -> None:
    look = write_look_layer(tmp_path / "look.usda", oak, LeafEdits(axis1=(0.0, 0.0, 0.25)))
    assert authored(look) == {"primvars:leaf:edit:axis1", "extent", "extentsHint"}
    assert authored(write_look_layer(tmp_path / "none.usda", oak, NEUTRAL)) == set()
    narrow = write_look_layer(tmp_path / "narrow.usda", oak, LeafEdits(width=0.5))
    assert authored(narrow) == {"primvars:leaf:edit:width"}  # no extent becomes smaller


def test_edits_that_the_asset_has_already(tmp_path: Path) -> None:
    write_oak(tmp_path / "oak", spray(), LeafEdits(width=2.0, curl=(0.1, 0.2, 0.3)))
    same = write_look_layer(tmp_path / "same.usda", tmp_path / "oak", LeafEdits(width=2.0, curl=(0.1, 0.2, 0.3)))
    assert authored(same) == set()
    back = write_look_layer(tmp_path / "back.usda", tmp_path / "oak", LeafEdits(curl=(0.1, 0.2, 0.3)))
    assert authored(back) == {"primvars:leaf:edit:width"}
    stage = open_asset(back)
    assert edits_of(stage)["/oak"].width == 1.0


def extents(stage: Usd.Stage) -> dict[str, np.ndarray]:
    return {
        str(prim.GetPath()): np.array(UsdGeom.Boundable(prim).GetExtentAttr().Get())
        for prim in stage.Traverse()
        if UsdGeom.Boundable(prim)
    }


@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    width=st.floats(0, 3),
    curl=st.tuples(*[st.floats(-0.5, 0.5)] * 3),
    axis=st.tuples(*[st.floats(-0.5, 0.5)] * 3),
    amplitude=st.floats(0, 0.3),
)
def test_extents_hold_the_edited_leaves(
    oak: Path,
    tmp_path: Path,
    width: float,
    curl: tuple[float, float, float],
    axis: tuple[float, float, float],
    amplitude: float,
) -> None:
    edits = LeafEdits(width=width, curl=curl, axis2=axis, jitter_amplitude=amplitude)
    stage = open_asset(write_look_layer(tmp_path / "look.usda", oak, edits))
    (prim,) = find_leaves(stage)
    leaves = read_leaves(prim).leaves
    along = np.linspace(0, 1, 65)
    grid = evaluate_grid(
        apply_edits(leaves.parameters, read_edits(prim)),
        np.linspace(-1, 1, 9),
        along,
        Jitter(amplitude=amplitude),
        leaves.phase,
    )
    drawn = grid.points.reshape(len(leaves), -1, 3)
    matrices = leaves.asset_from_leaf()
    placed = np.einsum("nij,npj->npi", matrices[:, :, :3], drawn) + matrices[:, None, :, 3]
    bounds = extents(stage)
    for name, points in (("/oak/geo/render/Leaves/Prototypes/Leaf", drawn), ("/oak/geo/render/Leaves", placed)):
        flat = points.reshape(-1, 3)
        slack = 2e-5 * np.ptp(flat, axis=0).max()
        assert (bounds[name][0] <= flat.min(axis=0) + slack).all()
        assert (bounds[name][1] >= flat.max(axis=0) - slack).all()
    hint = np.array(UsdGeom.ModelAPI(stage.GetPrimAtPath("/oak")).GetExtentsHintAttr().Get())
    assert (hint[0] <= bounds["/oak/geo/render/Leaves"][0] + 1e-5).all()
    assert (hint[1] >= bounds["/oak/geo/render/Leaves"][1] - 1e-5).all()


def test_extents_only_grow(oak: Path, tmp_path: Path) -> None:
    before = extents(open_asset(oak))
    after = extents(open_asset(write_look_layer(tmp_path / "look.usda", oak, LeafEdits(axis1=(0.5, 0.0, 0.0)))))
    for name, (low, high) in before.items():
        assert (after[name][0] <= low).all()
        assert (after[name][1] >= high).all()


def test_other_representations_are_as_without_the_look(scene: Usd.Stage, oak: Path, tmp_path: Path) -> None:
    """Their leaves are other prims at the same path: a Mesh there would be culled or framed by a wrong extent."""
    write_look_layer(tmp_path / "wide.usda", oak, WIDE)
    before = Usd.Stage.Open(scene.GetRootLayer())
    select_representation(before, "mesh")
    expected = values(before)
    assert before.GetPrimAtPath(f"{PLACEMENTS[0]}/{LEAVES}").GetTypeName() == "Mesh"
    scene.GetRootLayer().subLayerPaths.append("./wide.usda")
    after = Usd.Stage.Open(scene.GetRootLayer())
    assert edits_of(after) == dict.fromkeys(PLACEMENTS, WIDE)
    select_representation(after, "mesh")
    assert values(after) == expected


def test_look_for_one_placement(scene: Usd.Stage, oak: Path, tmp_path: Path) -> None:
    for number, path in enumerate(PLACEMENTS[1:]):
        write_look_layer(tmp_path / f"{number}.usda", oak, WIDE, prim_path=path)
        scene.GetRootLayer().subLayerPaths = [f"./{number}.usda"]
        assert edits_of(Usd.Stage.Open(scene.GetRootLayer())) == dict.fromkeys(PLACEMENTS, NEUTRAL) | {path: WIDE}


@pytest.mark.parametrize("order", [("all", "one"), ("one", "all")])
def test_look_for_one_placement_over_one_for_all(
    scene: Usd.Stage, oak: Path, tmp_path: Path, order: tuple[str, str]
) -> None:
    """It is the more particular of the two in whatever order."""
    write_look_layer(tmp_path / "all.usda", oak, WIDE)
    write_look_layer(tmp_path / "one.usda", oak, LeafEdits(width=0.5), prim_path=PLACEMENTS[1])
    scene.GetRootLayer().subLayerPaths = [f"./{name}.usda" for name in order]
    found = edits_of(Usd.Stage.Open(scene.GetRootLayer()))
    assert found == dict.fromkeys(PLACEMENTS, WIDE) | {PLACEMENTS[1]: LeafEdits(width=0.5, curl=WIDE.curl)}


def test_look_for_one_placement_by_itself(oak: Path, tmp_path: Path) -> None:
    stage = open_asset(write_look_layer(tmp_path / "one.usda", oak, WIDE, prim_path=PLACEMENTS[0]))
    assert edits_of(stage) == {PLACEMENTS[0]: WIDE}
    assert stage.GetDefaultPrim().GetPath() == "/World"


@pytest.mark.parametrize("path", ["/oak", "/World/plant", PLACEMENTS[0]])
def test_look_for_one_placement_is_as_sound_as_the_asset(oak: Path, tmp_path: Path, path: str) -> None:
    report = validate_asset(write_look_layer(tmp_path / "one.usda", oak, WIDE, prim_path=path))
    expected = {(finding.severity, finding.validator, finding.error) for finding in validate_asset(oak).findings}
    assert {(finding.severity, finding.validator, finding.error) for finding in report.findings} <= expected


@pytest.mark.parametrize(
    "path",
    [
        *("World/plant", "/", "", "/World.size", "/a b", "/World{lod=leaves}", "/a{x=y}b", "/a{x=}", "../plant", ".."),
        "/a.b[/c]",
    ],
)
def test_what_is_no_placement(oak: Path, tmp_path: Path, path: str) -> None:
    with pytest.raises(AssetError, match="is no path of a prim"):
        write_look_layer(tmp_path / "look.usda", oak, WIDE, prim_path=path)
    assert not list(tmp_path.iterdir())


def test_look_of_a_look_stands_alone(oak: Path, tmp_path: Path) -> None:
    first = write_look_layer(tmp_path / "first.usda", oak, WIDE, prim_path=PLACEMENTS[0])
    edits = LeafEdits(width=3.0, curl=WIDE.curl, jitter_amplitude=0.25)
    second = write_look_layer(tmp_path / "elsewhere" / "second.usda", first, edits)
    first.unlink()
    look = read_look(Sdf.Layer.FindOrOpen(str(second)))
    assert look is not None
    assert (look.asset, look.prim_path) == (oak / "oak.usda", PLACEMENTS[0])
    assert edits_of(open_asset(second)) == {PLACEMENTS[0]: edits}


def test_look_may_replace_the_look_that_it_is_made_from(oak: Path, tmp_path: Path) -> None:
    look = write_look_layer(tmp_path / "look.usda", oak, WIDE)
    opened = open_asset(look)
    write_look_layer(look, look, LeafEdits(width=0.5))
    assert edits_of(opened) == {"/oak": LeafEdits(width=0.5)}  # what is open already too


def write_map(path: Path, row: list[float]) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    OpenEXR.File({"type": OpenEXR.scanlineimage}, {"R": np.array([row], np.float32)}).write(str(path))
    return path


def test_jitter_map_is_referred_to(scene: Usd.Stage, oak: Path, tmp_path: Path) -> None:
    serrated = write_map(tmp_path / "maps of mine" / "serrated.exr", [0.0, 0.5, 1.0, 0.25])
    edits = LeafEdits(jitter_amplitude=0.25)
    look = write_look_layer(tmp_path / "looks" / "jagged.usda", oak, edits, serrated)
    assert "@../maps of mine/serrated.exr@" in look.read_text()
    scene.GetRootLayer().subLayerPaths.append("./looks/jagged.usda")
    for path in PLACEMENTS:
        assert read_leaves(scene.GetPrimAtPath(f"{path}/{LEAVES}")).jitter_map == serrated
        surface = UsdShade.Shader(scene.GetPrimAtPath(f"{path}/mtl/Leaf/StormSurface"))
        assert surface.GetPrim().GetAttribute("info:glslfx:sourceAsset").Get().resolvedPath
        (source,), _ = surface.GetInput("jitterMap").GetConnectedSources()
        assert source.source.GetPath() == Sdf.Path(f"{path}/mtl/Leaf/JitterMap")
        file = source.source.GetPrim().GetAttribute("inputs:file").Get()
        assert Path(file.resolvedPath) == serrated
    again = write_look_layer(tmp_path / "again.usda", look, edits)  # keeps it
    assert "@./maps of mine/serrated.exr@" in again.read_text()


@pytest.mark.parametrize(
    "row",
    [[0.0, float("nan")], [0.0, 1.5], [-0.5, 0.5], [0.5]],
)
def test_jitter_map_that_is_none(oak: Path, tmp_path: Path, row: list[float]) -> None:
    wrong = write_map(tmp_path / "map.exr", row)
    with pytest.raises(FoliageError, match=r"map\.exr"):
        write_look_layer(tmp_path / "look.usda", oak, WIDE, wrong)
    assert not (tmp_path / "look.usda").exists()


def test_jitter_map_that_is_missing_or_no_image(oak: Path, tmp_path: Path) -> None:
    (tmp_path / "text.png").write_text("no image")
    for name in ("text.png", "none.png"):
        with pytest.raises(FoliageError, match=name):
            write_look_layer(tmp_path / "look.usda", oak, WIDE, tmp_path / name)


def test_paths_with_dots_spaces_and_links(oak: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "some where" / "deep").mkdir(parents=True)
    (tmp_path / "link").symlink_to(tmp_path / "some where" / "deep")
    monkeypatch.chdir(tmp_path)
    asset = Path(os.path.relpath(oak, tmp_path))
    for path in ("some where/deep/../look.usda", "link/look.usda", "link/../up.usda", "./here.usda"):
        write_look_layer(Path(path), asset, WIDE)
        assert Path(path).is_file()
        assert edits_of(open_asset(Path(path))) == {"/oak": WIDE}
        record = Sdf.Layer.OpenAsAnonymous(os.path.realpath(path)).customLayerData["usdfoliage"]["lookOf"]
        assert record.startswith(("./", "../"))
    assert (tmp_path / "some where" / "up.usda").is_file()


def test_same_look_has_the_same_bytes(oak: Path, tmp_path: Path) -> None:
    first = write_look_layer(tmp_path / "a" / "look.usda", oak, WIDE).read_bytes()
    assert write_look_layer(tmp_path / "b" / "look.usda", oak / "oak.usda", WIDE).read_bytes() == first
    assert str(tmp_path).encode() not in first


def test_look_keeps_off_the_asset_and_what_is_not_ours(oak: Path, tmp_path: Path) -> None:
    before = {path: path.read_bytes() for path in sorted(oak.rglob("*")) if path.is_file()}
    (tmp_path / "oak").symlink_to(oak)
    (tmp_path / "scene.usda").write_text('#usda 1.0\ndef "World" {\n}\n')
    (tmp_path / "text.usda").write_text("no USD")
    (tmp_path / "folder.usda").mkdir()
    for path, complaint in (
        (oak / "oak.usda", "lies in the asset's folder"),
        (oak / "payload" / "look.usda", "lies in the asset's folder"),
        (tmp_path / "oak" / "look.usda", "lies in the asset's folder"),
        (tmp_path / "scene.usda", "no look of usdfoliage"),
        (tmp_path / "text.usda", "no look of usdfoliage"),
        (tmp_path / "folder.usda", "is a folder"),
        (tmp_path / "look.usdc", r"must end with \.usda"),
        (tmp_path / "look", r"must end with \.usda"),
        (tmp_path / "text.usda" / "look.usda", "was not written"),
    ):
        with pytest.raises(AssetError, match=complaint) as caught:
            write_look_layer(path, oak, WIDE)
        assert str(path) in str(caught.value) or path.parent == tmp_path / "oak"
    with pytest.raises(AssetError, match="lies in the asset's folder"):
        write_look_layer(oak / "oak.usda", oak, WIDE, force=True)
    assert {path: path.read_bytes() for path in sorted(oak.rglob("*")) if path.is_file()} == before
    write_look_layer(tmp_path / "scene.usda", oak, WIDE, force=True)
    assert edits_of(open_asset(tmp_path / "scene.usda")) == {"/oak": WIDE}


def test_look_appears_whole_or_not_at_all(oak: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    look = write_look_layer(tmp_path / "look.usda", oak, WIDE)
    before = look.read_bytes()

    def fail(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(AssetError, match="No space left on device"):
        write_look_layer(look, oak, LeafEdits(width=0.5))
    assert look.read_bytes() == before
    assert list(tmp_path.iterdir()) == [look]


def test_asset_without_leaves_to_edit(tmp_path: Path) -> None:
    write_oak(tmp_path / "bare", spray(0))
    look = write_look_layer(tmp_path / "look.usda", tmp_path / "bare", WIDE)
    assert edits_of(open_asset(look)) == {"/oak": WIDE}
    assert "extent" not in authored(look)


def test_what_a_look_cannot_be_made_of(scene: Usd.Stage, oak: Path, tmp_path: Path) -> None:
    with pytest.raises(AssetError, match="is no asset"):
        write_look_layer(tmp_path / "look.usda", Path(scene.GetRootLayer().realPath), WIDE)
    text = (oak / "oak.usda").read_text()
    (tmp_path / "copy" / "payload").mkdir(parents=True)
    (tmp_path / "copy" / "oak.usda").write_text(text.replace("    prepend inherits = </__class__/oak>\n", ""))
    (tmp_path / "copy" / "payload" / "payload.usda").write_text(
        '#usda 1.0\n(\n defaultPrim = "oak"\n)\ndef "oak" {\n}\n'
    )
    with pytest.raises(AssetError, match="inherits no class"):
        write_look_layer(tmp_path / "look.usda", tmp_path / "copy", WIDE)
    (tmp_path / "copy" / "oak.usda").write_text(text)
    Sdf.Layer.FindOrOpen(str(tmp_path / "copy" / "oak.usda")).Reload(force=True)
    with pytest.raises(AssetError, match="a plant without leaves"):
        write_look_layer(tmp_path / "look.usda", tmp_path / "copy", WIDE)


def test_opening_an_asset_a_look_and_a_scene(scene: Usd.Stage, oak: Path, tmp_path: Path) -> None:
    look = write_look_layer(tmp_path / "look.usda", oak, WIDE)
    for path in (oak, oak / "oak.usda", look):
        stage = open_asset(path)
        assert [str(plant.GetPath()) for plant in find_plants(stage)] == ["/oak"]
        assert stage.GetDefaultPrim().GetPath() == "/oak"
        assert (UsdGeom.GetStageMetersPerUnit(stage), UsdGeom.GetStageUpAxis(stage)) == (1, "Y")
        assert not stage.GetRootLayer().dirty or stage.GetRootLayer().anonymous
    stage = open_asset(Path(scene.GetRootLayer().realPath))
    assert [str(leaves.GetPath()) for leaves in find_leaves(stage)] == [f"{path}/{LEAVES}" for path in PLACEMENTS]
    unloaded = open_asset(oak, Usd.Stage.LoadNone)
    assert not find_leaves(unloaded)
    with pytest.raises(AssetError, match="a plant without leaves"):
        require_leaves(unloaded, oak)


@pytest.mark.parametrize(
    ("name", "content", "complaint"),
    [
        ("a.usda", b"", "cannot be read as USD"),
        ("b.usda", b"#usda 1.0\ndef Xform ", "cannot be read as USD"),
        ("c.usdc", b"PXR-USDC" + bytes(30), "cannot be read as USD"),
        ("d.usd", b"\xff\xfe no USD", "byte 0 is no UTF-8"),
        ("e.txt", b"#usda 1.0\n", "is no USD file"),
        ("f.usda", b'#usda 1.0\ndef Xform "oak" {\n}\n', "holds no plant"),
        ("g.usda", b'#usda 1.0\n(\ncustomLayerData = {\nstring usdfoliage = "x"\n}\n)\n', "holds no plant"),
        ("h.usda", b'#usda 1.0\ndef Xform "oak" (\nreferences = @./none.usda@\n) {\n}\n', "cannot be put together"),
    ],
)
def test_what_is_no_asset(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], name: str, content: bytes, complaint: str
) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(AssetError, match=complaint) as caught:
        open_asset(tmp_path / name)
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_look_whose_asset_is_missing(tmp_path: Path) -> None:
    write_oak(tmp_path / "oak", spray(2))
    look = write_look_layer(tmp_path / "look.usda", tmp_path / "oak", WIDE)
    (tmp_path / "oak").rename(tmp_path / "elm")
    with pytest.raises(AssetError, match=r"is a look of \./oak/oak\.usda, which is not there"):
        open_asset(look)
    with pytest.raises(AssetError, match="which is not there"):
        write_look_layer(tmp_path / "second.usda", look, WIDE)
    write_look_layer(look, tmp_path / "elm", WIDE)  # still one of ours, and may be replaced


def test_damaged_leaves(tmp_path: Path) -> None:
    write_oak(tmp_path / "oak", spray(50))
    crate = tmp_path / "oak" / "payload" / "leaves.usdc"
    crate.write_bytes(crate.read_bytes()[:-200])
    with pytest.raises(AssetError, match=r"leaves\.usdc"):
        open_asset(tmp_path / "oak")


def test_unknown_representation(scene: Usd.Stage, oak: Path) -> None:
    stage = open_asset(oak)
    with pytest.raises(AssetError, match=r"</oak> has no representation voxels; it has bezier, mesh"):
        select_representation(stage, "voxels")
    select_representation(stage, "mesh")
    assert stage.GetPrimAtPath(f"/oak/{LEAVES}").GetTypeName() == "Mesh"
    assert not stage.GetRootLayer().dirty
    select_representation(stage, "bezier")
    assert stage.GetPrimAtPath(f"/oak/{LEAVES}").GetTypeName() == "PointInstancer"


def test_look_is_validated_over_its_asset(oak: Path, tmp_path: Path) -> None:
    good = validate_asset(write_look_layer(tmp_path / "good.usda", oak, LeafEdits(width=1.25, jitter_amplitude=0.02)))
    assert good.selections == ("representation=bezier lod=leaves", "representation=mesh lod=leaves")
    assert not [finding for finding in good.findings if finding.validator.startswith("usdFoliage")]
    wild = LeafEdits(silhouette2=(1.5, 0.0, 0.0))
    report = validate_asset(write_look_layer(tmp_path / "wild.usda", oak, wild))
    assert report.open_errors == good.open_errors
    found = {finding.error: finding for finding in report.findings if finding.validator.endswith(":LeafShape")}
    assert set(found) == {"EditedSilhouetteOrder", "LeafFolds"}
    assert found["EditedSilhouetteOrder"].path == "/oak/geo/render/Leaves.primvars:leaf:edit:silhouette2"
    assert found["LeafFolds"].where == "representation=bezier lod=leaves"


def test_every_edit_has_an_attribute() -> None:
    assert set(EDITS) == set(LeafEdits.__dataclass_fields__)
