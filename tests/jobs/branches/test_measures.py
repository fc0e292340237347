"""Branches in numbers, of a skeleton whose numbers are known."""

import numpy as np
import pytest
from usdfoliage.branch.model import Skeleton
from usdfoliage.jobs.branches.measures import branch_rows, measure_branches
from usdfoliage.jobs.info import describe_asset, format_info

from tests.support.branch_shapes import fork
from tests.support.plant_assets import write_whole_plant


def test_a_fork_is_measured():
    info = measure_branches(fork())
    assert (info.count, info.by_order) == (3, (1, 1, 1))
    assert info.height_m == pytest.approx(2)
    assert info.length_m == pytest.approx(2 + 1 + 0.5**0.5)
    assert info.root_diameter_m == pytest.approx(0.1)


def test_the_diameter_at_breast_height_lies_between_nodes():
    trunk = Skeleton(
        points_m=np.array([[0, 5.0, 0], [0, 6, 0], [0, 8, 0]]),
        radius_m=np.array([0.2, 0.1, 0.05]),
        counts=np.array([3], np.int32),
        parent_curve=np.array([-1], np.int32),
        parent_vertex=np.array([-1], np.int32),
        order=np.array([0], np.int32),
    )
    info = measure_branches(trunk)
    assert info.breast_height_diameter_m == pytest.approx(2 * (0.1 - 0.05 * 0.15))
    assert info.height_m == pytest.approx(3)
    assert dict(branch_rows(info))["diameter"] == "root 40 cm, 18.5 cm at 1.3 m"


def test_a_bush_has_no_diameter_at_breast_height():
    trunk = Skeleton(
        points_m=np.array([[0, 0.0, 0], [0, 1, 0]]),
        radius_m=np.array([0.02, 0.01]),
        counts=np.array([2], np.int32),
        parent_curve=np.array([-1], np.int32),
        parent_vertex=np.array([-1], np.int32),
        order=np.array([0], np.int32),
    )
    assert measure_branches(trunk).breast_height_diameter_m is None
    assert dict(branch_rows(measure_branches(trunk)))["diameter"] == "root 4 cm"


def test_a_whole_plant_is_described_whichever_lod_is_selected(tmp_path):
    interface = write_whole_plant(tmp_path / "oak")
    for lod in ("leaves", "crown", "auto"):
        text = interface.read_text().replace('string lod = "leaves"', f'string lod = "{lod}"')
        chosen = tmp_path / "oak" / "oak.usda"
        chosen.write_text(text)
        info = describe_asset(chosen)
        chosen.write_text(text.replace(f'string lod = "{lod}"', 'string lod = "leaves"'))
        assert info.leaves is not None
        assert info.leaves.count == 6
        assert info.branches is not None
        assert info.branches.count == 3
        assert info.crown is not None
        assert info.crown.radius_map_px == 8
        assert info.variants["lod"] == ("auto", "both", "crown", "leaves")
    assert "3 (1 of order 0, 1 of order 1, 1 of order 2)" in format_info(describe_asset(interface))
