"""The sway of a rig."""

import numpy as np
import pytest
from usdfoliage.branch.motion.rig import build_rig
from usdfoliage.branch.motion.sway import SwaySettings, sway_joints

from tests.support.branch_shapes import fork, plant_of, random_tree


def sway(plant, seed=0, **settings):
    return sway_joints(build_rig(plant), plant, np.random.default_rng(seed), SwaySettings(**settings))


def test_a_loop_swings_about_the_rest_and_across_the_branches():
    turn_rad = sway(random_tree(4), frames=24)
    assert turn_rad.mean(axis=0) == pytest.approx(0, abs=1e-12)
    assert np.abs(turn_rad).max() > 0.01
    assert (turn_rad[..., 1] == 0).all()  # a branch does not turn about itself


def test_the_first_frame_follows_the_last_one():
    plant = random_tree(4)
    coarse, fine = sway(plant, frames=24), sway(plant, frames=48)
    assert fine[::2] == pytest.approx(coarse)
    steps = np.abs(np.diff(fine, axis=0, append=fine[:1]))
    assert steps[-1].max() <= 1.5 * steps[:-1].max()


def test_a_seed_decides():
    plant = random_tree(4)
    assert np.array_equal(sway(plant, seed=3), sway(plant, seed=3))
    assert not np.array_equal(sway(plant, seed=3), sway(plant, seed=4))


def test_slender_branches_swing_farther_than_thick_ones_and_than_a_trunk():
    trunk = [[0, 0, 0], [0, 1, 0], [0, 2, 0]]
    side = [[0, 1, 0], [1, 1, 0]]
    plant = plant_of((trunk, 0.1, None, 0), (side, 0.02, 0, 1), (side, 0.04, 0, 1), (side, 0.03, 0, 1))
    swing_rad = np.linalg.norm(sway(plant, frames=200), axis=2).max(axis=0)
    assert swing_rad[1] > swing_rad[3] > swing_rad[2] > swing_rad[0] > 0
    assert swing_rad[1] / swing_rad[2] == pytest.approx(2, rel=0.2)


def test_no_swing_is_no_turn():
    assert (sway(fork(), swing_rad=0.0) == 0).all()


@pytest.mark.parametrize("bad", [{"frames": 1}, {"swing_rad": -1.0}, {"trunk_share": 2.0}, {"cycles": 9}])
def test_settings_that_cannot_be_are_refused(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        SwaySettings(**bad)
