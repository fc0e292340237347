"""Commands that run on another date, in another folder, with another home and time zone, without waiting for it."""

import os
import subprocess
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path

_SOURCE = Path(__file__).with_name("other_day.c")


def compile_clock(folder: Path) -> Path:
    """The library that moves the clocks of the programs that it is loaded into."""
    library = folder / "other_day.so"
    subprocess.run(["cc", "-O1", "-shared", "-fPIC", "-o", library, _SOURCE, "-ldl"], check=True)
    return library


def run_on(days: int, clock: Path, folder: Path, *words: object) -> None:
    """Run usdfoliage in a folder, so many days from now; fails where the command does."""
    for name in ("home", "tmp"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    environment = {
        **os.environ,
        "LD_PRELOAD": str(clock),
        "USDFOLIAGE_TEST_DAYS": str(days),
        "HOME": str(folder / "home"),
        "TMPDIR": str(folder / "tmp"),
        "TZ": "UTC" if days % 2 else "Asia/Kolkata",
        "PYTHONHASHSEED": str(days % 1000),
    }
    command = [sys.executable, "-m", "usdfoliage", *map(str, words)]
    ended = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr


def date_seen(days: int, clock: Path) -> timedelta:
    """How far the clocks of a program are moved."""
    words = [sys.executable, "-c", "import datetime; print(datetime.datetime.now(datetime.UTC).isoformat())"]
    environment = {**os.environ, "LD_PRELOAD": str(clock), "USDFOLIAGE_TEST_DAYS": str(days)}
    ended = subprocess.run(words, env=environment, capture_output=True, text=True, check=True)
    return datetime.fromisoformat(ended.stdout.strip()) - datetime.now(UTC)
