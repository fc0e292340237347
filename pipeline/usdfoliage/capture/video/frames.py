"""The frames of a video file that are taken as photographs, found and written.

The file is read twice: once to measure each frame at a small size, and once to write the chosen ones. So no more than
one frame is in memory at a time.
"""

import logging
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.folder.boxes import find_box, list_boxes, read_top_box
from usdfoliage.capture.folder.coded_color import CodedColor, linear_from_coded, read_coded_color
from usdfoliage.capture.folder.ffmpeg import open_frames, require_ffmpeg
from usdfoliage.capture.folder.photo_set import measure_sharpness
from usdfoliage.capture.folder.raster import MIN_SIDE_PX
from usdfoliage.capture.video.choice import SurveyedVideo, choose_frames
from usdfoliage.capture.video.motion import SIDE_PX, MotionFollower
from usdfoliage.capture.video.settings import VideoSettings
from usdfoliage.errors import CaptureError
from usdfoliage.files.atomic import replace_file
from usdfoliage.geometry.color import encode_srgb
from usdfoliage.progress import Progress
from usdfoliage.remarks import Setting

logger = logging.getLogger(__name__)

MAX_FRAME_PIXELS = 70_000_000  # 8K twice; a frame is in memory a few times
_SHARPNESS_SIDE_PX = 960
_MAX_MOVIE_BYTES = 1 << 28  # tables of a file: an hour has a few megabytes
_VISUAL_ENTRY_BYTES = 78  # of a sample entry, before its boxes (ISO/IEC 14496-12, 12.1.3)
_PNG = (cv2.IMWRITE_PNG_COMPRESSION, 3)


@dataclass(frozen=True, kw_only=True)
class TakenFrames:
    """What was taken of a video."""

    names: tuple[str, ...]  # of the files, in the order of time
    looked_at: int  # frames
    seconds: float  # that the video takes
    stretch: float  # share of the picture that each frame stands for; more than min_motion where there were too many


def take_frames(
    video: Path, folder: Path, settings: VideoSettings = VideoSettings(), progress: Progress | None = None
) -> TakenFrames:
    """Write the chosen frames of a video as PNG, upright, sRGB, named by their times.

    Args:
        video: The file, of any kind that FFmpeg reads.
        folder: Where they are written.
        settings: Which are chosen.
        progress: Called with frames read and their number, both passes together.

    Raises:
        CaptureError: The file is no video that can be read, too large or too long, or its camera does not move.
        OSError: A frame cannot be written.
    """
    color = _read_color(video)
    surveyed = survey_video(video, settings, None if progress is None else lambda done, of: progress(done, 2 * of))
    chosen = choose_frames(surveyed, settings)
    if len(chosen.places) < 2:
        raise CaptureError(
            f"the camera of {video} hardly moves: what it shows moves by {np.ptp(surveyed.motion):.1%} of the picture "
            f"in {surveyed.seconds[-1]:.1f} s, {settings.min_motion:.1%} are needed between two frames",
            ("walk around the plant while you film, or lower ", Setting(name="capture.video.min_motion")),
        )
    wanted = dict(zip(surveyed.numbers[chosen.places].tolist(), surveyed.seconds[chosen.places].tolist(), strict=True))
    total = int(surveyed.numbers[-1]) + 1
    names = []
    for number, frame in _read_numbers(video, frozenset(wanted)):
        name = name_frame(wanted[number], float(surveyed.seconds[-1]))
        done, png = cv2.imencode(".png", _as_srgb(frame, color)[..., ::-1], _PNG)
        if not done:
            raise CaptureError(f"frame {number} of {video} cannot be written as PNG")
        with replace_file(folder / name) as new:
            new.write_bytes(png.tobytes())
        names.append(name)
        if progress is not None:
            progress(total + number + 1, 2 * total)
    if len(names) != len(wanted):
        raise CaptureError(f"{video} gives other frames when it is read again", "copy it again")
    logger.info("%s: %d of %d frames", video, len(names), len(surveyed.numbers))
    return TakenFrames(
        names=tuple(names),
        looked_at=len(surveyed.numbers),
        seconds=float(surveyed.seconds[-1]),
        stretch=chosen.stretch,
    )


def name_frame(seconds: float, length_s: float = 0.0) -> str:
    """The file of a frame, by its time: frame_00m12.480s.png. Names of one video, which is so long, sort by time."""
    minutes, rest = divmod(round(1000 * seconds), 60_000)
    digits = max(2, len(str(round(1000 * length_s) // 60_000)))
    return f"frame_{minutes:0{digits}d}m{rest // 1000:02d}.{rest % 1000:03d}s.png"


def survey_video(
    video: Path, settings: VideoSettings = VideoSettings(), progress: Progress | None = None
) -> SurveyedVideo:
    """Measure the frames of a video, at most max_rate_hz a second.

    Raises:
        CaptureError: As take_frames, but for a camera that does not move.
    """
    numbers: list[int] = []
    seconds: list[float] = []
    motion: list[float] = []
    sharpness: list[float] = []
    follower = MotionFollower(settings.min_motion)
    require_ffmpeg(video)
    with open_frames(video) as capture:
        if capture is None:
            raise CaptureError(
                f"{video} is not a video that can be read", "copy it again, or convert it to MP4 with H.264 or H.265"
            )
        _check_frame_size(
            video, int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)), int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
        )
        rate_hz = capture.get(cv2.CAP_PROP_FPS)
        rate_hz = rate_hz if 0.1 <= rate_hz <= 1000 else 30.0
        stated = capture.get(cv2.CAP_PROP_FRAME_COUNT)
        expected = int(stated) if 0 < stated < 1e9 else 0
        number, size, due_s = -1, None, 0.0
        while capture.grab():
            number += 1
            time_s = _time_s(capture, number, rate_hz, seconds[-1] if seconds else -1.0)
            if time_s > 60 * settings.max_minutes:
                raise CaptureError(
                    f"{video} is longer than {settings.max_minutes:g} minutes",
                    ("cut it, or set ", Setting(name="capture.video.max_minutes")),
                )
            if progress is not None:
                progress(number + 1, max(expected, number + 1))
            if time_s < due_s - 1e-3:
                continue
            due_s = max(due_s, time_s - 1 / settings.max_rate_hz) + 1 / settings.max_rate_hz
            there, frame = capture.retrieve()
            if not there or frame is None:
                continue
            _check_frame_size(video, frame.shape[1], frame.shape[0])
            if size is None:
                size = frame.shape
            if frame.shape != size:
                raise CaptureError(f"the frames of {video} have several sizes", "cut it where the size changes")
            gray = _reduced(cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY), _SHARPNESS_SIDE_PX)
            numbers.append(number)
            seconds.append(time_s)
            sharpness.append(measure_sharpness(gray))
            motion.append(follower.add(_reduced(gray, SIDE_PX)))
    if not numbers:
        raise CaptureError(f"no frame of {video} can be read", "copy it again, or convert it to MP4")
    return SurveyedVideo(
        numbers=np.array(numbers, np.int64),
        seconds=np.array(seconds),
        motion=np.maximum.accumulate(np.array(motion)),
        sharpness=np.array(sharpness),
    )


def _check_frame_size(video: Path, width: int, height: int) -> None:
    if width * height > MAX_FRAME_PIXELS:
        raise CaptureError(
            f"{video} states frames of {width}×{height} pixels; at most {MAX_FRAME_PIXELS / 1e6:.0f} million are read",
            "reduce it",
        )
    if min(width, height) < MIN_SIDE_PX:
        raise CaptureError(f"{video} has frames of {width}×{height} pixels; at least {MIN_SIDE_PX} a side are needed")


def _time_s(capture: Any, number: int, rate_hz: float, last_s: float) -> float:
    """When the frame is shown, as the file states it: phones film at rates that vary. Times rise by 1 ms at least."""
    stated_s = capture.get(cv2.CAP_PROP_POS_MSEC) / 1000
    if not math.isfinite(stated_s) or stated_s < 0 or (stated_s == 0 and number):
        stated_s = number / rate_hz
    return max(stated_s, last_s + 0.001, 0.0)


def _read_numbers(video: Path, numbers: frozenset[int]) -> Iterator[tuple[int, NDArray[np.uint8]]]:
    """These frames (H, W, 3), red, green, blue, with their numbers."""
    last = max(numbers)
    with open_frames(video) as capture:
        number = -1
        while capture is not None and number < last and capture.grab():
            number += 1
            if number in numbers:
                there, frame = capture.retrieve()
                if there and frame is not None:
                    yield number, np.asarray(frame[..., ::-1])


def _reduced(gray: NDArray[Any], side_px: int) -> NDArray[np.uint8]:
    longest = max(gray.shape)
    if longest <= side_px:
        return np.asarray(gray, np.uint8)
    size = [max(1, round(side * side_px / longest)) for side in gray.shape[::-1]]
    return np.asarray(cv2.resize(gray, size, interpolation=cv2.INTER_AREA), np.uint8)


def _as_srgb(frame: NDArray[np.uint8], color: CodedColor) -> NDArray[np.uint8]:
    if color.is_srgb:
        return frame
    linear = linear_from_coded(frame / np.float32(255), color)
    return np.rint(255 * encode_srgb(np.clip(linear, 0, 1))).astype(np.uint8)


def _read_color(video: Path) -> CodedColor:
    """How colours are coded, as MP4 and MOV state it; FFmpeg has turned Y, Cb and Cr into red, green and blue."""
    try:
        movie = read_top_box(video, b"moov", _MAX_MOVIE_BYTES)
        for track in list_boxes(movie) if movie else ():
            if track.kind != b"trak" or movie is None:
                continue
            table = find_box(movie, (b"mdia", b"minf", b"stbl", b"stsd"), track.start, track.end)
            for entry in list_boxes(movie, table.start + 8, table.end) if table is not None else ():
                start = entry.start + _VISUAL_ENTRY_BYTES
                for box in list_boxes(movie, start, entry.end) if start < entry.end else ():
                    color = read_coded_color(movie[box.start : box.end]) if box.kind == b"colr" else None
                    if color is not None:
                        return color
    except (ValueError, OSError) as error:  # also of files without boxes
        logger.info("%s: no colour stated (%s)", video, error)
    return CodedColor()
