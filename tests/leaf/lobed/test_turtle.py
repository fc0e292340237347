"""Ties as steps of a turtle, and back."""

from dataclasses import replace

import numpy as np
import pytest
from usdfoliage.leaf.lobed.turtle import TurtleTies, ties_from_turtle, ties_to_turtle

from tests.support.leaves.lobed import lobed_shape


@pytest.mark.parametrize("angles_deg", [(90,), (30, 150), (-20, 35, 90, 145, 200), (0, 60, 120, 180)])
def test_there_and_back(angles_deg):
    shape = lobed_shape(angles_deg)
    turtle = ties_to_turtle(shape)
    stored = TurtleTies(
        branches=turtle.branches,
        k_length=turtle.k_length.astype(np.float32).astype(np.float64),
        k_turn_rad=np.radians(np.degrees(turtle.k_turn_rad).astype(np.float32).astype(np.float64)),
        t_length=turtle.t_length.astype(np.float32).astype(np.float64),
        t_turn_rad=np.radians(np.degrees(turtle.t_turn_rad).astype(np.float32).astype(np.float64)),
    )
    width = np.ptp(shape.places[:, 0])
    for given, bound in ((turtle, 1e-12), (stored, 1e-5)):
        begins, ends = ties_from_turtle(shape.nodes, shape.parents, shape.branches, given)
        assert np.abs(begins - shape.nodes[shape.tie_nodes]).max() <= bound * width
        assert np.abs(ends - shape.feet).max() <= bound * width


def test_equations_2_and_3():
    """The steps of consecutive ties of one branch as the paper has them, whose angles are clockwise."""
    shape = lobed_shape((90,))
    turtle = ties_to_turtle(shape)
    up, heading = np.array([0.0, 0, 1]), np.array([0.0, 1, 0])
    before = shape.nodes[0]
    for tie in range(len(shape.feet)):
        at = shape.nodes[shape.tie_nodes[tie]]
        step = np.append(at - before, 0.0)
        if tie == 0:
            angle = -turtle.k_turn_rad[0]  # without a step: the direction of the next one
        elif np.linalg.norm(step) == 0:
            angle = 0.0
        else:
            unit = step / np.linalg.norm(step)
            angle = np.sign(up @ np.cross(step, heading)) * np.arccos(np.clip(heading @ unit, -1, 1))
        assert turtle.k_length[tie] == pytest.approx(np.linalg.norm(step))
        assert -turtle.k_turn_rad[tie] == pytest.approx(angle, abs=1e-6)
        c, s = np.cos(turtle.k_turn_rad[tie]), np.sin(turtle.k_turn_rad[tie])
        heading = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ heading
        tied = np.append(shape.feet[tie] - at, 0.0)
        unit = tied / np.linalg.norm(tied)
        angle = np.sign(up @ np.cross(tied, heading)) * np.arccos(np.clip(heading @ unit, -1, 1))
        assert turtle.t_length[tie] == pytest.approx(np.linalg.norm(tied))
        assert -turtle.t_turn_rad[tie] == pytest.approx(angle, abs=1e-6)
        before = at


def test_a_node_without_a_tie_is_refused():
    shape = lobed_shape((90,))
    lost = replace(shape, tie_nodes=np.where(shape.tie_nodes == 3, 2, shape.tie_nodes))
    with pytest.raises(ValueError, match="needs a tie"):
        ties_to_turtle(lost)
