"""One plant of one capture, by the command line."""

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import pytest
from pxr import Usd, UsdMedia
from usdfoliage.__main__ import main
from usdfoliage.cli import build
from usdfoliage.errors import PreviewError
from usdfoliage.jobs.plant import tasks
from usdfoliage.jobs.plant.pages.pictures import DrawnComparisons
from usdfoliage.jobs.plant.stages import asset_pictures
from usdfoliage.jobs.plant.stages import report as report_stage
from usdfoliage.jobs.plant.summary import read_summary

from tests.support.leaves.captures import known_foliage
from tools.synthetic.spoiled import SMALL, SpoilSettings, spoil_capture, write_spoiled
from tools.synthetic_foliage import write_capture

# Quick and rough, and without pictures: what is tested here is the build and not how good its parts are.
FAST = """
[capture.depth]
max_side_px = 200
rounds = [{ level = 1, iterations = 3, coherent = false, segments = false },
          { level = 0, iterations = 2, coherent = true, segments = false }]
[crown]
size = 32
mesh_size = 9
[leaves]
depth = "estimated"
[pictures]
make = false
"""

SMALL_PICTURES = """
samples = 1
turntable_frames = 2
turntable_px = 64
thumbnail_px = 64
comparisons = 1
comparison_px = 96
variant_px = 64
"""

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("captures of today") / "a fern"
    write_capture(folder, known_foliage(leaves=20, views=5, size=(200, 150), up_axis="Z").capture)
    return folder


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("plans") / "fast plan.toml"
    path.write_text(FAST)
    return path


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    def run(*arguments: object) -> tuple[int, str, str]:
        code = main([str(argument) for argument in arguments])
        out, err = capsys.readouterr()
        return code, out, err

    return run


@pytest.fixture(scope="module")
def built(capture: Path, plan: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder in which assets/fern was built."""
    folder = tmp_path_factory.mktemp("built")
    assert main(["build", str(capture), "-o", str(folder / "assets" / "fern"), "--plan", str(plan)]) == 0
    return folder


def digests(folder: Path) -> dict[str, str]:
    """Of every file but the one with the times of the run."""
    return {
        path.relative_to(folder).as_posix(): sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != "timings.js"
    }


def test_a_capture_becomes_a_whole_plant(built: Path) -> None:
    asset = built / "assets" / "fern"
    stage = Usd.Stage.Open(str(asset / "fern.usda"))
    root = stage.GetDefaultPrim()
    assert root.GetVariantSets().GetNames() == ["lod", "representation", "branches"]
    assert set(root.GetVariantSet("lod").GetVariantNames()) == {"leaves", "both", "crown", "auto"}
    assert set(root.GetVariantSet("representation").GetVariantNames()) == {"bezier", "nurbs", "subdiv", "mesh"}
    leaves = stage.GetPrimAtPath("/fern/geo/render/Leaves")
    assert len(leaves.GetAttribute("positions").Get()) >= 10  # of 20
    assert set(leaves.GetAttribute("primvars:leaf:origin").Get()) <= {0, 1}  # none of the species
    stems = stage.GetPrimAtPath("/fern/geo/render/Skeleton") or stage.GetPrimAtPath("/fern/geo/guide/Skeleton")
    assert stems.IsValid()  # one twig stands bare
    root.GetVariantSet("lod").SetVariantSelection("crown")
    assert stage.GetPrimAtPath("/fern/geo/proxy/Crown").IsValid()


def test_leaves_and_crown_are_in_one_frame(built: Path) -> None:
    stage = Usd.Stage.Open(str(built / "assets" / "fern" / "fern.usda"))
    bounds = {}
    for lod in ("leaves", "crown"):
        stage.GetDefaultPrim().GetVariantSet("lod").SetVariantSelection(lod)
        box = stage.GetDefaultPrim().GetAttribute("extentsHint").Get()
        bounds[lod] = box[0], box[1]
    (low, high), (crown_low, crown_high) = bounds["leaves"], bounds["crown"]
    for axis in range(3):
        wide = high[axis] - low[axis]
        assert abs((crown_low[axis] + crown_high[axis]) - (low[axis] + high[axis])) < 0.8 * wide


def test_the_report_has_the_stages_settings_and_versions(built: Path) -> None:
    report = built / "assets" / "fern" / "report"
    page = (report / "index.html").read_text()
    assert "http://" not in page.replace("http://www.w3.org", "")
    assert "https://" not in page
    provenance = json.loads((report / "provenance.json").read_text())
    assert provenance["stages"]["crown"]["size"] == "32"
    assert {"usdfoliage", "usd-core", "numpy"} <= set(provenance["versions"])
    assert "images/000.jpg" in provenance["inputs"]
    assert str(built) not in (report / "provenance.json").read_text()
    assert "usdfoliageTimings" in (report / "timings.js").read_text()


def test_the_work_folder_is_in_nothing_that_is_published(built: Path) -> None:
    """Else the same capture built elsewhere would have other bytes."""
    for path in (built / "assets" / "fern").rglob("*"):
        if path.is_file() and path.name != "timings.js":
            assert str(built).encode() not in path.read_bytes(), path


def test_a_second_run_does_nothing_and_changes_nothing(built: Path, capture: Path, plan: Path, run: Run) -> None:
    before = digests(built / "assets" / "fern")
    code, out, _ = run("build", capture, "-o", built / "assets" / "fern", "--plan", plan)
    assert code == 0
    assert "0 done now" in out
    assert digests(built / "assets" / "fern") == before


def test_another_work_folder_gives_the_same_bytes(
    built: Path, capture: Path, plan: Path, run: Run, tmp_path: Path
) -> None:
    copy = tmp_path / "elsewhere" / capture.name
    shutil.copytree(capture, copy)
    code, _, err = run("build", copy, "-o", tmp_path / "out" / "fern", "--plan", plan, "--threads", 1)
    assert code == 0, err
    assert digests(tmp_path / "out" / "fern") == digests(built / "assets" / "fern")


def test_an_altered_result_is_found_and_made_again(
    built: Path, capture: Path, plan: Path, run: Run, tmp_path: Path
) -> None:
    shutil.copytree(built / "assets" / ".usdfoliage", tmp_path / "work")
    folder = next((tmp_path / "work" / "results").glob("*/capture/*/cloud.ply"))
    data = bytearray(folder.read_bytes())
    data[len(data) // 2] ^= 1
    folder.write_bytes(data)
    for stamp in (tmp_path / "work" / "tasks").glob("*.json"):  # so that the cloud is asked for
        if json.loads(stamp.read_text())["stamp"]["name"] in ("report", "asset", "leaves", "branches", "crown"):
            stamp.unlink()
    code, out, err = run("build", capture, "-o", tmp_path / "out" / "fern", "--plan", plan, "--work", tmp_path / "work")
    assert code == 0, err
    assert re.search(r"tasks: \d+, \d+ of them done by an earlier run, 6 done now", out), out
    assert digests(tmp_path / "out" / "fern") == digests(built / "assets" / "fern")


def test_a_dry_run_prints_the_tasks_and_writes_nothing(
    built: Path, capture: Path, plan: Path, run: Run, tmp_path: Path
) -> None:
    before = sorted(path for path in built.rglob("*"))
    code, out, _ = run("build", capture, "-o", built / "assets" / "fern", "--plan", plan, "--dry-run")
    assert code == 0
    assert re.search(r"^leaves +1 +1 +0 +0$", out, re.MULTILINE)
    assert "would replace" in out
    code, out, _ = run("build", capture, "-o", tmp_path / "new" / "fern", "--plan", plan, "--dry-run")
    assert re.search(r"^matching-1 +2 +0 +2 +\d+$", out, re.MULTILINE)
    assert re.search(r"^estimate: about \d+ ", out, re.MULTILINE)
    assert sorted(path for path in built.rglob("*")) == before
    assert not list(tmp_path.iterdir())


def test_a_dry_run_of_one_stage_is_of_that_stage(capture: Path, plan: Path, run: Run, tmp_path: Path) -> None:
    code, out, _ = run("build", capture, "-o", tmp_path / "fern", "--plan", plan, "--only", "cloud", "--dry-run")
    assert code == 0
    assert re.search(r"^cloud +1 +0 +1 ", out, re.MULTILINE)
    assert not re.search(r"^(isolation|crown|report) ", out, re.MULTILINE)
    assert f"nothing is put into {tmp_path / 'fern'}: it stops after cloud" in out


@pytest.mark.parametrize(("species", "remark"), [("mapel", "is maple meant?"), ("Zzz", "known are "), ("maple", "")])
def test_an_unknown_species_is_reported_before_anything_runs(
    capture: Path, run: Run, tmp_path: Path, species: str, remark: str
) -> None:
    code, out, _ = run("build", capture, "-o", tmp_path / "fern", "--species", species, "--dry-run")
    assert code == 0
    assert ("nothing is known of the species" in out) == bool(remark)
    assert remark in out


def test_a_profile_is_read_before_anything_runs(capture: Path, run: Run, tmp_path: Path) -> None:
    profile = tmp_path / "profile.toml"
    profile.write_text("[namming]\n")
    for given, message in ((profile, "namming is not known"), (tmp_path / "absent.toml", "absent.toml cannot be read")):
        code, _, err = run("build", capture, "-o", tmp_path / "fern", "--profile", given, "--dry-run")
        assert code == 2
        assert message in err
        assert "Errno" not in err


def test_only_a_stage_leaves_the_asset_alone(capture: Path, plan: Path, run: Run, tmp_path: Path) -> None:
    code, out, err = run("build", capture, "-o", tmp_path / "fern", "--plan", plan, "--only", "poses")
    assert code == 0, err
    assert not (tmp_path / "fern").exists()
    folder = Path(re.findall(r"^result: (.*)$", out, re.MULTILINE)[0])
    assert (folder / "capture" / capture.name / "cameras").is_dir()


@pytest.mark.parametrize("kind", ["masks inverted", "masks shifted", "good masks"])
def test_wrong_masks_are_seen_before_anything_is_matched(kind: str, run: Run, tmp_path: Path) -> None:
    scene = replace(SMALL, leaves=14, views=6, width_px=240, height_px=180)
    write_spoiled(tmp_path / "fern", spoil_capture(SpoilSettings(kind=kind, scene=scene)))
    shutil.rmtree(tmp_path / "fern" / "depth")
    code, out, err = run("build", tmp_path / "fern", "-o", tmp_path / "made", "--only", "poses")
    if kind == "masks inverted":
        assert code == 2
        assert "seem to be inverted" in err
        assert not (tmp_path / "made").exists()
    else:
        assert code == 0
        result = Path(out.partition("result: ")[2].strip())
        codes = {each.code for each in read_summary(result).remarks}
        assert ("masks-beside-plant" in codes) == (kind == "masks shifted")


def test_the_printed_plan_is_read_back_and_has_comments(run: Run, tmp_path: Path, plan: Path) -> None:
    code, out, _ = run("build", "--print-plan", "--plan", plan)
    assert code == 0
    assert "max_side_px = 200  # " in out
    (tmp_path / "again.toml").write_text(out)
    assert run("build", "--print-plan", "--plan", tmp_path / "again.toml")[1] == out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere", "-o", "fern"], "nowhere does not exist"),
        (["CAPTURE"], "-o ASSET"),
        (["CAPTURE", "-o", "fern", "--jobs", "0"], "jobs must be at least 1"),
        (["CAPTURE", "-o", "fern", "--jobs", "2", "--scheduler", "tcp://127.0.0.1:1"], "name one of them"),
        (["CAPTURE", "-o", "fern", "--plan", "absent.toml"], "absent.toml"),
        (["CAPTURE", "-o", "fern", "--seed", "-1"], "seed must be 0 or more"),
        (["PLAN", "-o", "fern"], "neither a folder nor a photograph nor a video nor a point cloud"),
    ],
)
def test_impossible_arguments_are_reported_in_one_line(
    arguments: list[str],
    message: str,
    capture: Path,
    plan: Path,
    run: Run,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    known = {"CAPTURE": str(capture), "PLAN": str(plan)}
    code, _, err = run("build", *(known.get(each, each) for each in arguments))
    assert code == 2
    assert message in err
    assert len(err.strip().splitlines()) == 1
    assert err.startswith("error: ")
    assert not (tmp_path / "fern").exists()


def test_an_unknown_setting_names_its_file(capture: Path, run: Run, tmp_path: Path) -> None:
    (tmp_path / "plan.toml").write_text("[crown]\nsizes = 12\n")
    code, _, err = run("build", capture, "-o", tmp_path / "fern", "--plan", tmp_path / "plan.toml")
    assert code == 2
    assert "crown.sizes" in err
    assert "plan.toml" in err


def test_an_asset_with_errors_is_not_put_in_its_place(
    built: Path, capture: Path, plan: Path, run: Run, tmp_path: Path
) -> None:
    profile = tmp_path / "strict.toml"
    profile.write_text('[naming]\nasset = "^oak.*"\n')
    work = built / "assets" / ".usdfoliage"
    before = digests(built / "assets" / "fern")
    strict = ("--plan", plan, "--work", work, "--profile", profile)
    code, _, err = run("build", capture, "-o", built / "assets" / "fern", *strict)
    assert code == 3
    assert "validation finds 1 error" in err
    assert digests(built / "assets" / "fern") == before
    code, _, _ = run("build", capture, "-o", tmp_path / "fern", *strict, "--keep-invalid")
    assert code == 3
    assert (tmp_path / "fern" / "fern.usda").is_file()


@pytest.mark.preview
def test_a_built_plant_has_its_pictures(capture: Path, built: Path, run: Run, tmp_path: Path) -> None:
    plan = tmp_path / "pictures.toml"
    plan.write_text(FAST.replace("make = false", SMALL_PICTURES))
    work = built / "assets" / ".usdfoliage"
    code, out, err = run("build", capture, "-o", tmp_path / "fern", "--plan", plan, "--work", work)
    assert code == 0, err
    asset = tmp_path / "fern"
    stage = Usd.Stage.Open(str(asset / "fern.usda"))
    thumbnails = UsdMedia.AssetPreviewsAPI(stage.GetDefaultPrim()).GetDefaultThumbnails()
    assert (asset / thumbnails.defaultImage.path).is_file()
    page = (asset / "report" / "index.html").read_text()
    assert page.count("data:image/") > 8
    assert "warning: " not in out


def test_pictures_that_storm_did_not_draw_are_tried_again(
    capture: Path, built: Path, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise PreviewError("Storm drew nothing in 300 s")

    plan = tmp_path / "pictures.toml"
    plan.write_text(FAST.replace("make = false", SMALL_PICTURES.replace("comparisons = 1", "comparisons = 0")))
    shutil.copytree(built / "assets" / ".usdfoliage", tmp_path / "work")
    command = ("build", capture, "-o", tmp_path / "fern", "--plan", plan, "--work", tmp_path / "work")
    with monkeypatch.context() as patch:
        for name in ("draw_turntable", "draw_variants", "draw_comparisons"):
            patch.setattr(report_stage, name, fail)
        patch.setattr(asset_pictures, "draw_asset_pictures", fail)
        code, out, err = run(*command)
    assert code == 0, err
    assert "warning: there are no pictures of the asset: Storm drew nothing" in out
    assert "preview: " not in out
    for name in ("draw_turntable", "draw_variants"):
        monkeypatch.setattr(report_stage, name, lambda *_, **__: [])
    monkeypatch.setattr(report_stage, "draw_comparisons", lambda *_, **__: DrawnComparisons())
    monkeypatch.setattr(asset_pictures, "draw_asset_pictures", lambda *_, **__: None)
    code, out, _ = run(*command)
    assert code == 0
    assert "5 done now" in out  # the asset, three kinds of pictures, the report
    assert "no pictures" not in out
    assert "0 done now" in run(*command)[1]


def test_stages_of_the_command_are_those_of_the_plan() -> None:
    assert build.STAGES == tasks.STAGES


def test_an_asset_in_place_gets_or_loses_its_times_as_asked(
    built: Path, capture: Path, plan: Path, tmp_path: Path, run: Run
) -> None:
    out = tmp_path / "fern"
    times = out / "report" / "timings.js"
    words = ("build", capture, "-o", out, "--plan", plan, "--work", built / "assets" / ".usdfoliage")
    for more, are_there in (((), True), (("--reproducible",), False), (("--reproducible",), False), ((), True)):
        assert run(*words, *more)[0] == 0
        assert times.exists() == are_there
