"""The native leaf functions themselves: what the package's own functions never let through, or cannot see."""

import numpy as np
import pytest
from usdfoliage import _native
from usdfoliage.leaf.shape.jitter import WAVES

from tests.support.leaves.reference import evaluate_points
from tests.support.leaves.shapes import random_leaves

LEAVES = random_leaves(3, seed=1)
PLACES = np.random.default_rng(2).uniform(0, 1, (1, 7, 2))


def fill(points, threads=1, tangents=None):
    _native.leaf_samples(
        LEAVES,
        PLACES,
        shared=True,
        jitter=_native.LeafJitter(amplitude=0.0, frequency=8.0, waves=np.array(WAVES)),
        placements=None,
        points=points,
        tangents_u=tangents,
        tangents_v=None,
        normals=None,
        areas=None,
        threads=threads,
    )
    return points


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_outputs_are_filled_in_place(dtype):
    points = fill(np.full((3, 7, 3), np.nan, dtype))

    assert points == pytest.approx(evaluate_points(LEAVES, PLACES[0]), rel=1e-6, abs=1e-6)


def test_float32_is_the_rounded_float64():
    assert np.array_equal(fill(np.empty((3, 7, 3), np.float32)), fill(np.empty((3, 7, 3))).astype(np.float32))


def test_an_output_that_cannot_be_written_in_place_is_refused():
    locked = np.empty((3, 7, 3))
    locked.flags.writeable = False
    for points in (np.empty((3, 7, 3), np.float16), np.empty((3, 7, 6))[..., ::2], locked):
        with pytest.raises(TypeError):
            fill(points)


def test_outputs_of_two_types_are_refused():
    with pytest.raises(TypeError):
        fill(np.empty((3, 7, 3)), tangents=np.empty((3, 7, 3), np.float32))


def test_more_threads_than_leaves():
    assert np.array_equal(fill(np.empty((3, 7, 3)), threads=64), fill(np.empty((3, 7, 3))))
