"""Damage to a file's bytes, text and place: what a disk, a network, an exporter or an ill-meaning hand does to it."""

import os
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np

Mutate = Callable[[bytes, np.random.Generator], bytes]

_NUMBER = re.compile(rb"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?![\w.])")
_NASTY_NUMBERS = (
    *(b"nan", b"-nan", b"inf", b"-inf", b"1e400", b"-1e308", b"1e-320", b"0", b"-0.0", b"-1", b"1e38", b"1_000"),
    *(
        b"2147483648",
        b"-2147483649",
        b"4294967296",
        b"18446744073709551616",
        b"9" * 40,
        b"9" * 5000,
        b"",
        b"x",
        b"0x7f",
    ),
    *(b"1,5", b"--1", b"1e", "٣".encode(), b"1e999999999", b"true"),
)
_NASTY_VALUES = (
    *(b"nan", b"inf", b"-inf", b"-1", b"0", b"9" * 400, b"9" * 5000, b"1e308", b"true", b'""', b'"auto"', b"'x'"),
    *(b"[]", b"{}", b"[[]]", b"[nan, nan, nan]", b'["a", 1]', b"{ a = 1 }", b"1979-05-27", b"07:32:00", b'"\\u0000"'),
    *(b"[" * 2000 + b"]" * 2000, b"{a=" * 2000 + b"1" + b"}" * 2000, b'"' + b"x" * 100_000 + b'"', b'"a\\nb"', b""),
    *("\u202e\U0001f333".join('""').encode(), b'"../../../etc/passwd"', b"[1, 2, 3]", b"0.5", b'"1.0"', b"-0.0"),
)
_NASTY_INTEGERS = (0, 1, -1, 2, 127, 255, 65535, 2**31 - 1, -(2**31), 2**31 - 16, 60_000, 10**9)
_NASTY_FLOATS = (float("nan"), float("inf"), -float("inf"), 1e300, -1e300, 5e-324, 0.0, -1.0)
_NOT_UNICODE = (b"\xff\xfe", b"\x80", b"\xc3\x28", b"\xed\xa0\x80", b"\0", b"\xf0\x9f\x8c", b"\x1a", b"\r", b"\x0b")


def _place(data: bytes, rng: np.random.Generator) -> int:
    """Where damage falls: half of it on the first bytes, where formats have what they promise."""
    if not data:
        return 0
    return int(rng.integers(min(len(data), 256) if rng.random() < 0.5 else len(data)))


def flip_bits(data: bytes, rng: np.random.Generator) -> bytes:
    changed = bytearray(data)
    for _ in range(int(rng.integers(1, 9))):
        if changed:
            changed[_place(data, rng)] ^= 1 << int(rng.integers(8))
    return bytes(changed)


def set_bytes(data: bytes, rng: np.random.Generator) -> bytes:
    changed = bytearray(data)
    for _ in range(int(rng.integers(1, 30))):
        if changed:
            changed[_place(data, rng)] = int(rng.choice((0, 255, 128, int(rng.integers(256)))))
    return bytes(changed)


def truncate(data: bytes, rng: np.random.Generator) -> bytes:
    end = rng.choice((int(rng.integers(1, max(2, len(data)))), len(data) - 1, len(data) // 2, min(len(data), 9)))
    return data[: max(1, int(end))]


def remove_block(data: bytes, rng: np.random.Generator) -> bytes:
    at = _place(data, rng)
    return data[:at] + data[at + int(rng.integers(1, 200)) :]


def insert_block(data: bytes, rng: np.random.Generator) -> bytes:
    at = _place(data, rng)
    return data[:at] + rng.bytes(int(rng.integers(1, 200))) + data[at:]


def repeat_block(data: bytes, rng: np.random.Generator) -> bytes:
    at = _place(data, rng)
    end = at + int(rng.integers(1, 500))
    return data[:end] + data[at:end] * int(rng.integers(1, 20)) + data[end:]


def repeat_aligned_block(data: bytes, rng: np.random.Generator) -> bytes:
    """64 bytes twice, at a place where crates have numbers: counts and offsets then lead to others."""
    at = int(rng.integers(max(1, len(data) // 8))) * 8
    return data[: at + 64] + data[at:]


def clear_block(data: bytes, rng: np.random.Generator) -> bytes:
    at = _place(data, rng)
    end = min(len(data), at + int(rng.integers(4, 400)))
    return data[:at] + bytes([int(rng.choice((0, 255)))]) * (end - at) + data[end:]


def swap_blocks(data: bytes, rng: np.random.Generator) -> bytes:
    first, second, third = sorted(_place(data, rng) for _ in range(3))
    return data[:first] + data[second:third] + data[first:second] + data[third:]


def set_integer(data: bytes, rng: np.random.Generator) -> bytes:
    size = int(rng.choice((2, 4, 8)))
    value = int(rng.choice(_NASTY_INTEGERS)) % 256**size
    return _overwrite(data, value.to_bytes(size, str(rng.choice(("little", "big")))), rng)


def set_float(data: bytes, rng: np.random.Generator) -> bytes:
    kind = str(rng.choice(("<f4", "<f8", ">f4", ">f8")))
    with np.errstate(over="ignore"):
        return _overwrite(data, np.array([rng.choice(_NASTY_FLOATS)]).astype(kind).tobytes(), rng)


def append_bytes(data: bytes, rng: np.random.Generator) -> bytes:
    return data + rng.bytes(int(rng.integers(1, 3000)))


def set_number(data: bytes, rng: np.random.Generator) -> bytes:
    """Other numbers in text."""
    found = list(_NUMBER.finditer(data))
    for _ in range(int(rng.integers(1, 4))):
        if found:
            one = found.pop(int(rng.integers(len(found))))
            data = data[: one.start()] + _choose(_NASTY_NUMBERS, rng) + data[one.end() :]
            found = [other for other in found if other.end() <= one.start()]
    return data


def set_value(data: bytes, rng: np.random.Generator) -> bytes:
    """Another value, of any type, for a key of TOML."""
    found = list(re.finditer(rb"(?m)= *([^\n]*)$", data))
    if not found:
        return data + b"\nkey = " + _choose(_NASTY_VALUES, rng)
    one = found[int(rng.integers(len(found)))]
    return data[: one.start(1)] + _choose(_NASTY_VALUES, rng) + data[one.end(1) :]


def add_line(data: bytes, rng: np.random.Generator) -> bytes:
    """A line that is there twice, or one that is none."""
    lines = data.split(b"\n")
    new = (
        *(
            lines[int(rng.integers(len(lines)))],
            b"[a" + b".a" * 3000 + b"]",
            b"x = 1",
            b"[[a]]",
            b"[a",
            b"\xff\xfe\x00",
        ),
        *(b"a" * 200_000, b'"\xc3\x28" = 1', b"0 " * 5000, b"{" * 3000, b"[" * 3000, b"# " + b"\x80" * 9),
    )
    lines.insert(int(rng.integers(len(lines) + 1)), _choose(new, rng))
    return b"\n".join(lines)


def remove_line(data: bytes, rng: np.random.Generator) -> bytes:
    lines = data.split(b"\n")
    del lines[int(rng.integers(len(lines)))]
    return b"\n".join(lines)


def mix_lines(data: bytes, rng: np.random.Generator) -> bytes:
    lines = data.split(b"\n")
    return b"\n".join(lines[index] for index in rng.permutation(len(lines)))


def remove_word(data: bytes, rng: np.random.Generator) -> bytes:
    words = re.split(rb"(\s+)", data)
    words[int(rng.integers(len(words)))] = b""
    return b"".join(words)


def repeat_word(data: bytes, rng: np.random.Generator) -> bytes:
    words = re.split(rb"(\s+)", data)
    words[int(rng.integers(len(words)))] *= int(rng.integers(2, 50))
    return b"".join(words)


def add_no_unicode(data: bytes, rng: np.random.Generator) -> bytes:
    at = _place(data, rng)
    return data[:at] + _choose(_NOT_UNICODE, rng) + data[at:]


def encode_utf16(data: bytes, rng: np.random.Generator) -> bytes:
    return data.decode("latin-1").encode(str(rng.choice(("utf-16", "utf-16-le", "utf-8-sig", "utf-32"))))


BYTES: tuple[Mutate, ...] = (
    *(flip_bits, set_bytes, truncate, remove_block, insert_block, repeat_block, clear_block, swap_blocks),
    *(set_integer, set_float, append_bytes, repeat_aligned_block),
)
TEXT: tuple[Mutate, ...] = (
    *(set_number, add_line, remove_line, remove_word, repeat_word, mix_lines, add_no_unicode, encode_utf16),
    *(set_number, truncate, flip_bits, remove_block),
)
TOML: tuple[Mutate, ...] = (
    set_value,
    set_value,
    set_value,
    add_line,
    set_number,
    remove_word,
    add_no_unicode,
    truncate,
)


def make_empty(path: Path) -> None:
    path.write_bytes(b"")


def make_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def make_loop(path: Path) -> None:
    path.unlink()
    path.symlink_to(path.name)


def make_dangling(path: Path) -> None:
    path.unlink()
    path.symlink_to("nowhere")


def make_pipe(path: Path) -> None:
    """Whoever opens it waits for ever."""
    path.unlink()
    os.mkfifo(path)


def make_endless(path: Path) -> None:
    path.unlink()
    path.symlink_to("/dev/zero")


def make_forbidden(path: Path) -> None:
    """Unreadable, but to root."""
    path.chmod(0)


def make_absent(path: Path) -> None:
    path.unlink()


def make_text(path: Path) -> None:
    path.write_text("Thumbs.db is no photograph, and no cloud.\n")


def make_zeros(path: Path) -> None:
    path.write_bytes(bytes(max(64, path.stat().st_size)))


def make_noise(path: Path) -> None:
    path.write_bytes(np.random.default_rng(0).bytes(max(64, path.stat().st_size)))


PLACES: tuple[Callable[[Path], None], ...] = (
    *(make_empty, make_folder, make_loop, make_dangling, make_pipe, make_endless, make_forbidden, make_absent),
    *(make_text, make_zeros, make_noise),
)


def _overwrite(data: bytes, new: bytes, rng: np.random.Generator) -> bytes:
    at = _place(data, rng)
    return data[:at] + new + data[at + len(new) :]


def _choose(choices: tuple[bytes, ...], rng: np.random.Generator) -> bytes:
    return choices[int(rng.integers(len(choices)))]
