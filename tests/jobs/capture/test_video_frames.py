"""The frames of a video as the photographs of a run."""

import shutil

import pytest
from usdfoliage.__main__ import main
from usdfoliage.capture.video.settings import VideoSettings
from usdfoliage.errors import CaptureError
from usdfoliage.jobs.capture import video_frames
from usdfoliage.jobs.capture.find_photographs import find_photographs
from usdfoliage.jobs.capture.video_frames import find_video, lay_frames
from usdfoliage.jobs.plant.inputs import find_inputs
from usdfoliage.jobs.plant.store import Store

from tests.support.videos import write_pan


@pytest.fixture(scope="module")
def pan(tmp_path_factory):
    return write_pan(tmp_path_factory.mktemp("video") / "pan.mp4", count=60)


@pytest.fixture
def never_again(monkeypatch):
    def refuse(*arguments, **named):
        raise AssertionError("frames are taken again")

    return lambda: monkeypatch.setattr(video_frames, "take_frames", refuse)


def test_what_is_there_is_not_done_again(pan, tmp_path, never_again):
    first = lay_frames(pan, tmp_path / "work")
    never_again()
    assert lay_frames(pan, tmp_path / "work") == first
    shutil.copy(pan, tmp_path / "renamed.mov")
    assert lay_frames(tmp_path / "renamed.mov", tmp_path / "work").folder == first.folder
    with pytest.raises(AssertionError):
        lay_frames(pan, tmp_path / "work", VideoSettings(min_motion=0.1))


def test_damaged_work_is_made_again(pan, tmp_path):
    first = lay_frames(pan, tmp_path)
    name = sorted(first.photos)[1]
    stored = first.photos[name].read_bytes()
    first.photos[name].unlink()
    assert lay_frames(pan, tmp_path).photos[name].read_bytes() == stored
    (first.folder / "frames.json").write_text("{")
    assert lay_frames(pan, tmp_path).photos == first.photos


def test_a_run_that_is_stopped_leaves_nothing_for_a_result(pan, tmp_path):
    def stop(done: int, total: int) -> None:
        if done > total - 20:  # frames are being written
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        lay_frames(pan, tmp_path, progress=stop)
    assert list(tmp_path.iterdir()) == []
    assert lay_frames(pan, tmp_path).photos


def test_a_video_is_found_in_a_capture(pan, tmp_path):
    (tmp_path / "videos").mkdir()
    with pytest.raises(CaptureError, match="has 0 videos"):
        find_video(tmp_path)
    shutil.copy(pan, tmp_path / "videos" / "walk.MP4")
    assert find_video(tmp_path) == tmp_path / "videos" / "walk.MP4"
    shutil.copy(pan, tmp_path / "videos" / "b.mov")
    with pytest.raises(CaptureError, match=r"has 2 videos: b\.mov, walk\.MP4; put one video there"):
        find_video(tmp_path)
    (tmp_path / "images").mkdir()
    assert find_video(tmp_path) is None  # photographs come first
    assert find_video(pan) == pan
    assert find_video(tmp_path / "none.mp4") is None


def test_frames_are_the_photographs_of_a_capture(pan, tmp_path):
    frames = lay_frames(pan, tmp_path / "work", VideoSettings(max_frames=4))
    with pytest.raises(
        CaptureError, match=r"pan\.mp4 is a video; name the capture to be made of it, as in .*pan_capture"
    ):
        find_photographs(pan, None, frames)
    given = find_photographs(pan, tmp_path / "out", frames)
    assert (list(given.photos), given.is_capture, given.images) == (sorted(frames.photos), False, frames.folder)
    codes = {each.code: each.text for each in given.remarks}
    assert codes["video-frames-taken"].startswith(f"{len(given.photos)} frames of 2 s of pan.mp4 are used")
    assert "more than 4 times 5.0%" in codes["video-frames-limited"]


def test_a_build_is_planned_by_the_frames(pan, tmp_path, never_again):
    capture = tmp_path / "walk"
    (capture / "videos").mkdir(parents=True)
    shutil.copy(pan, capture / "videos")
    store = Store(folder=tmp_path / "work")
    inputs = find_inputs(capture, store, digest_by="names")
    assert inputs.photographs
    assert all(path.is_file() for path in inputs.photographs.values())
    never_again()
    again = find_inputs(capture, store)
    assert again.photographs == inputs.photographs
    assert [name for name, _ in again.digests] == ["videos/pan.mp4"]
    alone = find_inputs(pan, store)  # the same bytes
    assert (alone.name, alone.photographs) == ("pan", inputs.photographs)


def test_the_commands_report_what_they_would_do(pan, tmp_path, capsys):
    assert main(["capture", str(pan), "-o", str(tmp_path / "out"), "--dry-run"]) == 0
    text = capsys.readouterr().out
    assert "poses: to be estimated" in text
    assert "frames of 2 s of pan.mp4 are used" in text
    assert not (tmp_path / "out").exists()
    assert main(["build", str(pan), "-o", str(tmp_path / "plant"), "--work", str(tmp_path / "work"), "--dry-run"]) == 0
    assert f"capture: {pan}, " in capsys.readouterr().out
    assert main(["capture", str(pan)]) == 2
    assert "name the capture to be made of it" in capsys.readouterr().err
