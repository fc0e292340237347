"""The product's side of the preview: what it finds, what it makes of pictures and of failures."""

import os
import stat
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.__main__ import main
from usdfoliage.errors import PreviewError, PreviewTimeoutError
from usdfoliage.jobs.preview import pictures as preview
from usdfoliage.jobs.preview import recorder
from usdfoliage.jobs.preview.pictures import (
    PreviewSettings,
    PreviewView,
    arrange_sheet,
    draw_views,
    encode_png,
    finish_picture,
    remark_missing_pictures,
    render_turntable,
    render_views,
)
from usdfoliage.jobs.preview.recorder import find_interpreter, sort_complaints
from usdfoliage.remarks import Argument


def write_interpreter(path: Path, script: str) -> Path:
    """A stand-in for the preview interpreter: a shell script called with the recorder, the request and the result."""
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return path


@pytest.fixture
def scene(tmp_path):
    file = tmp_path / "thing.usda"
    file.write_text("#usda 1.0\n")
    return file


@pytest.fixture
def interpreter(tmp_path, monkeypatch):
    def install(script: str) -> Path:
        python = write_interpreter(tmp_path / "interpreter", script)
        monkeypatch.setenv("USDFOLIAGE_HYDRA_PYTHON", str(python))
        return python

    return install


def one_view(tmp_path: Path) -> list[PreviewView]:
    return [PreviewView(output=tmp_path / "out" / "picture.png")]


# What is asked for


@pytest.mark.parametrize(
    "change",
    [
        {"width_px": 0},
        {"height_px": 15},
        {"width_px": 8193},
        {"width_px": 8000, "height_px": 8000},
        {"complexity": "extreme"},
        {"samples": 0},
        {"frame": float("nan")},
        {"background": (0.5, 0.5, 1.5)},
        {"purposes": ()},
        {"purposes": ("default", "Render")},
    ],
)
def test_settings_refuse_what_cannot_be_drawn(change):
    with pytest.raises(ValueError, match=r"must|more than"):
        PreviewSettings(**change)


def test_size_limits_are_in_the_error():
    with pytest.raises(ValueError, match=r"16 to 8192 pixels, not 12 x 960"):
        PreviewSettings(width_px=12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"direction": "behind"}, "direction"),
        ({"window": (0, 1, 0, 1)}, "orthographic"),
        ({"window": (1, 0, 0, 1), "orthographic": True}, "left, right, bottom, top"),
        ({"size_px": (3, 100)}, "pixels"),
    ],
)
def test_views_refuse_contradictions(change, message):
    with pytest.raises(ValueError, match=message):
        PreviewView(output=Path("a.png"), **change)


def test_no_views_and_short_turntables_are_refused(scene):
    with pytest.raises(ValueError, match="no views"):
        render_views(scene, [])
    with pytest.raises(ValueError, match="at least 2 frames, not 1"):
        render_turntable(scene, scene.with_name("a.png"), 1)


# What is found


def test_the_error_of_a_missing_interpreter_has_the_command_that_installs_one(tmp_path, monkeypatch):
    monkeypatch.delenv("USDFOLIAGE_HYDRA_PYTHON", raising=False)
    monkeypatch.setattr(recorder, "REPOSITORY", tmp_path)
    with pytest.raises(PreviewError, match=r"pip install bpy.*, or set USDFOLIAGE_HYDRA_PYTHON"):
        find_interpreter()
    (tmp_path / "Makefile").touch()
    with pytest.raises(PreviewError, match=r"run `make setup`, or set USDFOLIAGE_HYDRA_PYTHON"):
        find_interpreter()
    monkeypatch.setenv("USDFOLIAGE_HYDRA_PYTHON", str(tmp_path / "python"))
    with pytest.raises(PreviewError, match=r"names no program.*python"):
        find_interpreter()


def test_a_studios_interpreter_is_preferred(interpreter):
    python = interpreter("exit 0")
    assert find_interpreter() == python


# What goes wrong

ERROR = 'printf \'{"error": {"kind": "%s", "message": "%s"}}\' > "$3"; exit 1'


@pytest.mark.parametrize(
    ("script", "message"),
    [
        ("exit 1", r"ended with code 1 without a result"),
        ("echo 'bad luck' >&2; kill -SEGV $$", r"ended by SIGSEGV without a result; its last words: bad luck"),
        ("kill -KILL $$", r"SIGKILL"),
        (ERROR % ("gl", "no driver found"), r"no driver found; .*libegl1 libegl-mesa0 libgl1 libgl1-mesa-dri"),
        (ERROR % ("library", "libXi.so.6: cannot open shared object file"), r"libXi.*apt-get install libxi6"),
        (ERROR % ("library", "libodd.so.1: cannot open shared object file"), r"libodd.*make setup"),
        (ERROR % ("usd", "No module named pxr"), r"no USD with imaging.*make setup.*USDFOLIAGE_HYDRA_PYTHON"),
        (ERROR % ("camera", "no camera at /a"), r"no camera at /a \(.*thing\.usda\)"),
        (
            'echo "Warning: in F at line 3 of /f.cpp -- Failed to compile shader for prim /a." >&2; '
            + ERROR % ("draw", "Storm failed"),
            r"Storm failed; Failed to compile shader for prim /a\.",
        ),
        (
            "echo 'Error: in F -- Failed to compile shader for prim /a.' >&2; "
            'printf \'{"usd_version": "25.8", "views": [], "warnings": []}\' > "$3"',
            r"could not draw all of it: Failed to compile shader for prim /a\.",
        ),
    ],
)
def test_failures_of_the_interpreter_become_one_line(interpreter, scene, tmp_path, script, message):
    interpreter(script)
    with pytest.raises(PreviewError, match=message):
        render_views(scene, one_view(tmp_path))
    assert not (tmp_path / "out").exists()


def test_a_hanging_interpreter_is_ended(interpreter, scene, tmp_path):
    interpreter('echo $$ > "$(dirname "$0")/pid"; exec sleep 60')
    with pytest.raises(PreviewError, match=r"no picture within 0\.5 s"):
        draw_views(scene, one_view(tmp_path), PreviewSettings(stall_timeout_s=0.5))
    with pytest.raises(ProcessLookupError):
        os.kill(int((tmp_path / "pid").read_text()), 0)


def test_pictures_that_come_too_slowly_are_ended_by_the_limit_for_all_of_them(interpreter, scene, tmp_path):
    interpreter('while true; do echo "usdfoliage-frame 1 9"; sleep 0.1; done')
    settings = PreviewSettings(stall_timeout_s=30.0, time_limit_s=1.0)
    with pytest.raises(PreviewTimeoutError, match=r"did not draw all pictures within 1 s"):
        draw_views(scene, one_view(tmp_path), settings)


def test_a_preview_beyond_its_time_limit_ends_with_2(interpreter, scene, tmp_path, capsys, monkeypatch):
    follow = recorder._follow_progress
    monkeypatch.setattr(recorder, "_follow_progress", lambda process, _, *rest: follow(process, 0.5, *rest))
    interpreter("exec sleep 60")
    assert main(["preview", str(scene), "-o", str(tmp_path / "a.png")]) == 2
    complaints = capsys.readouterr().err.strip().splitlines()
    assert len(complaints) == 1
    assert complaints[0].startswith("error: Storm drew no picture within 0.5 s")
    assert not (tmp_path / "a.png").exists()


def test_an_interpreter_that_closes_its_output_and_goes_on_is_ended(interpreter, scene, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(recorder, "_TO_END_S", 0.5)
    interpreter("exec >&- 2>&-; exec sleep 60")
    assert main(["preview", str(scene), "-o", str(tmp_path / "a.png")]) == 2
    assert capsys.readouterr().err.startswith("error: ")


def test_an_interpreter_that_cannot_be_executed(tmp_path, monkeypatch, scene):
    nonsense = tmp_path / "nonsense"
    nonsense.write_bytes(b"\x7fELFnot really")
    nonsense.chmod(0o755)
    monkeypatch.setenv("USDFOLIAGE_HYDRA_PYTHON", str(nonsense))
    with pytest.raises(PreviewError, match=r"cannot be started.*nonsense"):
        draw_views(scene, one_view(tmp_path), PreviewSettings())


def test_a_missing_scene_is_named_before_anything_starts(tmp_path):
    with pytest.raises(PreviewError, match=r"no such file .*gone\.usda"):
        draw_views(tmp_path / "gone.usda", one_view(tmp_path), PreviewSettings())


def test_complaints_are_sorted_reported_once_and_noise_is_dropped():
    faults, warnings = sort_complaints(
        'Warning: In image "/tmp/x.exr" mip level 1 does not exist [python3.11]\n'
        "Warning: in _Report at line 3 of /usd/stage.cpp -- In </a>: Could not open asset @b@\n"
        "Warning: in _Report at line 3 of /usd/stage.cpp -- In </a>: Could not open asset @b@\n"
        "Warning: in _Validate at line 2 of /usd/glslProgram.cpp -- Failed to compile shader (VERTEX): 0:1(2): x\n"
        "0:2(3): error: y\n"
        "GL error: invalid framebuffer operation\n"
        "reading thing\n"
    )
    assert faults == ["Failed to compile shader (VERTEX): 0:1(2): x"]
    assert warnings == ["In </a>: Could not open asset @b@", "GL error: invalid framebuffer operation"]


# What is made of pictures


@given(alpha=st.floats(0, 1), value=st.floats(0, 1), behind=st.floats(0, 1))
@settings(max_examples=40, deadline=None)
def test_compositing_is_linear(alpha, value, behind):
    picture = np.array([[[value * alpha] * 3 + [alpha]]], np.float32)
    seen = finish_picture(picture, (behind,) * 3)[0, 0, 0] / 255.0
    mixed = preview.decode_srgb(behind) * (1 - alpha) + value * alpha
    assert seen == pytest.approx(float(preview.encode_srgb(mixed)), abs=0.5 / 255 + 1e-5)


def test_transparent_pictures_keep_straight_colours():
    picture = np.array([[[0.09, 0.09, 0.09, 0.5], [0, 0, 0, 0]]], np.float32)
    finished = finish_picture(picture, None)
    assert finished.tolist() == [[[118, 118, 118, 128], [0, 0, 0, 0]]]


def test_the_contact_sheet_has_rows_and_columns_in_reading_order():
    pictures = [np.full((20, 30, 4), number, np.float32) for number in range(1, 6)]
    sheet = arrange_sheet(pictures)
    assert sheet.shape == (40, 90, 4)
    assert sheet[10::20, 15::30, 0].tolist() == [[1, 2, 3], [4, 5, 0]]


def test_a_wide_contact_sheet_is_shrunk():
    sheet = arrange_sheet([np.ones((500, 1000, 4), np.float32)] * 4)
    assert sheet.shape == (960, 1920, 4)
    np.testing.assert_allclose(sheet, 1, atol=1e-6)


def test_png_keeps_every_pixel():
    picture = np.arange(4 * 5 * 4, dtype=np.uint8).reshape(4, 5, 4)
    back = cv2.imdecode(np.frombuffer(encode_png(picture), np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(cv2.cvtColor(back, cv2.COLOR_BGRA2RGBA), picture)


def test_the_remark_on_missing_pictures_keeps_the_remedy_for_the_front_end():
    missing = remark_missing_pictures(PreviewError("there is no interpreter", ("give ", Argument(name="force"))))
    assert missing.text == "no pictures of the asset: there is no interpreter"
    assert missing.remedy == ("give ", Argument(name="force"))
