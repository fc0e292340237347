"""Shots: forms change at their distances, never forth and back, and what is not seen is not drawn."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as examples
from usdfoliage.forest.shots import CameraPath, ShotForm, ShotSettings, plan_shot

WINDOW = (-0.5, 0.5, -0.4, 0.4)


def path_through(eye_m, window=WINDOW, axes=None) -> CameraPath:
    """A camera that looks to -Z or as its axes are, at frames from 1001 on."""
    eye_m = np.asarray(eye_m, float)
    count = len(eye_m)
    return CameraPath(
        frame=1001.0 + np.arange(count),
        eye_m=eye_m,
        axes=np.broadcast_to(np.eye(3) if axes is None else axes, (count, 3, 3)),
        window=np.broadcast_to(np.asarray(window, float), (count, 4)),
    )


def approach(begin_m: float, end_m: float, frames: int) -> CameraPath:
    return path_through([[0, 0, z] for z in np.linspace(begin_m, end_m, frames)])


def plan(center_m, path, *, jitter=0.5, full=True, reach_m=1.0, **changes):
    center_m = np.atleast_2d(np.asarray(center_m, float))
    count = len(center_m)
    return plan_shot(
        center_m,
        np.full(count, reach_m),
        np.broadcast_to(np.asarray(jitter, float), count),
        np.full(count, full),
        path,
        ShotSettings(**changes),
    )


def test_a_plant_changes_at_its_distance():
    # It comes from 300 to 0 m in steps of 1 m: far to near below 150 less 5 %.
    shot = plan([0, 0, 0], approach(300, 0, 301), full=False)
    assert shot.first.tolist() == [ShotForm.FAR]
    assert [(each.frame, each.form.tolist()) for each in shot.switches] == [(1001.0 + 300 - 142, [ShotForm.NEAR])]
    assert shot.frames == (1001.0, 1301.0)
    back = plan([0, 0, 0], approach(0, 300, 301), full=False)
    assert [(each.frame, each.form.tolist()) for each in back.switches] == [(1001.0 + 158, [ShotForm.FAR])]


def test_a_plant_that_the_camera_comes_near_to_is_full_in_all_frames():
    # Full within a quarter to a half of 100 m, by its jitter: here 37.5 m.
    shot = plan([0, 0, 0], approach(300, 37, 264))
    assert shot.first.tolist() == [ShotForm.FULL]
    assert shot.count == 0
    assert plan([0, 0, 0], approach(300, 38, 263)).first.tolist() == [ShotForm.FAR]


def test_plants_of_other_jitter_change_elsewhere():
    jitter = np.linspace(0, 1, 101)
    shot = plan(np.zeros((101, 3)), approach(300, 60, 241), jitter=jitter)
    assert shot.count == 101
    assert max(len(each.plant) for each in shot.switches) <= 2


def test_a_camera_that_lingers_changes_nothing():
    eye_m = [[0, 0, 150 + 5 * np.sin(frame)] for frame in range(200)]
    assert plan([0, 0, 0], path_through(eye_m), hysteresis=0.05).count == 0
    assert plan([0, 0, 0], path_through(eye_m), hysteresis=0.0).count > 50


def test_a_camera_that_jumps_changes_a_plant_at_once():
    shot = plan([0, 0, 0], path_through([[0, 0, 300], [0, 0, 60], [0, 0, 300]]))
    assert [each.form.tolist() for each in shot.switches] == [[ShotForm.NEAR], [ShotForm.FAR]]


def test_the_nearest_are_full_and_no_more():
    center_m = np.column_stack([np.zeros(10), np.zeros(10), -np.arange(10.0)])
    shot = plan(center_m, path_through([[0, 0, 3]]), max_full=4)
    assert np.flatnonzero(shot.first == ShotForm.FULL).tolist() == [0, 1, 2, 3]
    assert not (plan(center_m, path_through([[0, 0, 3]]), full=False).first == ShotForm.FULL).any()


@pytest.mark.parametrize(
    ("center_m", "seen"),
    [
        ((0, 0, -10), True),
        ((0, 0, 10), False),  # behind the camera
        ((0, 0, 0.5), True),  # around it
        ((5.9, 0, -10), True),  # in the picture's edge of 5 m, by the margin of 1 m
        ((7.1, 0, -10), True),  # reaches into the margin
        ((7.2, 0, -10), False),
        ((-7.1, 0, -10), True),
        ((-7.2, 0, -10), False),
        ((0, 5.8, -10), True),
        ((0, 6.1, -10), False),
        ((0, -6.1, -10), False),
    ],
)
def test_what_is_beside_the_picture_is_not_drawn(center_m, seen):
    # The edge of the margin is at 6 m across and 4.8 m up, aslant: sqrt(1 + .6^2) and sqrt(1 + .48^2) times a radius.
    assert plan(center_m, path_through([[0, 0, 0]])).seen.tolist() == [seen]


def test_what_any_frame_sees_is_drawn():
    turn = np.array([[[1.0, 0, 0], [0, 1, 0], [0, 0, 1]], [[-1, 0, 0], [0, 1, 0], [0, 0, -1]]])
    path = path_through(np.zeros((2, 3)), axes=turn)
    assert plan([[0, 0, -10], [0, 0, 10], [50, 0, 0]], path).seen.tolist() == [True, True, False]


@examples(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1))
def test_forms_follow_from_the_switches(seed):
    rng = np.random.default_rng(seed)
    count, frames = 30, 25
    center_m = rng.uniform(-150, 150, (count, 3))
    eye_m = np.cumsum(rng.normal(0, 25, (frames, 3)), axis=0)
    jitter = rng.random(count)
    shot = plan(center_m, path_through(eye_m), jitter=jitter, max_full=5)
    for number, frame in enumerate(1001.0 + np.arange(frames)):
        forms = shot.forms_at(frame)
        away_m = np.linalg.norm(center_m - eye_m[number], axis=1)
        limit_m = 100 + 100 * jitter
        assert not ((forms == ShotForm.FAR) & (away_m < 0.95 * limit_m) & shot.seen).any()
        assert not ((forms == ShotForm.NEAR) & (away_m > 1.05 * limit_m) & shot.seen).any()
        assert (forms == ShotForm.FULL).sum() <= 5
        assert ((forms == ShotForm.FULL) == (shot.first == ShotForm.FULL)).all()
    assert all(shot.seen[each.plant].all() for each in shot.switches)
    again = plan(center_m, path_through(eye_m), jitter=jitter, max_full=5)
    assert [each.plant.tolist() for each in again.switches] == [each.plant.tolist() for each in shot.switches]


@pytest.mark.parametrize(
    ("change", "about"),
    [
        ({"lod_distance_m": (200.0, 100.0)}, "the nearer first"),
        ({"hysteresis": 1.0}, "hysteresis"),
        ({"margin": -0.1}, "margin"),
        ({"max_full": -1}, "max-full-plants"),
    ],
)
def test_settings_that_cannot_be_are_refused(change, about):
    with pytest.raises(ValueError, match=about):
        ShotSettings(**change)


def test_paths_that_cannot_be_are_refused():
    with pytest.raises(ValueError, match="needs a frame"):
        path_through(np.zeros((0, 3)))
    with pytest.raises(ValueError, match="finite"):
        path_through([[np.nan, 0, 0]])
