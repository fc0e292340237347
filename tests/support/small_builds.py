"""Captures that are built in seconds, and how."""

from functools import cache
from hashlib import sha256
from pathlib import Path

from tests.support.leaves.captures import known_foliage
from tools.synthetic_foliage import write_capture

# Quick and rough, and without branches, crown and pictures: leaves by the capture's own depth.
QUICK = """
[branches]
make = "off"
[crown]
make = false
[pictures]
make = false
[tasks]
photographs_a_task = 2
[capture.depth]
max_side_px = 160
rounds = [{ level = 1, iterations = 1, coherent = false, segments = false },
          { level = 0, iterations = 1, coherent = true, segments = false }]
"""


def write_small_capture(folder: Path) -> Path:
    """Four photographs of forty leaves; returns folder."""
    write_capture(folder, _small().capture)
    return folder


@cache
def _small():
    return known_foliage(leaves=40, views=4, size=(320, 240))


def write_quick_plan(path: Path) -> Path:
    """The plan, as a file; returns path."""
    path.write_text(QUICK)
    return path


def digests(asset: Path) -> dict[str, str]:
    """The digests of all files of an asset but the one with how long it took."""
    files = [path for path in sorted(asset.rglob("*")) if path.is_file() and path.name != "timings.js"]
    return {path.relative_to(asset).as_posix(): sha256(path.read_bytes()).hexdigest() for path in files}


def spawned_by(pid: int) -> list[int]:
    """The processes that multiprocessing has started in that process."""
    below = [each for path in Path(f"/proc/{pid}/task").glob("*/children") for each in path.read_text().split()]
    return sorted(int(each) for each in below if b"spawn_main" in Path(f"/proc/{each}/cmdline").read_bytes())
