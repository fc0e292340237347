"""What libraries print, and names with control characters, do not reach a terminal, in any command."""

import subprocess
import sys
import zlib

import cv2
import numpy as np
import pytest

from tests.support.captures import write_depth

PROGRAM = [sys.executable, "-m", "usdfoliage"]


def end(*words):
    return subprocess.run([*PROGRAM, *map(str, words)], capture_output=True, check=False)


@pytest.fixture
def noisy_png(tmp_path):
    """A picture whose chunks are whole, and whose pixels libpng cannot unpack, which it prints."""
    path = tmp_path / "oak.png"
    cv2.imwrite(str(path), np.random.default_rng(0).integers(0, 255, (48, 48, 3), np.uint8))
    data = path.read_bytes()
    at = data.index(b"IDAT")
    length = int.from_bytes(data[at - 4 : at], "big")
    chunk = b"IDAT" + data[at + 4 : at + 40] + bytes(length - 36)
    path.write_bytes(data[:at] + chunk + zlib.crc32(chunk).to_bytes(4, "big") + data[at + 8 + length :])
    return path


def test_a_library_that_prints_is_not_heard(noisy_png, tmp_path):
    inside = f"from usdfoliage.__main__ import main; main(['crown', {str(noisy_png)!r}, '-o', {str(tmp_path / 'a')!r}])"
    raw = subprocess.run([sys.executable, "-c", inside], capture_output=True, check=False)
    assert b"libpng" in raw.stderr
    ended = end("crown", noisy_png, "-o", tmp_path / "a")
    assert ended.returncode == 2
    assert ended.stderr.startswith(b"error: ")
    assert ended.stderr.count(b"\n") == 1
    assert b"libpng error" not in ended.stdout


def divert(program):
    script = f"import os, sys\nfrom usdfoliage.cli.noise import divert_libraries\nnoise = divert_libraries()\n{program}"
    return subprocess.run([sys.executable, "-c", script], capture_output=True, check=False, timeout=60)


def test_only_what_the_command_prints_comes_out():
    ended = divert(
        "os.write(2, b'libpng error: \\x1b[31mIDAT\\n'); os.write(1, b'exr\\n')\n"
        "print('good'); print('bad', file=sys.stderr); print(noise.lines(), file=sys.stderr)"
    )
    assert (ended.returncode, ended.stdout) == (0, b"good\n")
    assert ended.stderr == b"bad\n" + str(["libpng error: \\x1b[31mIDAT", "exr"]).encode() + b"\n"


def test_an_exception_that_compiled_code_prints_is_not_heard():
    """As USD does while it unpacks a damaged crate; one that ends the process is heard."""
    ended = divert(
        "import ctypes\n"
        "assert ctypes.pythonapi.PyRun_SimpleString(b'1 +') == -1\n"
        "print(*noise.lines()[-1:])\n"
        "noise._take = lambda: None\n"  # nobody reads, and the pipe is full
        "import threading\n"
        "try:\n  while True: os.write(2, b'x' * 4096)\nexcept BlockingIOError: pass\n"
        "assert ctypes.pythonapi.PyRun_SimpleString(b'1 +') == -1\n"
        "raise KeyError('ours')"
    )
    assert (ended.returncode, ended.stdout.partition(b":")[0], ended.stderr.count(b"SyntaxError")) == (
        1,
        b"SyntaxError",
        0,
    )
    assert ended.stderr.endswith(b"KeyError: 'ours'\n")


def test_warnings_of_python_modules_are_not_heard():
    ended = divert(
        "import numpy as np\nimport warnings\n"
        "np.float64(1e300) * np.float64(1e300)\nwarnings.warn('old', UserWarning)\n"
        "print(*(line for line in noise.lines() if 'Warning' in line), sep='\\n')"
    )
    assert (ended.returncode, ended.stderr) == (0, b"")
    assert [line.split(b":")[2] for line in ended.stdout.splitlines()] == [b" RuntimeWarning", b" UserWarning"]


def test_a_library_that_prints_much_neither_waits_nor_takes_memory():
    """It prints while Python stands still, as one that does not release Python's lock."""
    ended = divert(
        "import ctypes\nwrite = ctypes.PyDLL(None).write\n"
        "for _ in range(4000): write(2, b'x' * 4096, 4096)\n"
        "print(len(''.join(noise.lines())) <= 65536)"
    )
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, b"True\n", b"")


def test_names_are_printable_on_stdout():
    ended = divert(r"print('a\x1b[31m\u202e\x9b2J' + os.fsdecode(b'\xff'), 'b\tc\nd', '木')")
    assert ended.stdout.decode() == "a\\x1b[31m\\u202e\\x9b2J\\xff b\tc\nd 木\n"


def test_a_result_line_names_its_file_without_control_characters(tmp_path):
    folder = tmp_path / "\x1b[31m"
    (folder / "tasks").mkdir(parents=True)
    ended = end("work", folder)
    assert ended.returncode == 0
    assert b"\\x1b[31m" in ended.stdout
    assert b"\x1b" not in ended.stdout + ended.stderr


def test_the_noise_of_an_image_that_is_damaged_is_one_message(tmp_path):
    write_depth(tmp_path / "oak.exr", np.ones((32, 32)))
    data = bytearray((tmp_path / "oak.exr").read_bytes())
    data[40:60] = b"\x1b]0;owned\x07" * 2
    (tmp_path / "oak.exr").write_bytes(bytes(data))
    ended = end("crown", tmp_path / "oak.exr", "-o", tmp_path / "out")
    assert ended.returncode == 2
    assert ended.stderr.startswith(b"error: ")
    assert ended.stderr.count(b"\n") == 1
    assert not {0x1B, 0x07} & set(ended.stderr + ended.stdout)


def test_verbose_shows_what_libraries_print(noisy_png, tmp_path):
    ended = end("crown", noisy_png, "-o", tmp_path / "a", "-v")
    assert b"INFO: library: libpng" in ended.stderr
    assert b"\x1b" not in ended.stderr + ended.stdout
    assert all(line.startswith((b"INFO: ", b"WARNING: ", b"error: ")) for line in ended.stderr.splitlines())
