"""Outlines of leaves lie on edges of photographs where the leaves are right, and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.capture.view import View
from usdfoliage.leaf.photographs.outline_edges import OutlineSettings, find_edges, judge_outlines, measure_outlines

from tests.support.leaves.pictures import front_camera, photograph, place_leaves
from tests.support.leaves.shapes import flat_leaf

LENGTH_M = 0.2
LEAF = place_leaves(flat_leaf(), [(0.0, -0.1, 0.0)], length_m=LENGTH_M)
GREEN = np.array([[0.1, 0.3, 0.05]])


def seen_from(*sides_m: float) -> list[View]:
    """The leaf before a wall, photographed from these distances aside, without depth."""
    views = []
    for side_m in sides_m:
        camera = front_camera()
        moved = camera.cam_from_world.copy()
        moved[0, 3] -= side_m
        views.append(photograph(LEAF, replace(camera, cam_from_world=moved), GREEN, depth=False))
    return views


VIEWS = seen_from(-0.02, 0.02)
EDGES = find_edges(VIEWS)


def measure(leaves, photographs=VIEWS, edges=EDGES, **changed) -> float:
    cameras = [view.camera for view in photographs]
    return float(judge_outlines(measure_outlines(leaves, cameras, edges, OutlineSettings(**changed)))[0])


def test_the_outline_of_a_leaf_lies_on_edges():
    assert measure(LEAF) > 0.95


@settings(max_examples=20, deadline=None)
@given(
    angle=st.floats(0, 2 * np.pi),
    share=st.floats(0.1, 0.6),
)
def test_an_outline_beside_its_leaf_lies_on_none(angle, share):
    aside = share * LENGTH_M * np.array([[np.cos(angle), np.sin(angle), 0.0]])
    assert measure(replace(LEAF, base_m=LEAF.base_m + aside)) < 0.5 * measure(LEAF)


def test_a_leaf_of_the_wrong_size_or_depth_lies_on_none():
    assert measure(replace(LEAF, length_m=LEAF.length_m * 0.8)) < 0.3
    towards = np.array([[0.0, 0.0, 0.3]])
    assert measure(replace(LEAF, base_m=LEAF.base_m + towards)) < 0.3


def test_one_view_alone_shows_nothing():
    assert measure(LEAF, VIEWS[:1], EDGES[:1]) == 0
    assert measure(LEAF, VIEWS[:1], EDGES[:1], views=1) > 0.95


def test_nothing_is_seen_behind_cameras_beside_pictures_and_in_plain_ones():
    behind = replace(LEAF, base_m=LEAF.base_m + np.array([0.0, 0.0, 50.0]))
    beside = replace(LEAF, base_m=LEAF.base_m + np.array([40.0, 0.0, 0.0]))
    plain = [replace(view, srgb=np.full_like(view.srgb, 90)) for view in VIEWS]

    assert measure(behind) == 0
    assert measure(beside) == 0
    assert measure(LEAF, plain, find_edges(plain)) == 0
    assert measure_outlines(LEAF.take(np.zeros(0, int)), [view.camera for view in VIEWS], EDGES).shape == (0,)


def test_threads_change_nothing():
    cameras = [view.camera for view in VIEWS]
    one, two = (measure_outlines(LEAF, cameras, EDGES, threads=threads) for threads in (1, 2))
    assert (one == two).all()


@pytest.mark.parametrize("wrong", [{"ring": 0}, {"views": 0}, {"sure": 0.0}, {"min_facing": 2.0}, {"chance": np.nan}])
def test_settings_that_make_no_sense_are_refused(wrong):
    with pytest.raises(ValueError, match="must be"):
        OutlineSettings(**wrong)
