"""What the jobs of leaves do with numbers, without a file."""

import argparse

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.asset.leaf_representations import read_representations
from usdfoliage.cli.options.edit import parse_edits
from usdfoliage.errors import AssetError, FoliageError
from usdfoliage.jobs.edits.edit import changed_edits
from usdfoliage.jobs.edits.scatter import MAX_LEAVES, check_count, read_spray
from usdfoliage.jobs.info import measure_leaves
from usdfoliage.leaf.change import bake_leaves, move_leaves, remaining_edits
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.edits import LeafEdits, compose_edits
from usdfoliage.leaf.shape.spray import scatter_spray

small = st.floats(-0.5, 0.5)
vectors = st.tuples(small, small, small)
all_edits = st.builds(
    LeafEdits,
    width=st.floats(0.1, 3),
    axis1=vectors,
    axis2=vectors,
    silhouette1=vectors,
    silhouette2=vectors,
    silhouette3=vectors,
    curl=vectors,
    jitter_amplitude=st.floats(0, 0.1),
    jitter_frequency=st.floats(0.5, 30),
)


def spray(count: int = 5) -> Leaves:
    return scatter_spray(count, np.random.default_rng(2))


def flat_leaf(length_m: float) -> Leaves:
    """One leaf in its plane, whose silhouette of control points (±1/2, v) makes its area known."""
    parameters = np.zeros((1, 7, 3))
    parameters[0, 0] = (0, 1 / 3, 0)
    parameters[0, 1] = (0, 2 / 3, 0)
    parameters[0, 2:5] = [(0.25, 0.5, 0), (0.5, 0.5, 0), (0.75, 0.5, 0)]
    return Leaves(
        parameters=parameters,
        base_m=np.zeros((1, 3)),
        orientation=np.array([[0.0, 0.0, 0.0, 1.0]]),
        length_m=np.array([length_m]),
        phase=np.zeros(1),
    )


def test_the_area_of_a_leaf_that_is_known():
    # x(v) = (4 w³v + 6 w²v² + 4 w v³) / 2, of which the integral over v is 3/10; y is v; two halves.
    info = measure_leaves(flat_leaf(0.2))
    assert info.area_m2 == pytest.approx(2 * 0.3 * 0.2**2, rel=1e-4)
    wide = measure_leaves(flat_leaf(0.2), LeafEdits(width=3))
    assert wide.area_m2 == pytest.approx(3 * info.area_m2, rel=1e-4)
    assert wide.edits == {"width": 3}
    assert wide.parameters == info.parameters


def test_no_leaf_has_no_numbers():
    info = measure_leaves(spray(0))
    assert (info.count, info.area_m2, info.length_m, info.parameters) == (0, 0.0, None, ())


@settings(max_examples=30, deadline=None)
@given(edits=all_edits)
def test_baking_leaves_no_edit_but_the_jitter(edits):
    leaves = spray()
    baked = bake_leaves(leaves, edits)
    again = bake_leaves(baked, remaining_edits(edits))
    np.testing.assert_array_equal(again.parameters, baked.parameters)
    assert set(changed_edits(remaining_edits(edits))) <= {"jitter_amplitude", "jitter_frequency"}
    assert compose_edits(remaining_edits(edits), LeafEdits()).jitter_amplitude == edits.jitter_amplitude
    for name in ("base_m", "orientation", "length_m", "phase"):
        assert getattr(baked, name) is getattr(leaves, name)


@settings(max_examples=30, deadline=None)
@given(
    quaternion=st.tuples(small, small, small, st.floats(0.1, 1)),
    scale=st.floats(0.1, 10),
    at=st.tuples(small, small, small),
)
def test_moved_leaves_are_where_the_matrix_takes_them(quaternion, scale, at):
    leaves = spray()
    frame = Leaves(
        parameters=np.zeros((1, 7, 3)),
        base_m=np.array([at]),
        orientation=np.array([quaternion]),
        length_m=np.array([scale]),
        phase=np.zeros(1),
    ).asset_from_leaf()[0]
    matrix = np.vstack([frame, [0, 0, 0, 1]])
    moved = move_leaves(leaves, matrix)
    expected = matrix[:3, :3] @ leaves.asset_from_leaf()
    expected[:, :, 3] += at
    np.testing.assert_allclose(moved.asset_from_leaf(), expected, atol=1e-9 * scale)


@pytest.mark.parametrize("diagonal", [(1, 1, 2), (-1, 1, 1), (0, 0, 0), (1, 1, 0)])
def test_matrices_that_bend_leaves_are_refused(diagonal):
    with pytest.raises(AssetError, match="shears, mirrors or stretches"):
        move_leaves(spray(), np.diag([*diagonal, 1.0]))


def test_a_count_that_cannot_be():
    check_count(0)
    check_count(MAX_LEAVES)
    with pytest.raises(FoliageError, match=r"10,000,001 leaves would need about \d+ GiB of memory"):
        check_count(MAX_LEAVES + 1)


def test_without_variation_all_leaves_are_the_same():
    settings = read_spray(0.1, 0.0)
    assert settings.variation.amount == settings.length_variation == 0


def test_representations_are_named_once_and_in_order():
    assert read_representations(["mesh", "nurbs", "mesh"]) == ("bezier", "nurbs", "mesh")


def test_edits_that_overflow_are_no_edits():
    options = argparse.Namespace(
        width=None,
        asymmetry=(1e308, 0),
        axis1=(1e308, 0, 0),
        axis2=None,
        bend=None,
        silhouette=None,
        curl=None,
        jitter=None,
    )
    with pytest.raises(FoliageError, match="axis1 must be three finite numbers"):
        parse_edits(options)
