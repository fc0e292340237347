"""Files of users that once stopped a command: each is refused in one line, or read."""

import os
import shutil
import struct
import zlib

import cv2
import numpy as np
import pytest
from usdfoliage.asset.locate import MAX_DEPTH
from usdfoliage.files.library_text import library_text

from tests.support.cloud_files import some_points, write_text
from tests.support.leaves.commands import refused, run


@pytest.fixture(scope="module")
def spray(tmp_path_factory):
    out = tmp_path_factory.mktemp("assets") / "spray"
    assert run("scatter", "-n", 2, "-o", out) == 0
    return out


@pytest.fixture
def copy(spray, tmp_path):
    return shutil.copytree(spray, tmp_path / "copy")


def test_a_payload_that_is_a_pipe(copy, tmp_path, capsys):
    payload = copy / "payload" / "payload.usda"
    payload.unlink()
    os.mkfifo(payload)
    assert "payload.usda" in refused(capsys, "info", copy)
    assert "no regular file" in refused(capsys, "edit", copy, "--width", 2, "-o", tmp_path / "look.usda")
    assert run("validate", copy) == 3


@pytest.mark.parametrize(("layer", "name"), [("payload.usda", b"materials.usda"), ("materials.usda", b"Surface")])
def test_a_layer_that_is_no_text_where_usd_quotes_it(copy, tmp_path, capsys, layer, name):
    path = copy / "payload" / layer
    data = path.read_bytes()
    assert name in data
    path.write_bytes(data.replace(name, b"caf\xe9" + name))
    for command in (("edit", copy, "--width", 2, "-o", tmp_path / "a.usda"), ("bake", copy, "-o", tmp_path / "b")):
        complaint = refused(capsys, *command)
        assert layer in complaint
        assert "no UTF-8" in complaint
    assert run("validate", copy) == 3


def test_a_layer_that_is_a_loop(copy):
    materials = copy / "payload" / "materials.usda"
    materials.unlink()
    materials.symlink_to("materials.usda")
    assert run("validate", copy) == 3


def test_a_crate_that_lists_what_it_does_not_hold(copy, tmp_path, capsys):
    """USD ends the process where such a prim is asked for."""
    crate = copy / "payload" / "leaves.usdc"
    data = bytearray(crate.read_bytes())
    data[96:442] = bytes(346)  # its first values: the names of prims below others
    crate.write_bytes(data)
    assert "leaves.usdc" in refused(capsys, "bake", copy, "-o", tmp_path / "baked")
    assert not list(tmp_path.glob(".*usdfoliage*"))


def test_prims_too_deep_for_usd(tmp_path, capsys):
    deep = tmp_path / "deep.usda"
    deep.write_text("#usda 1.0\n" + 'def Xform "a" {\n' * (MAX_DEPTH + 1) + "}\n" * (MAX_DEPTH + 1))
    for command in ("info", "validate"):
        assert "deep" in refused(capsys, command, deep)


@pytest.mark.parametrize("name", ["a\nb", "a\tb", "a\\b", "a\x9bb", os.fsdecode(b"\xff")])
def test_names_that_usd_cannot_hold(spray, tmp_path, capsys, name):
    shutil.copytree(spray, tmp_path / name)
    assert "rename" in refused(capsys, "info", tmp_path / name)
    assert "rename" in refused(capsys, "scatter", "-n", 1, "-o", tmp_path / "out" / name)


def test_a_message_is_one_short_line(copy, tmp_path, capsys):
    payload = copy / "payload" / "payload.usda"
    payload.write_text(payload.read_text().replace("#usda 1.0\n", "#usda 1.0\n" + "x" * 100_000 + "\n"))
    assert len(refused(capsys, "edit", copy, "--width", 2, "-o", tmp_path / "look.usda")) < 1100


def test_numbers_of_many_digits_in_a_cloud(tmp_path, capsys):
    cloud = write_text(tmp_path / "a.xyz", some_points(), np.full((200, 3), 7), head="9" * 5000 + "\n")
    cloud.write_text(cloud.read_text().replace(" 7 7 7\n", " 7 7 " + "9" * 5000 + "\n"))
    run("branches", cloud, "-o", tmp_path / "out", "--dry-run")
    assert "internal fault" not in capsys.readouterr().err


@pytest.mark.parametrize("header", [(0, 32, 8, 2, 0, 0, 0), (32, 32, 3, 2, 0, 0, 0), (32, 32, 8, 2, 0, 0, 9)])
def test_the_header_of_a_png_is_checked_first(tmp_path, capfd, header):
    chunk = b"IHDR" + struct.pack(">IIBBBBB", *header)
    data = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + chunk + struct.pack(">I", zlib.crc32(chunk))
    (tmp_path / "a.png").write_bytes(data + b"\0\0\0\0IEND\xae\x42\x60\x82")
    assert run("crown", tmp_path / "a.png", "-o", tmp_path / "out", "--dry-run") == 2
    assert "libpng" not in capfd.readouterr().err


def test_impossible_cameras_are_reported_before_anything_is_written(tmp_path, capsys):
    from tests.support.capture_photos import write_posed_photos

    write_posed_photos(tmp_path / "bed")
    (tmp_path / "bed" / "cameras" / "cameras.txt").write_text("1 PINHOLE 128 96 0 0 64 48\n")
    assert "cameras.txt" in refused(capsys, "capture", tmp_path / "bed", "-o", tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", ["info", "validate"])
def test_a_texture_that_is_a_link_to_nothing(tmp_path, capsys, command):
    cv2.imwrite(str(tmp_path / "leaf.png"), np.full((8, 8, 4), 200, np.uint8))
    assert run("scatter", "-n", 2, "--texture", tmp_path / "leaf.png", "-o", tmp_path / "spray") == 0
    (texture,) = (tmp_path / "spray" / "maps").glob("*.png")
    texture.unlink()
    texture.symlink_to("nowhere.png")
    assert run(command, tmp_path / "spray") == (3 if command == "validate" else 0)
    streams = capsys.readouterr()
    assert "internal fault" not in streams.err
    assert texture.name in streams.out


def test_a_library_that_quotes_bytes_is_heard_in_one_printable_line():
    def quote() -> str:
        return b"no \xff".decode()

    assert library_text(quote) == ""
    assert library_text(lambda: "a\x1b[31m\nb") == "a\\x1b[31m b"


def test_a_run_without_memory_is_refused_in_one_line(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("usdfoliage.cli.scatter.run", lambda options: np.empty(1 << 55))
    message = refused(capsys, "scatter", "-n", 1, "-o", tmp_path / "a")
    assert "needs more memory than there is: Unable to allocate" in message
