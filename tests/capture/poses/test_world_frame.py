"""A metre and an up for cameras whose true world is known."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from usdfoliage.capture.folder.photo_set import PhotoFile
from usdfoliage.capture.lens import Lens
from usdfoliage.capture.poses import world_frame
from usdfoliage.capture.poses.result import Registered, RegisteredPhoto
from usdfoliage.capture.poses.up_direction import UpDirection
from usdfoliage.capture.poses.world_frame import (
    KnownDistance,
    ScaleBar,
    WorldSettings,
    level_and_scale,
    move_registered,
    read_scale_hints,
)
from usdfoliage.errors import CaptureError

from tests.support.captures import look_at

LENS = Lens(model="SIMPLE_RADIAL", width_px=640, height_px=480, parameters=(600.0, 320.0, 240.0, -0.05))


def photo_file(name: str, **known) -> PhotoFile:
    values = {
        "path": Path(name), "width_px": 640, "height_px": 480, "orientation": 1, "digest": name, "sharpness": 1.0,
        "camera": "", "focal_px": None, "gps": None, "elevation_deg": None,
    }  # fmt: skip
    return PhotoFile(name=name, **{**values, **known})


def scene(count=12, angle=2 * math.pi, height=1.5, radius=2.0, ground=True, seed=0) -> Registered:
    """A bush on the ground, y = 0, and cameras around it that look at its middle; metres, Y up."""
    rng = np.random.default_rng(seed)
    bush = rng.normal((0, 0.8, 0), 0.25, (300, 3))
    soil = np.column_stack([rng.uniform(-1.5, 1.5, 300), rng.normal(0, 0.003, 300), rng.uniform(-1.5, 1.5, 300)])
    points = np.concatenate([bush, soil]) if ground else bush
    photos = []
    for number, turn in enumerate(np.arange(count) / count * angle):
        place = (radius * math.sin(turn), height, radius * math.cos(turn))
        pose = look_at(place, (0, 0.7, 0))
        photos.append(
            RegisteredPhoto(name=f"{number:02d}.jpg", lens=LENS, cam_from_world=pose, error_px=0.3, points=len(points))
        )
    seen = np.tile(np.arange(count), len(points))
    return Registered(
        photos=tuple(photos),
        points=points,
        srgb=np.zeros((len(points), 3), np.uint8),
        error_px=np.zeros(len(points)),
        track_starts=np.arange(len(points) + 1) * count,
        track_photos=seen,
        track_places_px=np.zeros((len(seen), 2)),
        names=tuple(photo.name for photo in photos),
        matches=np.zeros((count, count), np.int64),
        failures=(),
        remarks=(),
    )


def files_of(registered: Registered, **known) -> list[PhotoFile]:
    return [photo_file(photo.name, **known) for photo in registered.photos]


def jumble(registered: Registered, vector=(0.7, -1.2, 0.4), scale=3.7) -> Registered:
    """The scene as a reconstruction finds it: anyhow."""
    matrix = np.eye(4)
    matrix[:3, :3] = scale * Rotation.from_rotvec(vector).as_matrix()
    matrix[:3, 3] = (5, -3, 11)
    return move_registered(registered, matrix)


def centers(registered: Registered) -> np.ndarray:
    return np.array([-photo.cam_from_world[:, :3].T @ photo.cam_from_world[:, 3] for photo in registered.photos])


def up_error_deg(registered: Registered, true: Registered) -> float:
    """Between +Y of a world and the true up, by the cameras' rotations."""
    turn = registered.photos[0].cam_from_world[:, :3].T @ true.photos[0].cam_from_world[:, :3]
    return math.degrees(math.acos(np.clip((turn @ (0, 1, 0))[1], -1, 1)))


def test_moving_keeps_what_cameras_see():
    true = scene()
    moved = jumble(true)
    for before, after in zip(true.photos, moved.photos, strict=True):
        seen = true.points @ before.cam_from_world[:, :3].T + before.cam_from_world[:, 3]
        again = moved.points @ after.cam_from_world[:, :3].T + after.cam_from_world[:, 3]
        np.testing.assert_allclose(again, 3.7 * seen, atol=1e-9)


@settings(max_examples=15)
@given(x=st.floats(-3, 3), y=st.floats(-3, 3), z=st.floats(-3, 3), scale=st.floats(0.01, 100))
def test_a_ring_is_upright_however_the_reconstruction_lies(x, y, z, scale):
    true = scene()
    found = jumble(true, (x, y, z), scale)
    without = level_and_scale(found, files_of(found))
    times = 1 / (scale * without.metres_per_unit)
    frame = level_and_scale(found, files_of(found), WorldSettings(times=times))
    world = move_registered(found, frame.world_from_registered)
    assert up_error_deg(world, true) < 1
    assert frame.metres_per_unit == pytest.approx(1 / scale)
    assert frame.scale_from == "scale"
    apart = np.linalg.norm(centers(world)[:, None] - centers(world)[None], axis=2)
    np.testing.assert_allclose(apart, np.linalg.norm(centers(true)[:, None] - centers(true)[None], axis=2), atol=1e-6)
    assert abs(np.quantile(world.points[:, 1], 0.01)) < 0.02  # the ground at 0
    assert centers(world)[0][2] > 0.5  # the first camera towards +Z
    assert abs(centers(world)[0][0]) < 0.3


@pytest.mark.parametrize(
    ("method", "within_deg"), [("level", 0.1), ("ring", 0.1), ("ground", 1.0), ("photographs", 1.0), ("elevation", 0.1)]
)
def test_each_method_finds_up(method, within_deg):
    true = scene()
    found = jumble(true)
    pitch = -math.degrees(math.atan2(0.8, 2.0))
    frame = level_and_scale(found, files_of(found, elevation_deg=pitch), WorldSettings(up=method))
    assert frame.up_from == method
    assert up_error_deg(move_registered(found, frame.world_from_registered), true) < within_deg


def test_the_trunk_of_a_tree():
    true = scene(ground=False, height=2.0)
    rng = np.random.default_rng(1)
    trunk = np.column_stack([rng.normal(0, 0.02, 400), rng.uniform(0, 1, 400), rng.normal(0, 0.02, 400)])
    crown = rng.normal((0, 1.4, 0), 0.2, (300, 3))
    true = replace(true, points=np.concatenate([trunk, crown]))
    counts = len(true.points)
    true = replace(
        true,
        track_starts=np.arange(counts + 1) * 12,
        track_photos=np.tile(np.arange(12), counts),
        track_places_px=np.zeros((12 * counts, 2)),
    )
    found = jumble(true)
    frame = level_and_scale(found, files_of(found), WorldSettings(up="trunk"))
    assert up_error_deg(move_registered(found, frame.world_from_registered), true) < 3


def test_an_arc_that_looks_down_is_upright_by_the_ground():
    true = scene(count=6, angle=0.5, height=2.5)
    found = jumble(true)
    frame = level_and_scale(found, files_of(found))
    assert up_error_deg(move_registered(found, frame.world_from_registered), true) < 3


def test_pictures_on_their_side_by_exif():
    true = scene()
    roll = np.array(
        [[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]
    )  # stored pixels are turned: up is to their left … as orientation 6 states
    turned = tuple(replace(photo, cam_from_world=roll.T @ photo.cam_from_world) for photo in true.photos)
    found = jumble(replace(true, photos=turned))
    tops = {o: level_and_scale(found, files_of(found, orientation=o), WorldSettings(up="photographs")) for o in (6, 8)}
    errors = [
        up_error_deg(move_registered(found, frame.world_from_registered), replace(true, photos=turned))
        for frame in tops.values()
    ]
    assert sorted(round(error) for error in errors) == [0, 180]
    assert errors[0] < 1


def test_positions_by_satellite_give_scale_and_up():
    true = scene(height=30, radius=40)
    rng = np.random.default_rng(2)
    found = jumble(true)
    files = []
    for photo, place in zip(found.photos, centers(true), strict=True):
        x, y, z = place + rng.normal(0, 0.5, 3)
        latitude, longitude = math.degrees(-z / 6371008.8), math.degrees(x / 6371008.8)
        files.append(photo_file(photo.name, gps=(46 + latitude, 8 + longitude / math.cos(math.radians(46)), 400 + y)))
    frame = level_and_scale(found, files, WorldSettings(up="gps"))
    world = move_registered(found, frame.world_from_registered)
    assert (frame.scale_from, frame.scale_known) == ("gps", True)
    assert up_error_deg(world, true) < 1
    assert frame.metres_per_unit == pytest.approx(1 / 3.7, rel=0.02)


def test_positions_as_far_off_as_the_plant_is_wide_are_not_used():
    found = jumble(scene())
    rng = np.random.default_rng(3)
    files = [
        photo_file(photo.name, gps=(46 + rng.normal(0, 5e-5), 8 + rng.normal(0, 5e-5), 400)) for photo in found.photos
    ]
    frame = level_and_scale(found, files)
    assert frame.scale_from == "nothing"
    assert "positions-contradict-pictures" in [each.code for each in frame.remarks]


@pytest.mark.parametrize(("error_deg", "severities"), [(4.9, []), (5.1, ["warning"])])
def test_an_up_that_may_be_wrong_by_more_than_five_degrees_is_a_warning(error_deg, severities, monkeypatch):
    up = UpDirection("level", np.array([0.0, 1.0, 0.0]), math.radians(error_deg))
    monkeypatch.setattr(world_frame, "find_ups", lambda *given: [up])
    found = jumble(scene())
    remarks = level_and_scale(found, files_of(found)).remarks
    assert [each.severity for each in remarks if each.code == "up-uncertain"] == severities


def test_without_any_scale_the_viewing_distance_is_a_metre_with_a_remark():
    found = jumble(scene())
    frame = level_and_scale(found, files_of(found))
    world = move_registered(found, frame.world_from_registered)
    apart = np.linalg.norm(world.points[:, None] - centers(world)[None], axis=2)
    assert np.median(apart) == pytest.approx(1)
    assert not frame.scale_known
    assert "scale-unknown" in [each.code for each in frame.remarks]


def test_scale_by_the_distance_of_two_cameras():
    true = scene()
    found = jumble(true)
    apart = float(np.linalg.norm(centers(true)[0] - centers(true)[3]))
    hint = KnownDistance(photographs=("00.jpg", "03.jpg"), metres=apart)
    frame = level_and_scale(found, files_of(found), WorldSettings(known_distance=hint))
    assert frame.metres_per_unit == pytest.approx(1 / 3.7)
    hint = KnownDistance(photographs=("00.jpg", "x.jpg"), metres=apart)
    with pytest.raises(CaptureError, match=r"'x\.jpg', which has no camera"):
        level_and_scale(found, files_of(found), WorldSettings(known_distance=hint))


def test_scale_by_a_bar_seen_through_a_distorting_lens():
    true = scene()
    found = jumble(true)
    ends = {"first": np.array([-0.3, 0.0, 0.2]), "second": np.array([0.4, 0.1, 0.1])}
    marks = {}
    for end, point in ends.items():
        seen = []
        for photo in (true.photos[0], true.photos[2]):
            x, y, z = photo.cam_from_world @ [*point, 1]
            bent = 1 - 0.05 * ((x / z) ** 2 + (y / z) ** 2)
            seen.append((photo.name, 320 + 600 * bent * x / z, 240 + 600 * bent * y / z))
        marks[end] = tuple(seen)
    bar = ScaleBar(**marks, metres=float(np.linalg.norm(ends["first"] - ends["second"])))
    frame = level_and_scale(found, files_of(found), WorldSettings(scale_bar=bar))
    assert frame.metres_per_unit == pytest.approx(1 / 3.7, rel=1e-5)
    assert frame.scale_from == "scale bar"


def test_hints_of_a_file():
    values = {
        "known_distance": {"photographs": ["a.jpg", "b.jpg"], "metres": 2},
        "scale_bar": {"metres": 0.5, "first": {"a": [1, 2], "b": [3, 4]}, "second": {"a": [5, 6], "b": [7, 8.5]}},
    }
    distance, bar = read_scale_hints(values, "capture.toml")
    assert distance == KnownDistance(photographs=("a.jpg", "b.jpg"), metres=2)
    assert bar is not None
    assert bar.second == (("a", 5, 6), ("b", 7, 8.5))
    assert read_scale_hints({}, "capture.toml") == (None, None)


@pytest.mark.parametrize(
    "values",
    [
        {"scale_bar": {"metres": 0.5, "first": {"a": [1, 2]}, "second": {"a": [5, 6], "b": [7, 8]}}},
        {"scale_bar": {"metres": 0, "first": {"a": [1, 2], "b": [1, 2]}, "second": {"a": [5, 6], "b": [7, 8]}}},
        {"scale_bar": {"metres": 1, "first": {"a": [1], "b": [1, 2]}, "second": {"a": [5, 6], "b": [7, 8]}}},
        {"scale_bar": 3},
        {"known_distance": {"photographs": ["a"], "metres": 1}},
        {"known_distance": {"metres": 1}},
        {"known_distance": {"photographs": ["a", "a"], "metres": 1}},
    ],
)
def test_hints_that_are_none(values):
    with pytest.raises(CaptureError, match=r"capture\.toml"):
        read_scale_hints(values, "capture.toml")


def test_up_that_the_user_states_and_up_that_is_not_there():
    true = scene()
    found = jumble(true)
    without = level_and_scale(found, files_of(found))
    seen = move_registered(found, without.world_from_registered)
    turn, _ = Rotation.align_vectors(
        centers(seen) - centers(seen).mean(axis=0), centers(true) - centers(true).mean(axis=0)
    )
    vector = turn.as_matrix() @ (0, 2.0, 0)  # what stands upright in truth, as the world without it shows it
    frame = level_and_scale(found, files_of(found), WorldSettings(up_vector=tuple(vector)))
    assert frame.up_from == "given"
    assert up_error_deg(move_registered(found, frame.world_from_registered), true) < 1e-5
    leaning = level_and_scale(found, files_of(found), WorldSettings(up_vector=(0.3, 1.0, 0.0)))
    again = level_and_scale(found, files_of(found), WorldSettings(up_vector=(0.0, 5.0, 0.0)))
    assert up_error_deg(move_registered(found, leaning.world_from_registered), true) > 10
    np.testing.assert_allclose(again.world_from_registered, without.world_from_registered, atol=1e-9)
    with pytest.raises(CaptureError, match="cannot be found by gps"):
        level_and_scale(found, files_of(found), WorldSettings(up="gps"))


def test_two_scales_are_refused():
    with pytest.raises(ValueError, match="one of"):
        WorldSettings(
            known_distance=KnownDistance(photographs=("a", "b"), metres=1),
            scale_bar=ScaleBar(first=(("a", 1, 1), ("b", 1, 1)), second=(("a", 2, 1), ("b", 2, 1)), metres=1),
        )
