"""A plant that is ready remains, whatever its variations come to."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
from usdfoliage.errors import FitError, WriteError
from usdfoliage.jobs.plant.settings import BuildSettings
from usdfoliage.jobs.plant.stages import parts
from usdfoliage.jobs.plant.stages.models import read_plant_branches, read_variation
from usdfoliage.jobs.plant.summary import read_summary

from tests.support.branch_clouds import cloud_of, y_fork
from tests.support.cloud_files import write_ply


def test_a_variation_that_cannot_be_made_is_a_warning(tmp_path, monkeypatch):
    vary, error = parts.vary_plant, FitError("no branch grew", "give other roots")

    def vary_but_the_first(request, found, number):
        if number == 1:
            raise error
        variation, made = vary(request, found, number)
        return replace(variation, reached=0.93), made

    monkeypatch.setattr(parts, "vary_plant", vary_but_the_first)
    cloud = write_ply(tmp_path / "tree.ply", cloud_of(y_fork(), per_m2=3000))
    settings = BuildSettings()
    call = SimpleNamespace(
        request=SimpleNamespace(name="tree", capture=cloud),
        settings=replace(settings, branches=replace(settings.branches, variations=2)),
        out=tmp_path / "result",
        progress=None,
        has=lambda name: False,
    )
    call.out.mkdir()
    assert parts.trace_branches(call) == ()
    plant, missing, made = (
        read_plant_branches(call.out),
        read_variation(call.out, 1),
        read_variation(call.out, 2),
    )
    assert plant is not None
    assert missing is None
    assert made is not None
    assert plant.skeleton.growth["allometryExponent"] == made.skeleton.growth["allometryExponent"] > 0
    (failed,) = [each for each in read_summary(call.out).remarks if each.code == "variation-failed"]
    assert failed.severity == "warning"
    assert failed.text == "variation 1 is left out: no branch grew"
    assert "give other roots" in str(failed.remedy)
    (short,) = [each for each in read_summary(call.out).remarks if each.code == "variations-incomplete"]
    assert "1 of 1 variations" in short.text
    assert "93.0 % (number 2)" in short.text
    assert "similarity of variations, S_T" in {row.name for row in read_summary(call.out).rows}

    error = WriteError("the disk is full")
    call.out = tmp_path / "other"
    call.out.mkdir()
    with pytest.raises(WriteError, match="disk is full"):
        parts.trace_branches(call)
