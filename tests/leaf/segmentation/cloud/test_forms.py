"""What regions look like, of shapes whose numbers are known."""

import numpy as np
import pytest
from usdfoliage.leaf.segmentation.cloud.forms import measure_regions
from usdfoliage.leaf.segmentation.cloud.merge_tree import link_points, merge_points
from usdfoliage.leaf.segmentation.cloud.working_cloud import prepare_cloud

from tests.support.leaves.scans import stem_points


def largest_region(points_m):
    """The numbers of the largest region of a cloud."""
    cloud = prepare_cloud(points_m)
    links = link_points(cloud)
    tree = merge_points(len(cloud), links, 0.7)
    forms = measure_regions(cloud, links, tree, 10)
    number = int(forms.count.argmax())
    assert forms.count[number] > 0.9 * len(points_m)
    return {name: float(getattr(forms, name)[number]) for name in forms.__dataclass_fields__}


def ellipse(points, length_m, width_m, seed=0):
    rng = np.random.default_rng(seed)
    places = rng.uniform(-0.5, 0.5, (3 * points, 2))
    places = places[np.square(places).sum(axis=1) < 0.25][:points]
    return np.column_stack([places * [length_m, width_m], rng.normal(0, 1e-4, len(places))])


def test_a_flat_ellipse():
    form = largest_region(ellipse(900, 0.1, 0.04))
    assert form["slimness"] == pytest.approx(0.4, rel=0.05)
    assert form["length_m"] == pytest.approx(0.1, rel=0.1)  # four standard deviations: the same for an ellipse
    assert form["width_m"] == pytest.approx(0.04, rel=0.1)
    assert form["area_m2"] == pytest.approx(np.pi / 4 * 0.1 * 0.04, rel=0.1)
    assert form["fill"] == pytest.approx(1, abs=0.25)
    assert form["depth"] < 0.02
    assert form["turning"] < 0.02
    assert form["open"] == pytest.approx(0, abs=0.2)
    assert form["roundness"] < 0.1


def test_a_stem_turns_all_around():
    form = largest_region(stem_points(0.3, 0.01, 4000))
    assert form["turning"] > 0.3
    assert form["slimness"] < 0.15
    assert form["depth"] > 0.5


def test_half_a_cylinder_is_as_round_as_it_is():
    rng = np.random.default_rng(0)
    turn = rng.uniform(-np.pi / 4, np.pi / 4, 1500)  # a quarter of it
    quarter = np.column_stack([0.02 * np.sin(turn), rng.uniform(-0.03, 0.03, 1500), 0.02 * np.cos(turn)])
    form = largest_region(quarter)
    # A width of 0.028 m and a radius of 0.02 m, of which the middle of the parabola shows a little less.
    assert form["roundness"] == pytest.approx(0.028 / 0.02, rel=0.2)


def test_two_blades_with_a_narrow_joint_have_a_weak_one():
    blades = np.concatenate([ellipse(500, 0.06, 0.03), ellipse(500, 0.06, 0.03, seed=1) + np.array([0.0585, 0, 0])])
    form, whole = largest_region(blades), largest_region(ellipse(1000, 0.12, 0.03))
    assert form["joint"] < 0.7 * whole["joint"]
    assert form["fill"] < 1.01 * whole["fill"]


def test_nothing_is_measured_of_too_few_points():
    cloud = prepare_cloud(ellipse(40, 0.1, 0.05))
    links = link_points(cloud)
    forms = measure_regions(cloud, links, merge_points(len(cloud), links, 0.7), 100)
    assert len(forms) == 0
    assert forms.length_m.shape == (0,)
