"""Lobed leaves in space: what the native code makes of them, against a turtle in numpy, and what must hold always."""

import functools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.leaf.lobed.branches import LobedShape
from usdfoliage.leaf.lobed.deformation import (
    FLAT,
    BranchFunctions,
    add_evenly,
    bend_evenly,
    deform_leaves,
    rotations_of,
)
from usdfoliage.leaf.lobed.turtle import ties_to_turtle

from tests.support.leaves.lobed import lobed_shape

ANGLES_DEG = ((90,), (30, 150), (-20, 35, 90, 145, 200), (0, 60, 120, 180), (10, 90, 170))


@functools.cache
def shape_of(number: int) -> LobedShape:
    return lobed_shape(ANGLES_DEG[number])


def rotation(axis: np.ndarray, angle: float) -> np.ndarray:
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def turned(keys: np.ndarray, begin: float, end: float) -> float:
    """By how much a function rotates from one position to another, by the trapezoid rule between its keys."""
    if not len(keys):
        return 0.0
    at = np.unique(np.concatenate([[begin, end], keys[(keys[:, 0] > begin) & (keys[:, 0] < end), 0]]))
    return float(np.trapezoid(np.interp(at, keys[:, 0], keys[:, 1]), at))


def walked(shape: LobedShape, functions: BranchFunctions) -> tuple[np.ndarray, np.ndarray]:
    """(N + T, 3) the leaf as a turtle with heading, left and up walks it, by the steps that an asset has of it.

    And (N, 3, 3) these directions at the nodes, as columns.
    """
    turtle, spans, none = ties_to_turtle(shape), shape.spans(), np.zeros((0, 2))
    frames, nodes = np.zeros((len(shape.nodes), 3, 3)), np.zeros((len(shape.nodes), 3))
    feet = np.zeros((len(shape.feet), 3))
    reached = -1
    for tie, node in enumerate(shape.tie_nodes.tolist()):
        if node != reached:
            parent = max(int(shape.parents[node]), 0)
            own = [
                lists[shape.branches[node]] if len(lists) else none
                for lists in (functions.turn, functions.bend, functions.twist)
            ]
            frame = frames[parent] if node else np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])  # columns H, L, U
            place = nodes[parent] if node else np.append(shape.nodes[0], 0.0)
            frame = frame @ rotation(np.array([0.0, 0, 1]), turtle.k_turn_rad[tie])
            middle = spans[node].mean()
            for part, (begin, end) in enumerate(((spans[node, 0], middle), (middle, spans[node, 1]))):
                turn, bend, twist = (turned(keys, begin, end) for keys in own)
                vector = np.array([twist, bend, turn])
                size = np.linalg.norm(vector)
                if size:
                    frame = frame @ rotation(vector / size, size)
                if part == 0:
                    place = place + turtle.k_length[tie] * frame[:, 0]
            frames[node], nodes[node] = frame, place
            reached = node
        along = rotation(np.array([0.0, 0, 1]), turtle.t_turn_rad[tie])[:, 0]
        feet[tie] = nodes[node] + turtle.t_length[tie] * frames[node] @ along
    return np.concatenate([nodes, feet]), frames


def sides(shape: LobedShape, points: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """(T,) above 0 for faces that have kept their side: their normals are up where their nodes are."""
    corners = points[shape.faces]
    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    up = frames[shape.faces[:, 0], :, 2] + frames[shape.faces[:, 3], :, 2]
    return np.einsum("ij,ij->i", normal, up)


@st.composite
def functions_of(draw: st.DrawFn, branches: int) -> BranchFunctions:
    def lists(limit_deg: float) -> tuple[np.ndarray, ...]:
        found = []
        for _ in range(branches):
            positions = sorted(draw(st.sets(st.integers(0, 20), max_size=4)))
            rates = [draw(st.floats(-limit_deg, limit_deg)) for _ in positions]
            found.append(np.column_stack([np.array(positions) / 20, np.radians(rates)]).reshape(-1, 2))
        return tuple(found)

    return BranchFunctions(turn=lists(30), bend=lists(60), twist=lists(45))


@settings(max_examples=25, deadline=None)
@given(number=st.integers(0, len(ANGLES_DEG) - 1), data=st.data())
def test_native_code_and_the_turtle_agree(number, data):
    shape = shape_of(number)
    functions = data.draw(functions_of(shape.branch_count))
    width = np.ptp(shape.places[:, 0])
    points = deform_leaves(shape, [functions])[0]
    expected, _ = walked(shape, functions)
    assert np.abs(points - expected).max() < 1e-9 * width
    # Every branch begins where the one that it leaves has its fork: the step to its first node is as long as before.
    step = np.linalg.norm(points[1 : len(shape.nodes)] - points[shape.parents[1:]], axis=1)
    flat = np.linalg.norm(shape.nodes[1:] - shape.nodes[shape.parents[1:]], axis=1)
    assert np.abs(step - flat).max() < 1e-6 * width
    tie = np.linalg.norm(points[len(shape.nodes) :] - points[shape.tie_nodes], axis=1)
    assert np.abs(tie - np.linalg.norm(shape.feet - shape.nodes[shape.tie_nodes], axis=1)).max() < 1e-6 * width


@settings(max_examples=25, deadline=None)
@given(
    number=st.integers(0, len(ANGLES_DEG) - 1),
    data=st.data(),
)
def test_no_face_is_flipped_at_angles_that_an_artist_uses(number, data):
    """Bends to 60 degrees and twists to 45, each lobe by its own."""
    shape = shape_of(number)
    none = np.zeros((0, 2))
    angles = st.lists(st.floats(-1, 1), min_size=shape.branch_count, max_size=shape.branch_count)
    bend, twist = (
        tuple(np.array([[0.0, limit * part]]) if part else none for part in data.draw(angles))
        for limit in (np.radians(60), np.radians(45))
    )
    functions = BranchFunctions(bend=bend, twist=twist)
    _, frames = walked(shape, functions)
    assert (sides(shape, deform_leaves(shape, [functions])[0], frames) > 0).all()


@pytest.mark.parametrize("number", range(len(ANGLES_DEG)))
def test_without_functions_the_leaf_is_flat_exactly(number):
    shape = shape_of(number)
    still = BranchFunctions(bend=tuple(np.array([[0.5, 0.0]]) for _ in range(shape.branch_count)))
    for points in deform_leaves(shape, [FLAT, still]):
        assert np.array_equal(points[:, :2], shape.places)
        assert not points[:, 2].any()


def test_a_bend_goes_down_and_a_turn_to_the_left():
    shape = shape_of(0)
    tip = np.flatnonzero(shape.branches == 0)[-1]
    bent, left = deform_leaves(shape, [bend_evenly(1, bend_rad=0.5), bend_evenly(1, turn_rad=0.5)])
    assert bent[tip, 2] < -10
    assert left[tip, 0] < shape.nodes[tip, 0] - 10
    assert not left[:, 2].any()


def test_a_branch_that_is_bent_moves_no_other():
    shape = shape_of(2)
    points = deform_leaves(shape, [bend_evenly(shape.branch_count, bend_rad=1.0, only=3)])[0]
    moved = np.abs(points[: len(shape.nodes), 2]) > 0
    assert set(shape.branches[moved].tolist()) == {3}


def test_rotations_add_up():
    shape = shape_of(2)
    branches = shape.branch_count
    first = bend_evenly(branches, bend_rad=0.4, twist_rad=-0.2)
    second = add_evenly(first, branches, bend_rad=0.3, turn_rad=0.1, only=2)
    expected = np.zeros((3, branches))
    expected[1], expected[2] = 0.4, -0.2
    expected[0, 2], expected[1, 2] = 0.1, 0.7
    assert rotations_of(second, branches) == pytest.approx(expected)
    ramp = BranchFunctions(bend=(np.array([[0.2, 0.0], [0.6, 1.0]]),))
    assert rotations_of(ramp, 1)[1, 0] == pytest.approx(0.2 + 0.4)
    with pytest.raises(ValueError, match="branch must be 0 to 4"):
        add_evenly(FLAT, branches, bend_rad=0.1, only=5)


def test_threads_change_nothing():
    shape = shape_of(3)
    many = [bend_evenly(shape.branch_count, bend_rad=0.01 * leaf, twist_rad=0.02 * leaf) for leaf in range(40)]
    one, two = (deform_leaves(shape, many, threads=threads) for threads in (1, 2))
    assert np.array_equal(one, two)
    assert np.array_equal(one[7], deform_leaves(shape, [many[7]])[0])


def test_functions_of_other_branches_are_refused():
    with pytest.raises(ValueError, match="lists of 2 branches"):
        deform_leaves(shape_of(0), [BranchFunctions(bend=(np.zeros((0, 2)),) * 2)])
    for keys in (np.array([[0.5, 0.0], [0.2, 0.0]]), np.array([[-0.1, 0.0]]), np.array([[0.1, np.nan]]), np.zeros(3)):
        with pytest.raises(ValueError, match="bend"):
            BranchFunctions(bend=(keys,))
