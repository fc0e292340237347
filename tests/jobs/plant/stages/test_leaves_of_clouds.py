"""The leaves of a build of a cloud: its own where they are enough, none of its own where they are few."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from usdfoliage.jobs.plant.settings import BuildSettings
from usdfoliage.jobs.plant.stages.models import LEAVES_MODEL
from usdfoliage.jobs.plant.stages.parts import find_leaves
from usdfoliage.jobs.plant.summary import read_summary
from usdfoliage.leaf.model_file import read_leaves_model

from tests.support.cloud_files import write_ply
from tests.support.leaves.scans import scanned_leaves


@pytest.mark.parametrize(("min_in_cloud", "kept"), [(20.0, True), (40.0, False)])
def test_a_cloud_keeps_its_own_leaves_where_they_are_enough(tmp_path, min_in_cloud, kept):
    cloud = write_ply(tmp_path / "scan.ply", scanned_leaves(27, 80)[0])
    out = tmp_path / "result"
    out.mkdir()
    defaults = BuildSettings()
    call = SimpleNamespace(
        request=SimpleNamespace(capture=cloud, name="shrub"),
        settings=replace(defaults, leaves=replace(defaults.leaves, min_in_cloud=min_in_cloud)),
        out=out,
        threads=1,
        progress=None,
        has=lambda name: False,
    )
    assert find_leaves(call) == ()
    assert (out / LEAVES_MODEL).is_file() == kept
    assert (out / "report/points.ply").is_file() == kept
    codes = {each.code for each in read_summary(out).remarks}
    assert ("cloud-leaves-few" in codes) != kept
    if kept:
        assert len(read_leaves_model(out / LEAVES_MODEL).leaves) >= 20


def test_a_cloud_in_hardly_any_places_is_named_with_what_to_do(tmp_path):
    """As one whose coordinates were rounded to metres."""
    rng = np.random.default_rng(1)
    cloud = write_ply(tmp_path / "scan.ply", np.rint(rng.random((600, 3))))
    out = tmp_path / "result"
    out.mkdir()
    call = SimpleNamespace(
        request=SimpleNamespace(capture=cloud, name="shrub"),
        settings=BuildSettings(),
        out=out,
        threads=1,
        progress=None,
        has=lambda name: False,
    )
    assert find_leaves(call) == ()
    assert not (out / LEAVES_MODEL).is_file()
    (found,) = read_summary(out).remarks
    assert found.code == "part-failed"
    assert found.severity == "warning"
    assert f"{cloud} has 8 usable points in different places" in found.text
    assert "with all digits of its coordinates" in "".join(map(str, found.remedy))


def test_a_threshold_below_none_is_refused():
    with pytest.raises(ValueError, match="min_in_cloud must be 0 or more"):
        replace(BuildSettings().leaves, min_in_cloud=-1.0)
