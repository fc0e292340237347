"""Builds by the API are those of the command."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from usdfoliage import api
from usdfoliage.__main__ import main
from usdfoliage.jobs.plant.call import StageCall
from usdfoliage.jobs.plant.store import ResultFile
from usdfoliage.jobs.plant.worker import STAGES

from tests.support.small_builds import QUICK, digests, write_small_capture


def test_a_build_has_the_bytes_of_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capture = write_small_capture(tmp_path / "shrub")
    plan = tmp_path / "quick.toml"
    plan.write_text(QUICK)
    shares: list[float] = []
    built = api.build(
        str(capture),
        str(tmp_path / "api" / "shrub"),
        settings=replace(api.read_plan(plan), seed=4),
        progress=lambda what, share: shares.append(share),
    )
    assert built.asset == tmp_path / "api" / "shrub" / "shrub.usda"
    assert built.report == tmp_path / "api" / "shrub" / "report" / "index.html"
    assert built.report.is_file()
    assert built.errors == 0
    assert built.cached == 0
    assert len(built.seconds) == built.tasks
    assert built.measures
    assert all(isinstance(remark, api.Remark) for remark in built.remarks)
    assert max(shares) == 1.0
    assert (tmp_path / "api" / ".usdfoliage" / "tasks").is_dir()

    arguments = ["build", str(capture), "-o", str(tmp_path / "cli" / "shrub"), "--plan", str(plan), "--seed", "4"]
    assert main([*arguments, "--work", str(tmp_path / "work")]) == 0
    capsys.readouterr()
    assert digests(tmp_path / "api" / "shrub") == digests(tmp_path / "cli" / "shrub")

    again = api.build(capture, tmp_path / "api" / "shrub", settings=replace(api.read_plan(plan), seed=4))
    assert again.cached == again.tasks
    assert again.remarks == built.remarks


def test_a_capture_that_cannot_be_used_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(api.FoliageError, match="empty"):
        api.build(tmp_path / "empty", tmp_path / "plant")
    assert not (tmp_path / "plant").exists()


def test_a_fault_is_no_error_of_the_user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    np.savetxt(tmp_path / "cloud.xyz", np.random.default_rng(0).uniform(size=(500, 3)))

    def fail(call: StageCall) -> tuple[ResultFile, ...]:
        raise ZeroDivisionError("planted")

    monkeypatch.setattr("usdfoliage.jobs.plant.worker.STAGES", {**STAGES, "branches": fail})
    with pytest.raises(RuntimeError, match="ZeroDivisionError: planted"):
        api.build(tmp_path / "cloud.xyz", tmp_path / "plant")


def test_arguments_that_cannot_be(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="jobs must be at least 1"):
        api.build(tmp_path, tmp_path / "plant", jobs=0)
    with pytest.raises(api.FoliageError, match=r"nothing\.toml"):
        api.read_plan(tmp_path / "nothing.toml")
    with pytest.raises(api.FoliageError, match=r"no_profile\.toml"):
        api.build(tmp_path, tmp_path / "plant", profile=tmp_path / "no_profile.toml")
