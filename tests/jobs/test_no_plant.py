"""Clouds of houses and hedges end in one line and exit code 2, and nothing is written, unless the user knows better."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from usdfoliage.__main__ import build_parser, main
from usdfoliage.branch.tracing.roots import RootSettings
from usdfoliage.cli.options.branches import read_branches_request
from usdfoliage.jobs.branches.tracing import NoStemsError
from usdfoliage.jobs.no_plant import NoPlantError, check_traced
from usdfoliage.jobs.plant.settings import BuildSettings
from usdfoliage.jobs.plant.stages import parts
from usdfoliage.jobs.plant.summary import read_summary
from usdfoliage.jobs.plant_cloud import PlantCloudRequest, read_plant_cloud

from tests.support.branch_clouds import block, gabled_house, rectangle
from tests.support.cloud_files import write_ply

CLOUDS = {
    "building": (gabled_house, "6 large planes"),
    "hedge": (lambda: block((6, 1.5, 0.8), 12_000), "5.9 m long, 0.78 m wide and 1.5 m high"),
    "wall": (
        lambda: rectangle((0, 0, 0), (10, 0, 0), (0, 5, 0), 200, 0.02, 0),
        "100 % of its points lie on",
    ),
    "ground": (lambda: rectangle((0, 0, 0), (10, 0, 0), (0, 0, 10), 100, 0.02, 0), "lie on level planes"),
}


@pytest.mark.parametrize("name", CLOUDS)
def test_what_is_no_plant_is_one_line_with_figures_and_what_to_do(tmp_path, capsys, name):
    make, figures = CLOUDS[name]
    cloud = write_ply(tmp_path / f"{name}.ply", make())
    for words in ([], ["--dry-run"]):
        assert main(["branches", str(cloud), "-o", str(tmp_path / "out"), "--up", "Y", "--no-preview", *words]) == 2
        (line,) = capsys.readouterr().err.strip().splitlines()
        assert line.startswith(f"error: {cloud} looks like ")
        assert name in line
        assert figures in line
        assert "--any-cloud" in line
        assert "branches.make" not in line
    assert [each.name for each in tmp_path.iterdir()] == [cloud.name]


def shrubs():
    """(N, 3) points of six round shrubs in a row, Y up, each on a thin stem."""
    rng = np.random.default_rng(5)
    middle_m = np.arange(6)[:, None] * [1.0, 0, 0] + [0, 0.9, 0]
    out = rng.normal(size=(36_000, 3))
    out *= 0.7 * rng.uniform(0.7, 1, (36_000, 1)) / np.linalg.norm(out, axis=1)[:, None]
    stems_m = middle_m[rng.integers(0, 6, 1200)] * [1, 0, 1] + rng.normal(0, 0.02, (1200, 3)) * [1, 0, 1]
    stems_m[:, 1] = rng.uniform(0, 0.4, 1200)
    return np.concatenate([middle_m[rng.integers(0, 6, 36_000)] + out, stems_m])


def test_a_row_of_shrubs_without_stem_or_branches_that_join_is_refused_too(tmp_path, capsys):
    cloud = write_ply(tmp_path / "shrubs.ply", shrubs())
    words = ["branches", str(cloud), "-o", str(tmp_path / "out"), "--up", "Y", "--no-preview"]
    assert main(words) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert line.startswith(f"error: {cloud} shows no tree: no stem is seen at a root")
    assert "--any-cloud" in line
    assert [each.name for each in tmp_path.iterdir()] == [cloud.name]
    assert main([*words, "--any-cloud"]) == 0


def test_a_stem_few_branches_or_branches_that_join_are_a_tree(tmp_path):
    for branches, unjoined, stem_seen in ((100, 90, True), (19, 19, False), (100, 59, False)):
        check_traced(branches, unjoined, stem_seen, tmp_path)
    with pytest.raises(NoPlantError, match="60 % of the branches"):
        check_traced(100, 60, False, tmp_path)


def test_a_user_who_knows_better_has_any_cloud_traced(tmp_path):
    cloud = write_ply(tmp_path / "hedge.ply", block((6, 1.5, 0.8), 12_000))
    words = ["branches", str(cloud), "-o", str(tmp_path / "out"), "--up", "Y"]
    accepted = read_branches_request(build_parser().parse_args([*words, "--any-cloud"])).cloud
    assert len(read_plant_cloud(accepted).points_m) > 10_000
    rooted = read_branches_request(build_parser().parse_args([*words, "--roots", "3,0,0.4"])).cloud
    assert rooted.must_be_plant
    assert len(read_plant_cloud(rooted).points_m) > 10_000
    with pytest.raises(NoPlantError):
        read_plant_cloud(read_branches_request(build_parser().parse_args(words)).cloud)


def test_a_build_of_a_cloud_alone_refuses_it_and_names_its_setting(tmp_path, monkeypatch):
    cloud = write_ply(tmp_path / "hedge.ply", block((6, 1.5, 0.8), 12_000))
    asked = []

    def find_branches(request, *others):
        asked.append(request.cloud.must_be_plant)
        read_plant_cloud(replace(request.cloud, must_be_plant=True, path=cloud, roots=RootSettings(), up="Y"))

    monkeypatch.setattr(parts, "find_branches", find_branches)
    monkeypatch.setattr(parts, "is_floorless", lambda call: False)
    monkeypatch.setattr(parts, "plant_capture", lambda call: tmp_path)
    for make, photographs in (("auto", False), ("on", False), ("auto", True)):
        call = SimpleNamespace(
            request=SimpleNamespace(name="hedge", capture=cloud),
            settings=replace(BuildSettings(), branches=replace(BuildSettings().branches, make=make)),
            out=tmp_path,
            progress=None,
            has=lambda name, photographs=photographs: photographs and name == parts.CLOUD,
        )
        with pytest.raises(NoPlantError) as error:
            parts.trace_branches(call)
        assert 'branches.make = "on"' in str(error.value)
    assert asked == [True, False, False]


@pytest.mark.parametrize("photographs", [False, True])
def test_a_build_of_a_scan_alone_traces_it_as_branches_does(tmp_path, monkeypatch, photographs):
    asked = []

    def find_branches(request, *others):
        asked.append(request.needs_stems)
        raise NoStemsError("a hedge")

    monkeypatch.setattr(parts, "find_branches", find_branches)
    monkeypatch.setattr(parts, "is_floorless", lambda call: False)
    monkeypatch.setattr(parts, "plant_capture", lambda call: tmp_path)
    call = SimpleNamespace(
        request=SimpleNamespace(name="crown", capture=tmp_path / "crown.ply"),
        settings=BuildSettings(),
        out=tmp_path,
        progress=None,
        has=lambda name: photographs and name == parts.CLOUD,
    )
    assert parts.trace_branches(call) == ()
    assert asked == [photographs]
    (left_out,) = read_summary(tmp_path).remarks
    assert left_out.code == "branches-left-out"


def test_other_commands_take_any_cloud(tmp_path):
    cloud = write_ply(tmp_path / "house.ply", gabled_house())
    assert len(read_plant_cloud(PlantCloudRequest(path=cloud, roots=RootSettings(), up="Y")).points_m) > 5000
