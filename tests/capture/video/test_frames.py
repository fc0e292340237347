"""Frames of video files."""

import struct
from contextlib import suppress
from itertools import pairwise

import cv2
import numpy as np
import pytest
from usdfoliage.capture.folder.raster import read_raster
from usdfoliage.capture.video.choice import choose_frames
from usdfoliage.capture.video.frames import name_frame, survey_video, take_frames
from usdfoliage.capture.video.settings import VideoSettings
from usdfoliage.errors import CaptureError

from tests.support.heic_files import nclx
from tests.support.videos import HEIGHT, WIDTH, seen_from, texture, write_pan, write_video


def taken(video, folder, **settings) -> list[str]:
    folder.mkdir(exist_ok=True)
    found = take_frames(video, folder, VideoSettings(**settings))
    assert sorted(found.names) == sorted(path.name for path in folder.iterdir())
    return list(found.names)


def test_one_frame_for_each_stretch(tmp_path):
    """120 frames of 2 px each, of 320 px: 74 % of the picture, 15 stretches of 5 % and what is left."""
    calls: list[tuple[int, int]] = []
    video = write_pan(tmp_path / "pan.mp4")
    found = take_frames(video, tmp_path / "frames", progress=lambda *done: calls.append(done))
    assert len(found.names) == 15
    assert 46 <= found.looked_at <= 49  # 12 a second
    assert found.seconds == pytest.approx(119 / 30, abs=0.1)
    assert calls[-1][0] <= calls[-1][1]
    assert all(first[0] <= second[0] for first, second in pairwise(calls))
    seconds = [float(name[6:8]) * 60 + float(name[9:15]) for name in found.names]
    assert np.diff(seconds) == pytest.approx(8 / 30, abs=0.27)  # 16 px, from any place in one to any in the next


def test_frames_are_what_the_video_shows(tmp_path):
    plane = texture()
    names = taken(write_pan(tmp_path / "pan.mp4"), tmp_path / "frames")
    for name in (names[0], names[7], names[-1]):
        number = round(30 * float(name[9:15]))
        displayed = seen_from(plane, 10 + 2 * number)[..., ::-1]
        difference = read_raster(tmp_path / "frames" / name).color.astype(float) - displayed
        assert np.abs(difference).mean() < 12  # what MPEG-4 loses
        assert np.abs(difference.mean(axis=(0, 1))).max() < 3


def test_the_sharpest_is_taken(tmp_path):
    plane = texture()
    sharp = {12, 27, 42, 57, 72, 87, 102}
    frames = (
        frame if number in sharp else cv2.GaussianBlur(frame, (0, 0), 2.0)
        for number, frame in ((k, seen_from(plane, 10 + 2 * k)) for k in range(105))
    )
    names = taken(write_video(tmp_path / "a.mp4", frames), tmp_path / "frames", min_motion=0.09375, max_rate_hz=60)
    assert [round(30 * float(name[9:15])) for name in names] == sorted(sharp)


def test_the_same_video_gives_the_same_bytes(tmp_path):
    video = write_pan(tmp_path / "pan.mp4", count=60)
    first, second = (taken(video, tmp_path / name) for name in "ab")
    assert first == second
    for name in first:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_never_more_than_the_limit(tmp_path):
    found = take_frames(write_pan(tmp_path / "pan.mp4"), tmp_path, VideoSettings(max_frames=5))
    assert 4 <= len(found.names) <= 5
    assert found.stretch > 0.14


def test_a_still_camera_is_refused_with_what_was_measured(tmp_path):
    plane, rng = texture(), np.random.default_rng(0)
    frames = (seen_from(plane, 50 + rng.uniform(-2, 2), 80 + rng.uniform(-2, 2)) for _ in range(60))
    video = write_video(tmp_path / "still.mp4", frames)
    with pytest.raises(
        CaptureError, match=r"the camera of .*still\.mp4 hardly moves: .* by [01]\.\d% .* in 1\.9 s, 5\.0%"
    ):
        take_frames(video, tmp_path / "frames")
    assert not (tmp_path / "frames").exists()


def turned(video, turn: int):
    """The same file, turned by its matrix, as phones do it (ISO/IEC 14496-12, 8.3.2)."""
    a, b, c, d = {90: (0, 1, -1, 0), 180: (-1, 0, 0, -1), 270: (0, -1, 1, 0)}[turn]
    stored = bytearray(video.read_bytes())
    at = stored.index(b"tkhd") + 4 + 40
    struct.pack_into(">iiiiiiiii", stored, at, a << 16, b << 16, 0, c << 16, d << 16, 0, 0, 0, 1 << 30)
    other = video.with_name(f"{turn}.mp4")
    other.write_bytes(stored)
    return other


@pytest.mark.parametrize("turn", [90, 180, 270])
def test_a_turned_video_is_upright_once(tmp_path, turn):
    video = write_pan(tmp_path / "pan.mp4", count=30)
    upright = taken(video, tmp_path / "frames")
    names = taken(turned(video, turn), tmp_path / "turned")
    as_stored = read_raster(tmp_path / "frames" / upright[0]).color.astype(float)
    displayed = read_raster(tmp_path / "turned" / names[0]).color.astype(float)
    expected = np.rot90(as_stored, -turn // 90)  # with the clock
    assert displayed.shape == expected.shape
    assert np.abs(displayed - expected).mean() < 8  # another frame of the stretch may be the sharpest


def test_times_are_those_of_the_file_where_the_rate_varies(tmp_path):
    """Phones change their rate with the light: each frame of the second half is displayed a third as long."""
    video = write_pan(tmp_path / "pan.mp4", count=40)
    stored = bytearray(video.read_bytes())
    at = stored.index(b"stts") + 4
    count, (samples, delta) = struct.unpack_from(">I", stored, at + 4)[0], struct.unpack_from(">II", stored, at + 8)
    assert (count, samples) == (1, 40)
    changed = struct.pack(">IIIIII", 0, 2, 20, delta, 20, delta // 3)
    grown = bytes(stored[:at]) + changed + bytes(stored[at + 16 :])
    for kind in (b"moov", b"trak", b"mdia", b"minf", b"stbl", b"stts"):  # each 8 bytes longer
        place = grown.index(kind) - 4
        size = int.from_bytes(grown[place : place + 4], "big") + 8
        grown = grown[:place] + struct.pack(">I", size) + grown[place + 4 :]
    assert grown.index(b"mdat") < grown.index(b"moov")  # so that no offset changes
    (tmp_path / "slow.mp4").write_bytes(grown)
    found = survey_video(tmp_path / "slow.mp4", VideoSettings(max_rate_hz=240))
    assert found.seconds[19] == pytest.approx(19 / 30, abs=0.01)
    assert found.seconds[39] == pytest.approx(20 / 30 + 19 / 90, abs=0.01)


def test_hdr_video_becomes_srgb(tmp_path):
    """White of HLG, 75 % of its signal, becomes white."""
    plane = texture()
    level = np.full((HEIGHT, WIDTH, 3), round(0.75 * 255), np.uint8)
    frames = []
    for k in range(40):
        frame = seen_from(plane, 10 + 3 * k)
        frame[80:160, 100:220] = level[80:160, 100:220]
        frames.append(frame)
    video = write_video(tmp_path / "a.mp4", frames)
    stored = video.read_bytes()
    at = stored.index(b"mp4v") - 4
    size = int.from_bytes(stored[at : at + 4], "big")
    box = nclx(9, 18)
    grown = stored[: at + size] + box + stored[at + size :]
    for kind in (b"moov", b"trak", b"mdia", b"minf", b"stbl", b"stsd", b"mp4v"):
        place = grown.index(kind, grown.index(b"moov")) - 4
        longer = int.from_bytes(grown[place : place + 4], "big") + len(box)
        grown = grown[:place] + struct.pack(">I", longer) + grown[place + 4 :]
    (tmp_path / "hlg.mp4").write_bytes(grown)
    plain, hdr = (taken(tmp_path / name, tmp_path / name[:-4]) for name in ("a.mp4", "hlg.mp4"))
    middle = np.s_[100:140, 130:190]
    assert read_raster(tmp_path / "a" / plain[0]).color[middle].mean() == pytest.approx(191, abs=4)
    assert read_raster(tmp_path / "hlg" / hdr[0]).color[middle].mean() > 247


def test_a_video_that_is_too_long_and_one_that_is_none(tmp_path, capfd):
    video = write_pan(tmp_path / "pan.mp4")
    with pytest.raises(CaptureError, match=r"pan\.mp4 is longer than 0\.05 minutes; cut it"):
        take_frames(video, tmp_path, VideoSettings(max_minutes=0.05))
    for name, content in (("no.mp4", b"no video"), ("empty.mp4", b""), ("head.mp4", video.read_bytes()[:2000])):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(CaptureError, match=rf"{name} is not a video that can be read; copy it again"):
            take_frames(tmp_path / name, tmp_path)
    assert capfd.readouterr() == ("", "")


def test_damaged_frames_are_no_traceback_and_no_noise(tmp_path, capfd):
    stored = write_pan(tmp_path / "pan.mp4", count=60).read_bytes()
    rng = np.random.default_rng(5)
    for _ in range(12):
        damaged = bytearray(stored)
        for place in rng.integers(40, len(stored), 30):
            damaged[place] = int(rng.integers(256))
        (tmp_path / "b.mp4").write_bytes(damaged)
        with suppress(CaptureError):
            choose_frames(survey_video(tmp_path / "b.mp4"))
    assert capfd.readouterr() == ("", "")


def test_names_sort_by_time():
    assert name_frame(12.48) == "frame_00m12.480s.png"
    assert name_frame(61.0004) == "frame_01m01.000s.png"
    assert name_frame(59.9999) == "frame_01m00.000s.png"
    times_s = [0.0, 59.9, 61.0, 99 * 60.0, 5999.9996, 6001.0, 599 * 60.0]
    names = [name_frame(time_s, times_s[-1]) for time_s in times_s]
    assert names == sorted(names)
    assert names[1] == "frame_000m59.900s.png"
