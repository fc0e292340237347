"""The work of a capture: names of results, what is kept of them, what a stopped run still lacks, capture.toml."""

import dataclasses
import os
import shutil
import tomllib
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from usdfoliage.capture.cloud.fusion import CloudSettings
from usdfoliage.capture.folder.read import read_capture
from usdfoliage.capture.folder.settings import complete_capture_settings
from usdfoliage.capture.mvs.agreement import DepthEstimate
from usdfoliage.capture.mvs.rounds import MvsSettings, Round
from usdfoliage.capture.mvs.upsampling import enlarge_depth
from usdfoliage.capture.mvs.view_selection import ViewSelectionSettings
from usdfoliage.errors import CaptureError, WriteError
from usdfoliage.jobs.capture.depth_tasks import MissingTasks, find_missing, plan_tasks, prepare_views, read_pixels
from usdfoliage.jobs.capture.maps import ViewMaps
from usdfoliage.jobs.capture.run import size_cells
from usdfoliage.jobs.work.keys import task_key
from usdfoliage.jobs.work.results import (
    forget,
    has_result,
    lock_work,
    read_result,
    write_result,
    write_whole,
)

from tests.support.capture_photos import LENS, poses, write_posed_photos

LEAVES = st.one_of(st.none(), st.booleans(), st.integers(), st.floats(allow_nan=False), st.text(max_size=4))
PARTS = st.recursive(LEAVES, lambda inner: st.lists(inner, max_size=3), max_leaves=6)


@dataclass(frozen=True)
class Threaded:
    threads: int
    size: int


@given(PARTS, PARTS)
def test_results_of_different_things_have_different_names(one, other):
    assert task_key(one) == task_key(one)
    if repr(one) != repr(other):
        assert task_key(one) != task_key(other)


def test_what_a_name_depends_on():
    row = np.arange(6.0)
    assert task_key(row) == task_key(row.copy())
    assert len({task_key(row), task_key(row.reshape(2, 3)), task_key(row.astype(np.float32)), task_key(row + 1)}) == 4
    assert task_key("ab", "c") != task_key("a", "bc")
    assert task_key(Threaded(1, 5)) == task_key(Threaded(2, 5)) != task_key(Threaded(1, 6))
    settings = MvsSettings()
    closer = dataclasses.replace(settings, selection=ViewSelectionSettings(min_angle_deg=2))
    assert task_key(settings) != task_key(closer)
    with pytest.raises(TypeError, match="hash"):
        task_key({1: 2})


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("share", [0.0, 0.01, 0.5, 0.99])
def test_a_truncated_result_is_none(tmp_path, compressed, share):
    path = tmp_path / "deeper" / "a.npz"
    arrays = {"depth": np.random.default_rng(0).random((40, 30)), "notes": np.array("ö")}
    write_result(path, arrays, compressed=compressed)
    assert has_result(path)
    result = read_result(path)
    np.testing.assert_array_equal(result["depth"], arrays["depth"])
    assert str(result["notes"]) == "ö"
    os.truncate(path, int(share * path.stat().st_size))
    assert not has_result(path)
    assert read_result(path) is None


@pytest.mark.parametrize("compressed", [False, True])
def test_a_result_with_a_wrong_bit_is_none(tmp_path, compressed):
    path = tmp_path / "a.npz"
    write_result(path, {"depth": np.random.default_rng(0).random((40, 30))}, compressed=compressed)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(bytes(data))
    assert not has_result(path)
    assert read_result(path) is None
    assert read_result(tmp_path / "b.npz") is None
    assert not has_result(tmp_path / "b.npz")


def test_a_file_that_cannot_be_written_leaves_nothing(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    with pytest.raises(WriteError, match="goes on from here"):
        write_whole(tmp_path / "file" / "below", b"")

    def full(_descriptor):
        raise OSError(28, "No space left on device")

    write_whole(tmp_path / "a", b"old")
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(WriteError, match="MB are free"):
        write_whole(tmp_path / "a", b"new")
    assert (tmp_path / "a").read_bytes() == b"old"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "file"]


def test_a_full_disk_is_not_reported_for_the_lock(tmp_path, small_disk):
    with (small_disk / "filling").open("wb") as file:
        os.posix_fallocate(file.fileno(), 0, shutil.disk_usage(small_disk).free)
    with pytest.raises(WriteError, match="a was not written: No space left"), lock_work(small_disk):
        write_whole(small_disk / "a", b"new")


def test_only_one_run_has_the_work_folder(tmp_path):
    other = pytest.raises(CaptureError, match=f"process {os.getpid()}")
    with lock_work(tmp_path / "work"), other, lock_work(tmp_path / "work"):
        pass
    with lock_work(tmp_path / "work"):
        pass
    (tmp_path / "file").write_text("")
    with pytest.raises(WriteError, match="cannot be written"), lock_work(tmp_path / "file" / "work"):
        pass


def test_what_is_to_be_kept_is_kept(tmp_path):
    for name in ("a/b/1", "a/2", "3"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("")
    forget(tmp_path, [tmp_path / "a" / "2"])
    assert [path.name for path in tmp_path.rglob("*")] == ["a", "2"]
    forget(tmp_path / "absent")


@pytest.fixture(scope="module")
def tasks(tmp_path_factory):
    """Three rounds, of which only the last looks at others' depth."""
    folder = tmp_path_factory.mktemp("capture")
    write_posed_photos(folder)
    settings = MvsSettings(
        sources=3,
        rounds=(
            Round(level=2, iterations=1, coherent=False),
            Round(level=1, iterations=1, coherent=False),
            Round(level=0, iterations=1, coherent=True),
        ),
    )
    prepared = prepare_views(read_capture(folder), folder / "work", settings.max_side_px)
    return plan_tasks(prepared.views, np.zeros((0, 3)), settings, folder / "work")


def test_what_is_missing_follows_from_what_is_there(tasks):
    everything = tuple(range(5))
    assert find_missing(tasks) == MissingTasks(planes=(everything,) * 3, depth=everything)
    assert len(find_missing(tasks)) == 20
    done = {"x": np.zeros(1)}
    try:
        for path in tasks.depth:
            write_result(path, done)
        assert find_missing(tasks) == MissingTasks(planes=((), (), ()), depth=())
        # The last planes are gone; those of one view take the ones before of its sources, and these their own start.
        tasks.depth[0].unlink()
        around = tuple(sorted({0, *tasks.plan.sources[0]}))
        missing = find_missing(tasks)
        assert missing.depth == (0,)
        assert missing.planes[2] == around
        assert set(missing.planes[1]) == {k for index in around for k in (index, *tasks.plan.sources[index])}
        assert missing.planes[0] == missing.planes[1]
        for path in tasks.planes[1]:
            write_result(path, done)
        assert find_missing(tasks).planes == ((), (), around)
    finally:
        forget(tasks.work / "planes")
        forget(tasks.work / "depth")


def test_results_are_named_by_what_they_are_made_of(tasks):
    def plan(**changes):
        settings = dataclasses.replace(tasks.settings, **changes)
        return plan_tasks(tasks.views, np.zeros((0, 3)), settings, tasks.work)

    agreement = dataclasses.replace(tasks.settings.agreement, max_cost=0.5)
    assert plan().depth == tasks.depth
    assert plan(agreement=agreement).planes == tasks.planes
    assert not set(plan(agreement=agreement).depth) & set(tasks.depth)
    assert not set(plan(seed=1).planes[0]) & set(tasks.planes[0])


def test_photographs_are_kept_as_they_are_matched(tasks):
    for view, pose in zip(tasks.views, poses().values(), strict=True):
        read = read_pixels(view)
        assert read.srgb.shape == (LENS.height_px, LENS.width_px, 3)
        assert not read.has_depth
        np.testing.assert_allclose(read.camera.cam_from_world, pose, atol=1e-12)


def test_blur_and_copies_are_reported_where_poses_are_given(tmp_path):
    write_posed_photos(tmp_path)
    names = sorted(path.name for path in (tmp_path / "images").iterdir())
    assert prepare_views(read_capture(tmp_path), tmp_path / "work", 1200).checks == ()
    shaken = tmp_path / "images" / names[1]
    cv2.imwrite(str(shaken), cv2.GaussianBlur(cv2.imread(str(shaken)), (0, 0), 6))
    shutil.copy(tmp_path / "images" / names[3], tmp_path / "images" / names[4])
    for _ in range(2):  # made, and found made
        blurred, copied = prepare_views(read_capture(tmp_path), tmp_path / "work", 1200).checks
        assert (blurred.code, blurred.subject) == ("photographs-blurred", names[1])
        assert (copied.code, copied.subject) == ("photograph-copies-used", f"{names[3]}, {names[4]}")


def _plane_seen(camera, normal, distance):
    """Depth of the plane normal · x = distance, in camera axes, as if it had been found."""
    depth_m = distance / (camera.rays() @ normal)
    return DepthEstimate(
        camera=camera,
        depth_m=depth_m.astype(np.float32),
        normals=np.broadcast_to(normal, (*depth_m.shape, 3)).astype(np.float32),
        confidence=np.full(depth_m.shape, 0.5, np.float32),
        agreeing=np.full(depth_m.shape, 3, np.uint8),
    )


@given(st.floats(-0.6, 0.6), st.floats(-0.6, 0.6), st.sampled_from([(128, 96), (256, 192), (200, 150), (333, 250)]))
def test_a_plane_stays_a_plane_at_any_size(slant, tilt, size):
    normal = np.array([slant, tilt, -1.0])
    normal /= np.linalg.norm(normal)
    large = LENS.pinhole(np.eye(3, 4)).resized(*size)
    estimate = _plane_seen(LENS.pinhole(np.eye(3, 4)), normal, -2.0)
    enlarged = enlarge_depth(estimate, large)
    np.testing.assert_allclose(enlarged.depth_m, _plane_seen(large, normal, -2.0).depth_m, rtol=1e-5)
    assert enlarged.normals.shape == (size[1], size[0], 3)
    assert (enlarged.confidence == 0.5).all()


def test_nothing_stays_nothing_and_edges_stay_edges():
    camera = LENS.pinhole(np.eye(3, 4))
    estimate = _plane_seen(camera, np.array([0, 0, -1.0]), -2.0)
    depth_m, normals = estimate.depth_m.copy(), estimate.normals.copy()
    depth_m[:, 40:] = 5
    depth_m[:20], normals[:20] = 0, 0
    enlarged = enlarge_depth(dataclasses.replace(estimate, depth_m=depth_m, normals=normals), camera.resized(256, 192))
    assert set(np.unique(enlarged.depth_m)) == {0, 2, 5}
    assert not enlarged.depth_m[:40].any()
    assert not enlarged.normals[:40].any()


KEYS = {"up_axis": "Y", "metres_per_unit": 1.0}


@pytest.mark.parametrize(
    "text",
    [
        "",
        'name = "a"',
        "# a comment\n\n[table]\nup_axis = 3\n",
        'note = """\n[no table]\nup_axis = 2\n"""\nmetres_per_unit = 0.1\n',
        '\ufeffname = "ö"\r\nup_axis = "Z"\r\n',
        "[[scans]]\nx = 1\n",
    ],
)
def test_only_missing_keys_are_added(text):
    completed = complete_capture_settings(text, KEYS)
    before, after = (tomllib.loads(each.removeprefix("\ufeff")) for each in (text, completed))
    assert after == {**KEYS, **before}
    assert completed.endswith(text.removeprefix("\ufeff"))
    assert completed.startswith("\ufeff") == text.startswith("\ufeff")
    assert complete_capture_settings(completed, KEYS) == completed


@given(st.text(alphabet=st.characters(exclude_categories=("Cs",)), max_size=20), st.floats(1e-9, 1e9))
def test_any_value_can_be_read_back(name, unit):
    read = tomllib.loads(complete_capture_settings("", {"name": name, "metres_per_unit": unit}))
    assert read == {"name": name, "metres_per_unit": unit}


def test_cells_are_as_large_as_the_median_view_sees():
    def maps_of(footprint_m):
        return ViewMaps(name="", files=(Path(), Path(), Path()), coverage=0.5, footprint_m=footprint_m)

    maps = [maps_of(size) for size in (0.5, 0.001, 0.002, np.nan, 0.0015)]
    assert size_cells(CloudSettings(cell_footprints=2.0), maps).cell_m == pytest.approx(0.0035)
    assert size_cells(CloudSettings(cell_m=0.1), maps).cell_m == 0.1
    assert size_cells(CloudSettings(), [maps_of(np.nan)]).cell_m is None
