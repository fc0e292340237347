"""Which of several models is taken, and which photographs stay in it; the mapper is a stand-in."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from usdfoliage.capture.poses import mapping
from usdfoliage.capture.poses.mapping import MatchedPhotos, drop_unseeing, map_photos
from usdfoliage.capture.poses.result import PairMatches
from usdfoliage.capture.poses.settings import PoseEstimationSettings
from usdfoliage.capture.poses.view_graph import PairTurns

from tests.capture.poses.test_view_graph import PHOTOS, ring


def model_of(tracks, photos: int) -> dict[str, np.ndarray]:
    """A model of points that are seen by the photographs of each track."""
    return {
        "images": np.arange(photos),
        "cam_from_world": np.tile(np.eye(4)[:3], (photos, 1, 1)),
        "parameters": np.tile([500.0, 320, 240, 0], (photos, 1)),
        "points": np.arange(3.0 * len(tracks)).reshape(-1, 3),
        "errors": np.zeros(len(tracks)),
        "track_starts": np.cumsum([0, *map(len, tracks)]),
        "track": np.array([(photo, number) for number, track in enumerate(tracks) for photo in track]),
        "group": np.zeros(photos, np.int64),
    }


def test_photographs_that_see_few_points_are_dropped_and_points_that_one_photograph_sees():
    """The third sees one point; without it the second, which shares points with that one alone, has too few."""
    tracks = [(0, 3)] * 5 + [(0, 1, 3)] * 2 + [(1, 2)]
    left = drop_unseeing(model_of(tracks, 4), min_points=3)
    assert left["images"].tolist() == [0, 3]
    assert left["group"].tolist() == [0, -1, -1, 0]
    assert len(left["cam_from_world"]) == len(left["parameters"]) == 2
    np.testing.assert_array_equal(left["points"], np.arange(21.0).reshape(-1, 3))
    assert left["track_starts"].tolist() == list(range(0, 15, 2))
    assert left["track"].tolist() == [[photo, number] for number in range(7) for photo in (0, 3)]


def test_a_model_whose_photographs_see_enough_stays_the_same():
    model = model_of([(0, 1)] * 9, 2)
    assert drop_unseeing(model, min_points=9) is model


def test_of_a_model_that_nothing_supports_no_photograph_stays():
    left = drop_unseeing(model_of([(0, 1), (1, 2)], 3), min_points=5)
    assert len(left["images"]) == len(left["points"]) == len(left["track"]) == 0


@pytest.fixture
def matched() -> MatchedPhotos:
    many = np.full((PHOTOS, PHOTOS), 100)
    pairs = PairMatches(verified=many, similar=many, panoramic=np.zeros_like(many, dtype=bool))
    return MatchedPhotos(
        photo_set=None, features=(), cameras={}, usable=tuple(range(PHOTOS)), match_files=(), pairs=pairs
    )


def choose(monkeypatch, matched: MatchedPhotos, turns: PairTurns, models) -> tuple[dict, list[str], int]:
    """What map_photos takes, the codes of its remarks, and how often it mapped; models are taken one by one."""
    asked = []

    def give(photos, *rest):
        asked.append(photos.only)
        return models[len(asked) - 1]

    pairs = np.column_stack([turns.first, turns.second])
    monkeypatch.setattr(mapping, "_map", give)
    monkeypatch.setattr(mapping, "_find_turns", lambda *arguments: (pairs, turns))
    model, remarks = map_photos(matched, Path(), PoseEstimationSettings(), 1)
    return model, [each.code for each in remarks], len(asked)


def turned(off_deg: float, photos: int = PHOTOS) -> dict[str, np.ndarray]:
    """A model with the cameras of the ring, every second one turned by an angle."""
    azimuth = np.radians(360 / PHOTOS) * np.arange(photos)
    tilt = np.where(np.arange(photos) % 2, np.radians(40), np.radians(12))
    cameras = Rotation.from_euler("x", tilt[:, None]) * Rotation.from_euler("y", azimuth[:, None])
    wrong = Rotation.from_euler("z", np.where(np.arange(photos) % 2, np.radians(off_deg), 0)[:, None]) * cameras
    model = model_of([tuple(range(photos))], photos)
    return {**model, "cam_from_world": np.concatenate([wrong.as_matrix(), np.zeros((photos, 3, 1))], axis=2)}


def test_pairs_that_contradict_are_left_out_where_that_agrees_better(monkeypatch, matched):
    turns, _ = ring()
    model, codes, count = choose(monkeypatch, matched, turns, [turned(20), turned(0)])
    np.testing.assert_array_equal(model["cam_from_world"], turned(0)["cam_from_world"])
    assert (codes, count) == (["pairs-contradict"], 2)
    _, right = ring()
    np.testing.assert_array_equal(model["pairs"], np.column_stack([turns.first, turns.second])[right])


def test_a_model_that_nothing_misled_stays_without_another_run(monkeypatch, matched):
    turns, _ = ring()
    _, codes, count = choose(monkeypatch, matched, turns, [turned(0)])
    assert (codes, count) == ([], 1)


def test_a_model_that_loses_photographs_is_not_taken(monkeypatch, matched):
    turns, _ = ring()
    first = turned(20)
    model, codes, count = choose(monkeypatch, matched, turns, [first, turned(0, PHOTOS - 3), turned(0, PHOTOS - 3)])
    assert model is first
    assert (codes, count) == ([], 3)


def test_a_model_that_agrees_no_better_is_not_taken(monkeypatch, matched):
    turns, _ = ring()
    first = turned(20)
    model, codes, _ = choose(monkeypatch, matched, turns, [first, turned(20), turned(25)])
    assert model is first
    assert codes == []
