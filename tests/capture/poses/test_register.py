"""Cameras of rendered photographs against those that rendered them; and what happens where none can be found."""

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from usdfoliage.capture.folder.photo_set import read_photo_set
from usdfoliage.capture.lens import Lens
from usdfoliage.capture.poses.child_process import MODULE, run_items
from usdfoliage.capture.poses.diagnosis import check_cameras
from usdfoliage.capture.poses.pairs import match_descriptors, neighbors_in_order, retrieve_pairs
from usdfoliage.capture.poses.register import register_photos
from usdfoliage.capture.poses.result import Registered, project_with
from usdfoliage.capture.poses.settings import PoseEstimationSettings
from usdfoliage.errors import CaptureError
from usdfoliage.files.npz import write_arrays
from usdfoliage.remarks import warnings_of

from tests.support.captures import look_at
from tests.support.textured_scene import LENS, arc, write_photos

POSES = arc(6)
SETTINGS = PoseEstimationSettings(features=1500, min_features=0)


def centers(poses) -> np.ndarray:
    return np.array([-pose[:, :3].T @ pose[:, 3] for pose in poses])


def worst_place(registered: Registered, poses) -> float:
    """Of a camera, once the cameras are laid over the true ones by a similarity."""
    found = centers([photo.cam_from_world for photo in registered.photos])
    true = centers([poses[photo.name] for photo in registered.photos])
    a, b = found - found.mean(axis=0), true - true.mean(axis=0)
    u, sizes, vt = np.linalg.svd(b.T @ a)
    signs = np.array([1, 1, np.sign(np.linalg.det(u @ vt))])
    scale = (sizes * signs).sum() / np.square(a).sum()
    return float(np.linalg.norm(scale * a @ (u @ np.diag(signs) @ vt).T - b, axis=1).max())


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Six photographs of a corner, one of another scene, one that shows nothing, one that is no photograph."""
    folder = tmp_path_factory.mktemp("photos")
    write_photos(folder, POSES)
    write_photos(folder, {"other.png": POSES["02.png"]}, seed=7)
    assert cv2.imwrite(str(folder / "plain.png"), np.full((240, 320), 90, np.uint8))
    (folder / "torn.png").write_bytes((folder / "00.png").read_bytes()[:5000])
    shutil.copy(folder / "03.png", folder / "03 again.png")
    return folder


@pytest.fixture(scope="module")
def work(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("work")


@pytest.fixture(scope="module")
def registered(folder, work) -> Registered:
    return register_photos(read_photo_set(folder), work, SETTINGS)


def test_cameras_are_where_they_were(registered):
    assert [photo.name for photo in registered.photos] == list(POSES) or (
        {photo.name for photo in registered.photos} == {*POSES, "03 again.png"} - {"03.png"}
    )
    poses = {**POSES, "03 again.png": POSES["03.png"]}
    assert worst_place(registered, poses) < 0.01  # of 2.6 from the scene
    assert np.average(registered.error_px, weights=np.diff(registered.track_starts)) < 0.5
    for photo in registered.photos:
        assert photo.lens.focal_px[0] == pytest.approx(LENS.focal_px[0], rel=0.02)
        assert photo.points > 100
        assert photo.error_px < 0.5


def test_a_horizon_is_no_ground_for_cameras(registered):
    assert warnings_of(registered.remarks) == ()
    wide, band = registered.track_places_px, registered.track_places_px * (1, 0.02)
    assert check_cameras(registered.photos, registered.track_photos, wide, 15) == ()
    (found,) = check_cameras(registered.photos, registered.track_photos, band, 15)
    assert found.code == "points-in-a-band"
    assert "horizon" in found.text


def test_points_project_to_their_observed_places(registered):
    point_of = np.repeat(np.arange(len(registered.points)), np.diff(registered.track_starts))
    apart = np.zeros(len(point_of))
    for number, photo in enumerate(registered.photos):
        here = registered.track_photos == number
        seen = project_with(photo.lens, photo.cam_from_world, registered.points[point_of[here]])
        apart[here] = np.linalg.norm(seen - registered.track_places_px[here], axis=1)
    assert np.median(apart) < 0.5
    mean = np.bincount(point_of, apart) / np.bincount(point_of)
    np.testing.assert_allclose(mean, registered.error_px, atol=1e-9)
    assert registered.srgb.shape == (len(registered.points), 3)
    assert registered.srgb.std() > 10


def test_every_other_photograph_is_named_with_the_reason(registered):
    reasons = {failure.name: failure.reason for failure in registered.failures}
    copy = ({"03.png", "03 again.png"} - {photo.name for photo in registered.photos}).pop()
    assert set(reasons) == {"other.png", "plain.png", "torn.png", copy}
    assert "another scene" in reasons["other.png"]
    assert "0 features" in reasons["plain.png"]
    assert "truncated" in reasons["torn.png"] or "damaged" in reasons["torn.png"]
    assert "copy" in reasons[copy]
    (missing,) = [each for each in registered.remarks if each.code == "photographs-not-registered"]
    assert missing.text.startswith("2 of 8 photographs have no camera")


def test_matches_of_all_photographs(registered):
    count = len(registered.names)
    assert registered.matches.shape == (count, count)
    np.testing.assert_array_equal(registered.matches, registered.matches.T)
    other = registered.names.index("other.png")
    assert registered.matches[other].max() < SETTINGS.min_matches
    neighbors = np.sort(registered.matches, axis=1)[[name in POSES for name in registered.names], -1]
    assert (neighbors > 100).all()


def test_what_is_finished_is_not_done_again(registered, folder, work, monkeypatch):
    def never(*arguments, **keywords):
        raise AssertionError("a process was started")

    monkeypatch.setattr("subprocess.Popen", never)
    again = register_photos(read_photo_set(folder), work, SETTINGS)
    for first, second in zip(registered.photos, again.photos, strict=True):
        np.testing.assert_array_equal(first.cam_from_world, second.cam_from_world)


def test_the_same_bits_with_another_number_of_threads(registered, folder, tmp_path):
    one = PoseEstimationSettings(features=1500, min_features=0, threads=1)
    again = register_photos(read_photo_set(folder), tmp_path / "work", one)
    np.testing.assert_array_equal(again.points, registered.points)
    for first, second in zip(registered.photos, again.photos, strict=True):
        np.testing.assert_array_equal(first.cam_from_world, second.cam_from_world)
        assert first.lens == second.lens


def test_a_camera_that_only_turns(tmp_path):
    place = np.array([1.6, 1.2, 1.5])
    poses = {f"{n}.png": look_at(place, (0.3 + 0.2 * n, 0.4, 0.7 - 0.2 * n)) for n in range(3)}
    write_photos(tmp_path / "photos", poses)
    with pytest.raises(CaptureError, match="only turned"):
        register_photos(read_photo_set(tmp_path / "photos"), tmp_path / "work", SETTINGS)


def test_no_overlap_and_too_few(tmp_path):
    for number in range(2):
        write_photos(tmp_path / "photos", {f"{number}.png": POSES["02.png"]}, seed=number)
    with pytest.raises(CaptureError, match="no two of 2 photographs"):
        register_photos(read_photo_set(tmp_path / "photos"), tmp_path / "work", SETTINGS)
    (tmp_path / "photos" / "1.png").unlink()
    with pytest.raises(CaptureError, match="1 photograph that can be used; two"):
        register_photos(read_photo_set(tmp_path / "photos"), tmp_path / "work", SETTINGS)


WORKER = """
import json, os, pathlib, sys
job = json.loads(pathlib.Path(sys.argv[1]).read_text())
for number, item in job["items"]:
    if item.get("abort"):
        os.abort()
    if item.get("kills"):
        tries = pathlib.Path(item["out"] + ".tries")
        tries.write_text(tries.read_text() + "." if tries.exists() else ".")
        if len(tries.read_text()) <= item["kills"]:
            os.kill(os.getpid(), item["signal"])
    if item.get("refuse"):
        print(item.get("kind", "failed"), number, item["refuse"], flush=True)
        continue
    pathlib.Path(item["out"]).write_text("made")
    print("done", number, flush=True)
"""


@pytest.mark.parametrize("processes", [1, 3])
def test_a_child_that_aborts_costs_one_item(tmp_path, monkeypatch, processes):
    (tmp_path / "worker_of_test.py").write_text(WORKER)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]))
    items = [{"out": str(tmp_path / f"{number}.out")} for number in range(7)]
    items[2]["abort"] = items[5]["abort"] = True
    items[3]["refuse"] = "no good"
    calls: list[tuple[int, int]] = []
    work = tmp_path / "work"
    work.mkdir()
    failures = run_items({}, items, work, processes, lambda *done: calls.append(done), module="worker_of_test")
    assert [failure.number for failure in failures] == [2, 3, 5]
    assert [(tmp_path / f"{number}.out").exists() for number in range(7)] == [
        True,
        True,
        False,
        False,
        True,
        False,
        True,
    ]
    assert calls[-1] == (7, 7)
    assert list(work.iterdir()) == []


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_a_child_that_is_killed_from_outside_costs_nothing(tmp_path, monkeypatch, caplog, number):
    (tmp_path / "worker_of_test.py").write_text(WORKER)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]))
    items = [{"out": str(tmp_path / f"{number}.out")} for number in range(4)]
    items[1] |= {"kills": 2, "signal": number}
    (tmp_path / ".job-0123456789ab").mkdir()  # a killed run has left it
    (tmp_path / ".job-0123456789ab" / "database.db").touch()
    (tmp_path / ".job-0123456789ab.log").touch()
    items[3] |= {"kills": 9, "signal": number}  # it is the item that ends them
    (failure,) = run_items({}, items, tmp_path, 1, module="worker_of_test")
    assert failure.number == 3
    assert [(tmp_path / f"{number}.out").exists() for number in range(4)] == [True, True, True, False]
    assert caplog.text.count("killed from outside") == 4
    assert not list(tmp_path.glob(".job*"))


def test_features_of_another_shape_are_made_again(tmp_path, monkeypatch):
    write_photos(tmp_path / "photos", {name: POSES[name] for name in sorted(POSES)[:5]})
    photo_set = read_photo_set(tmp_path / "photos")
    work = tmp_path / "work"
    first = register_photos(photo_set, work, SETTINGS)
    for pattern in ("features", "matches", "model"):
        path = sorted(work.glob(f"{pattern}-*.npz"))[0]
        whole = path.read_bytes()
        with np.load(path) as arrays:
            np.savez(path, **{name: arrays[name].reshape(-1)[:1] for name in arrays.files})
        again = register_photos(photo_set, work, SETTINGS)
        assert path.read_bytes() == whole
        assert [photo.name for photo in again.photos] == [photo.name for photo in first.photos]


def test_a_damaged_result_is_made_again(tmp_path, monkeypatch):
    (tmp_path / "worker_of_test.py").write_text(WORKER)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]))
    items = [{"out": str(tmp_path / f"{number}.npz")} for number in range(3)]
    write_arrays(Path(items[0]["out"]), {"kept": np.arange(9)})
    np.savez(items[1]["out"], torn=np.arange(900))
    os.truncate(items[1]["out"], 300)
    (tmp_path / "2.npz").touch()
    whole = (tmp_path / "0.npz").read_bytes()
    assert run_items({}, items, tmp_path, 2, module="worker_of_test") == ()
    assert (tmp_path / "0.npz").read_bytes() == whole
    assert [(tmp_path / f"{number}.npz").read_text() for number in (1, 2)] == ["made", "made"]


def test_a_full_disk_is_reported_by_its_kind_and_not_by_its_words(tmp_path, monkeypatch):
    (tmp_path / "worker_of_test.py").write_text(WORKER)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]))
    items = [{"out": str(tmp_path / f"{number}.out")} for number in range(3)]
    items[1]["refuse"] = "the disk is full of photographs, and No space left on device"
    (failure,) = run_items({}, items, tmp_path, 2, module="worker_of_test")
    assert (failure.number, failure.is_full_disk) == (1, False)
    (tmp_path / "2.out").unlink()
    items[1] |= {"refuse": "it did not fit", "kind": "full-disk"}
    with pytest.raises(CaptureError, match="no space left; free some"):
        run_items({}, items, tmp_path, 2, module="worker_of_test")
    assert (tmp_path / "2.out").exists()  # what can be done is kept


def test_a_child_that_ends_on_a_full_disk_is_reported_so(tmp_path, monkeypatch, small_disk):
    (tmp_path / "worker_of_test.py").write_text(WORKER)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]))
    items = [{"out": str(small_disk / "0.out"), "abort": True}]
    with pytest.raises(CaptureError, match="no space left; free some"):
        run_items({}, items, small_disk, 1, module="worker_of_test")


def test_the_worker_reports_a_full_disk_under_its_database(tmp_path, small_disk):
    features = tmp_path / "features.npz"
    count = 50_000
    np.savez(features, keypoints=np.zeros((count, 4), np.float32), descriptors=np.zeros((count, 128), np.uint8))
    camera = {"model": "SIMPLE_RADIAL", "focal_px": 300.0, "width_px": 320, "height_px": 240, "known": True, "group": 0}
    item = {"out": str(small_disk / "model.npz")}
    job = {"task": "map", "mapper": "incremental", "seed": 0, "min_matches": 15, "mapper_threads": 1}
    job |= {"features": [str(features)], "cameras": [camera], "numbers": [0], "matches": [], "items": [(7, item)]}
    (tmp_path / "job.json").write_text(json.dumps(job))
    command = [sys.executable, "-m", MODULE, str(tmp_path / "job.json")]
    ended = subprocess.run(command, capture_output=True, text=True, check=True)
    assert ended.stdout.startswith("full-disk 7 ")
    assert list(small_disk.iterdir()) == []


def test_an_interrupt_ends_the_children(tmp_path, monkeypatch):
    (tmp_path / "worker_of_test.py").write_text(WORKER + "    import time; time.sleep(0.3)\n")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]))
    items = [{"out": str(tmp_path / f"{number}.out")} for number in range(40)]

    def interrupt(done: int, total: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_items({}, items, tmp_path, 2, interrupt, module="worker_of_test")
    assert 2 <= len(list(tmp_path.glob("*.out"))) < 10
    assert not list(tmp_path.glob(".job*"))
    assert run_items({}, items[:3], tmp_path, 2, module="worker_of_test") == ()  # and the next run goes on


def descriptors(count: int) -> np.ndarray:
    """Of length 512, as those of SIFT."""
    drawn = np.random.default_rng(0).random((count, 128))
    return np.rint(512 * drawn / np.linalg.norm(drawn, axis=1, keepdims=True)).astype(np.uint8)


def test_descriptors_match_when_each_is_the_nearest_of_the_other():
    first = descriptors(50)
    order = np.random.default_rng(1).permutation(50)
    second = first[order].copy()
    second[:3] = 0  # like nothing
    found = match_descriptors(first, second)
    assert len(found) == 47
    np.testing.assert_array_equal(order[found[:, 1]], found[:, 0])
    assert match_descriptors(first[:0], second).shape == (0, 2)
    assert match_descriptors(first, second[:1]).shape == (0, 2)


def test_two_equal_descriptors_are_no_match():
    first = descriptors(5)
    assert 0 not in match_descriptors(first, np.concatenate([first, first[:1]]))[:, 0]


def test_pairs_of_a_sequence_and_by_likeness():
    pairs = set(neighbors_in_order(100, 4))
    assert {(0, 1), (0, 4), (0, 8), (10, 42)} <= pairs
    assert (0, 5) not in pairs
    rng = np.random.default_rng(0)
    places = rng.integers(0, 120, (10, 200, 128)).astype(np.uint8)  # ten places, each photographed twice
    photos = [np.clip(places[n // 2] + rng.integers(-4, 5, (200, 128)), 0, 255).astype(np.uint8) for n in range(20)]
    found = retrieve_pairs(photos, 2, np.random.default_rng(1))
    assert {(n, n + 1) for n in range(0, 20, 2)} <= found
    assert found == retrieve_pairs(photos, 2, np.random.default_rng(1))


@pytest.mark.parametrize(
    "lens",
    [
        Lens(model="SIMPLE_RADIAL", width_px=640, height_px=480, parameters=(500.0, 320, 240, -0.1)),
        Lens(model="PINHOLE", width_px=640, height_px=480, parameters=(500.0, 510, 320, 240)),
        Lens(model="OPENCV_FISHEYE", width_px=640, height_px=480, parameters=(300.0, 300, 320, 240, 0, 0, 0, 0)),
    ],
)
def test_projection_through_lenses(lens):
    pose = np.column_stack([np.eye(3), (0.0, 0, 2)])
    x, y = 0.2, -0.1
    (found,) = project_with(lens, pose, np.array([[2 * x * 1.0, 2 * y * 1.0, 0.0]]))
    radius = np.hypot(x, y)
    bent = {"SIMPLE_RADIAL": 1 - 0.1 * radius**2, "PINHOLE": 1, "OPENCV_FISHEYE": np.arctan(radius) / radius}[
        lens.model
    ]
    np.testing.assert_allclose(found, (320 + lens.focal_px[0] * bent * x, 240 + lens.focal_px[1] * bent * y), atol=1e-6)
    assert project_with(lens, pose, np.zeros((0, 3))).shape == (0, 2)


@pytest.mark.parametrize(
    "wrong",
    [
        {"mapper": "best"},
        {"features": 5},
        {"lens_model": "EYE"},
        {"focal_px": -1.0},
        {"min_matches": 2},
        {"seed": -1},
    ],
)
def test_wrong_settings(wrong):
    with pytest.raises(ValueError, match="must"):
        PoseEstimationSettings(**wrong)
