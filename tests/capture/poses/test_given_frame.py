"""Up and unit of given poses whose true world is known."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from usdfoliage.capture.folder.read import Capture, CaptureView, read_capture
from usdfoliage.capture.folder.settings import CaptureSettings
from usdfoliage.capture.lens import Lens
from usdfoliage.capture.poses.given_frame import find_given_frame, read_upright_capture, snap_to_axis
from usdfoliage.capture.poses.up_direction import UpDirection
from usdfoliage.geometry.up_turn import AXES, axis_vector, turn_to_y_up

from tests.support.captures import look_at, sphere_depth, write_depth, write_photo, write_text_model

LENS = Lens(model="PINHOLE", width_px=64, height_px=48, parameters=(80.0, 80.0, 32.0, 24.0))
NO_FILE = Path("no file")
CODES = ("up-estimated", "up-uncertain", "up-methods-disagree", "scale-estimated", "scale-unknown")


def ring(count=12, height=1.5, radius=2.0, roll_deg=0.0):
    """(N, 3, 4), poses around (0, 0.7, 0) in metres, Y up."""
    roll = Rotation.from_euler("z", roll_deg, degrees=True).as_matrix()
    turns = np.arange(count) / count * 2 * math.pi
    places = [(radius * math.sin(turn), height, radius * math.cos(turn)) for turn in turns]
    return np.array([roll @ look_at(place, (0, 0.7, 0)) for place in places])


def bush_and_soil(seed=0):
    rng = np.random.default_rng(seed)
    soil = np.column_stack([rng.uniform(-1.5, 1.5, 300), rng.normal(0, 0.003, 300), rng.uniform(-1.5, 1.5, 300)])
    return np.concatenate([rng.normal((0, 0.8, 0), 0.25, (300, 3)), soil])


def capture_of(poses, points=np.zeros((0, 3)), turn=np.eye(3), scale=1.0, move=(0, 0, 0)):
    """The poses and points in another frame: x_in_frame = scale * turn @ x + move."""
    views = []
    for number, pose in enumerate(poses):
        rotation = pose[:, :3] @ turn.T
        translation = scale * pose[:, 3] - rotation @ np.asarray(move, float)
        views.append(
            CaptureView(
                name=f"{number:02}.png",
                photo=NO_FILE,
                lens=LENS,
                cam_from_world=np.column_stack([rotation, translation]),
                depth=None,
                mask=None,
            )
        )
    return Capture(
        folder=NO_FILE,
        name="bush",
        settings=CaptureSettings(),
        views=tuple(views),
        points_m=scale * points @ turn.T + move,
        remarks=(),
    )


def apart_deg(first, second):
    return math.degrees(math.acos(float(np.clip(np.dot(first, second), -1, 1))))


TURN = Rotation.from_rotvec((0.7, -1.2, 0.4)).as_matrix()


@settings(max_examples=25)
@given(x=st.floats(-3, 3), y=st.floats(-3, 3), z=st.floats(-3, 3), scale=st.floats(0.05, 50))
def test_up_turns_with_the_frame(x, y, z, scale):
    turn = Rotation.from_rotvec((x, y, z)).as_matrix()
    facts, _, _ = find_given_frame(capture_of(ring(), bush_and_soil(), turn, scale, (5, -3, 11)), 1.0)
    straight, _, _ = find_given_frame(capture_of(ring(), bush_and_soil(), TURN), 1.0)
    assert apart_deg(facts.up, turn @ (0, 1, 0)) < 4  # as far as it may be snapped to an axis of the frame
    assert facts.up_from == straight.up_from
    assert facts.up_error_rad == pytest.approx(straight.up_error_rad, abs=1e-6)


@pytest.mark.parametrize("name", AXES)
def test_a_frame_that_is_laid_stays_where_it_is(name):
    turn = turn_to_y_up(axis_vector(name)).T
    lean = Rotation.from_rotvec((math.radians(1), 0, math.radians(-1.5))).as_matrix()
    facts, stated, remarks = find_given_frame(capture_of(ring(), bush_and_soil(), turn @ lean), None)
    np.testing.assert_array_equal(facts.up, axis_vector(name))
    assert (stated.up_axis, stated.up_vector) == (name.removeprefix("+"), None)
    if name in ("+Y", "+Z"):  # nobody lays a frame in metres with another axis up
        assert (stated.metres_per_unit, facts.scale_from) == (1, "the frame")
        assert [each.code for each in remarks] == ["up-estimated", "scale-estimated"]
    else:
        assert facts.scale_from == "nothing"
        assert [each.code for each in remarks] == ["up-estimated", "scale-unknown"]


def test_an_arbitrary_frame_has_a_vector_and_no_unit():
    facts, stated, remarks = find_given_frame(capture_of(ring(), bush_and_soil(), TURN, 3.7, (5, -3, 11)), None)
    assert apart_deg(facts.up, TURN @ (0, 1, 0)) < 0.1
    assert stated.up_vector == facts.up
    capture = capture_of(ring(), bush_and_soil(), TURN, 3.7)
    assert [each.code for each in remarks] == ["up-estimated", "scale-unknown"]
    assert f"({facts.up[0]:.3f}, {facts.up[1]:.3f}, {facts.up[2]:.3f})" in remarks[0].text
    assert f"to {math.degrees(facts.up_error_rad):.1f}°" in remarks[0].text
    # The median distance to what is seen becomes a metre.
    depths = [view.lens.pinhole(view.cam_from_world).project(capture.points_m)[1] for view in capture.views]
    assert 1 / facts.metres_per_unit == pytest.approx(np.median(depths), rel=0.1)


@pytest.mark.parametrize("roll_deg", [0, 45, 90, 180, 270])
@pytest.mark.parametrize("ground", [True, False])
def test_a_robots_camera_may_be_turned_about_its_axis(roll_deg, ground):
    points = bush_and_soil() if ground else bush_and_soil()[:300]
    facts, _, _ = find_given_frame(capture_of(ring(roll_deg=roll_deg), points, TURN), None)
    error_deg = apart_deg(facts.up, TURN @ (0, 1, 0))
    if roll_deg == 180 and not ground:
        assert error_deg > 179  # nothing shows that the pictures stand on their heads
    else:
        assert error_deg < 1


def test_an_upright_ring_below_a_ceiling_stays_upright():
    """Cameras that look up a little at a plant, and see the ceiling and not the floor."""
    points = bush_and_soil()[:300]
    ceiling = bush_and_soil()[300:] + np.array([0, 3.0, 0])
    facts, _, _ = find_given_frame(capture_of(ring(height=0.6), np.concatenate([points, ceiling]), TURN), None)
    assert apart_deg(facts.up, TURN @ (0, 1, 0)) < 1


def test_weak_evidence_only_chooses_among_axes():
    tilted = np.array([0, math.cos(math.radians(25)), math.sin(math.radians(25))])
    np.testing.assert_array_equal(snap_to_axis(UpDirection("photographs", tilted, math.radians(12)))[0], [0, 1, 0])
    up, name = snap_to_axis(UpDirection("level", tilted, math.radians(1)))
    np.testing.assert_array_equal(up, tilted)
    assert name == ""


# From files


def write_turned(folder, turn=TURN, scale=3.7, move=(5, -3, 11), toml=""):
    """A ball of 0.5 m with a ring of cameras, in another frame; depth in metres."""
    poses = {}
    for number, pose in enumerate(ring(8, height=1.2, radius=1.6)):
        name = f"{number:02}.png"
        write_photo(folder / "images" / name, (64, 48), number)
        pose = pose.copy()
        pose[:, 3] += pose[:, :3] @ (0, 0.7, 0)  # the ball is at the origin
        write_depth((folder / "depth" / name).with_suffix(".exr"), sphere_depth(LENS.pinhole(pose), 0.5))
        rotation = pose[:, :3] @ turn.T
        poses[name] = np.column_stack([rotation, scale * pose[:, 3] - rotation @ np.asarray(move, float)])
    rng = np.random.default_rng(0)
    ball = rng.normal(size=(400, 3))
    ball *= 0.5 / np.linalg.norm(ball, axis=1, keepdims=True)
    write_text_model(folder / "cameras", poses, [LENS], scale * ball @ turn.T + move)
    if toml:
        (folder / "capture.toml").write_text(toml)
    return folder


def test_depth_in_metres_gives_the_unit(tmp_path):
    upright = read_upright_capture(write_turned(tmp_path / "capture"))
    frame = upright.frame
    assert (frame.scale_from, frame.metres_per_unit) == ("depth", pytest.approx(1 / 3.7, rel=0.03))
    assert frame.scale_error < 0.03
    assert apart_deg(frame.up, TURN @ (0, 1, 0)) < 1
    # captureToAsset turns and scales: the cameras stand upright and in metres.
    matrix = upright.capture.asset_from_capture
    np.testing.assert_allclose(np.cbrt(np.linalg.det(matrix[:3, :3])), 1 / 3.7, rtol=0.03)
    given_views = read_capture(tmp_path / "capture").views
    places = [view.lens.pinhole(view.cam_from_world).position_m for view in given_views]
    assert np.ptp([(matrix @ [*place, 1])[1] for place in places]) < 0.02
    for view in upright.capture.views:
        assert np.linalg.norm(view.cam_from_world[:, 3]) < 20  # in metres, however far the frame's origin is


@pytest.mark.parametrize(
    ("toml", "up_from", "scale_from"),
    [
        ('up_axis = "Z"\nmetres_per_unit = 0.01\n', "capture.toml", "capture.toml"),
        ('up_axis = "-X"\n', "capture.toml", "the frame"),
        ("up_vector = [0.1, -2, 0.3]\nmetres_per_unit = 2\n", "capture.toml", "capture.toml"),
        ('up_axis = "auto"\nmetres_per_unit = 2\n', "level", "capture.toml"),
        ('[known_distance]\nphotographs = ["00.png", "04.png"]\nmetres = 6.4\n', "level", "distance"),
    ],
)
def test_what_is_stated_goes_before_what_is_found(toml, up_from, scale_from, tmp_path):
    upright = read_upright_capture(write_turned(tmp_path / "capture", toml=toml))
    assert (upright.frame.up_from, upright.frame.scale_from) == (up_from, scale_from)
    if scale_from == "distance":  # the cameras are 3.2 m apart, so that all is twice as large as it was made
        assert upright.frame.metres_per_unit == pytest.approx(2 / 3.7, rel=1e-6)
    if "0.1, -2" in toml:
        np.testing.assert_allclose(upright.frame.up, np.array([0.1, -2, 0.3]) / np.linalg.norm([0.1, -2, 0.3]))
        np.testing.assert_allclose(upright.capture.asset_from_world[:3, :3] @ upright.frame.up, [0, 1, 0], atol=1e-12)
    if up_from == scale_from == "capture.toml":
        assert not [each for each in upright.capture.remarks if each.code in CODES]


def test_what_is_found_does_not_depend_on_the_views_that_are_chosen(tmp_path):
    folder = write_turned(tmp_path / "capture")
    assert read_upright_capture(folder, views="0,1").frame == read_upright_capture(folder).frame
    assert len(read_upright_capture(folder, views="0,1").capture.views) == 2


def test_a_frame_in_metres_with_y_up_is_read_as_it_is(tmp_path):
    folder = write_turned(tmp_path / "capture", np.eye(3), 1.0, (0, 0, 0))
    upright, plain = read_upright_capture(folder), read_capture(folder)
    assert (upright.capture.settings.up_axis, upright.capture.settings.metres_per_unit) == ("Y", 1)
    for found, given_view in zip(upright.capture.views, plain.views, strict=True):
        np.testing.assert_array_equal(found.cam_from_world, given_view.cam_from_world)
    np.testing.assert_array_equal(upright.capture.asset_from_world, np.eye(4))
