"""Which regions are leaves."""

from dataclasses import replace

import numpy as np
import pytest
from usdfoliage.leaf.segmentation.cloud.forms import RegionForms
from usdfoliage.leaf.segmentation.cloud.leafness import (
    MedianSize,
    choose_regions,
    list_facts,
    measure_median_size,
    rate_regions,
    read_form,
)
from usdfoliage.leaf.segmentation.cloud.merge_tree import Links, merge_points


def forms_of(node, **values):
    node = np.asarray(node)
    fields = {name: np.ones(len(node)) for name in RegionForms.__dataclass_fields__}
    fields.update({name: np.asarray(each, np.float64) for name, each in values.items()})
    return RegionForms(**{**fields, "node": node, "count": np.full(len(node), 50)})


@pytest.fixture
def tree():
    """Nodes 4 (points 0, 1) and 5 (points 2, 3), and 6 of both."""
    links = Links(first=np.array([0, 2, 1]), second=np.array([1, 3, 2]), weight=np.array([1.0, 0.9, 0.1]))
    return merge_points(4, links, 0.0)


@pytest.mark.parametrize(
    ("probability", "chosen"),
    [
        ((0.9, 0.9, 0.1), [0, 1]),
        ((0.75, 0.75, 0.95), [2]),  # the whole makes its parts improbable
        ((0.95, 0.1, 0.5), [0]),
        ((0.4, 0.3, 0.2), []),
    ],
)
def test_the_best_regions_without_a_point_in_common(tree, probability, chosen):
    assert choose_regions(forms_of([4, 5, 6]), tree, np.array(probability), 0.45).tolist() == chosen


def test_the_median_size_is_that_of_sure_regions():
    forms = forms_of([4, 5, 6, 7], length_m=[1, 2, 3, 100], width_m=[1, 1, 2, 100], area_m2=[1, 1, 1, 1])
    chosen, probability = np.arange(4), np.array([0.9, 0.9, 0.9, 0.5])
    assert measure_median_size(forms, chosen, probability) == MedianSize(length_m=2, width_m=1)
    assert measure_median_size(forms, np.zeros(0, np.int64), probability) is None


def test_half_of_the_area_is_of_smaller_leaves():
    forms = forms_of([4, 5, 6], length_m=[1, 2, 3], area_m2=[1, 1, 5])
    size = measure_median_size(forms, np.arange(3), np.full(3, 0.9))
    assert size is not None
    assert size.length_m == 3


@pytest.mark.parametrize(("name", "facts"), [("form", 11), ("form_and_size", 13)])
def test_the_weights_are_of_the_facts(name, facts):
    form = read_form(name)
    assert form.square.shape == (facts, facts)
    assert (form.spread > 0).all()
    size = None if name == "form" else MedianSize(length_m=1, width_m=1)
    assert list_facts(forms_of([4, 5]), size).shape == (2, facts)


def test_extreme_numbers_have_a_probability():
    extreme = forms_of([4], roughness=[1e30], joint=[np.inf], straightness=[-1], roundness=[0], fill=[1e9])
    assert 0 <= rate_regions(extreme, None)[0] <= 1
    size = MedianSize(length_m=1e-30, width_m=1e30)
    assert 0 <= rate_regions(replace(extreme, length_m=np.array([1e30])), size)[0] <= 1
