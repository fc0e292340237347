"""Work in child processes that may fail or crash: the item at which one of them ended is reported, the rest is done."""

import json
import logging
import os
import shutil
import signal
import subprocess
import sys
import threading
import uuid
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from usdfoliage.errors import CaptureError
from usdfoliage.files.children import bound_command
from usdfoliage.files.free_space import is_full_disk, require_space
from usdfoliage.files.npz import find_damage
from usdfoliage.progress import Progress

logger = logging.getLogger(__name__)

JOB = ".job-"  # begins the names of what only a running child needs
MODULE = "usdfoliage.capture.poses.worker"
# A process that ends by one of these was killed from outside, where it does not happen each time.
_FROM_OUTSIDE = (-signal.SIGKILL, -signal.SIGTERM, -signal.SIGINT, -signal.SIGHUP)
_MAX_TRIES = 3  # of an item whose process is killed from outside
_ENDS = ("done", "failed", "full-disk")  # what a worker reports of an item, as the first word of a line
_SINGLE_THREADED = {f"{library}_NUM_THREADS": "1" for library in ("OPENBLAS", "OMP", "MKL")}


@dataclass(frozen=True, kw_only=True)
class ItemFailure:
    """An item that was not done."""

    number: int
    reason: str
    is_full_disk: bool = False  # whether there was no room for it


def run_items(
    job: Mapping[str, Any],
    items: Sequence[Mapping[str, Any]],
    work: Path,
    processes: int,
    progress: Progress | None = None,
    module: str = MODULE,
) -> tuple[ItemFailure, ...]:
    """Do the items of a job, each in one of so many child processes; an item whose "out" exists is done already.

    An item at which a child ends is a failure, unless the child was killed from outside: then it is tried again. A new
    child does the items that were left.

    Args:
        job: What the worker is given besides its items.
        items: Each with the file that it makes, "out".
        work: Where the jobs are written; one call at a time. What killed ones left there goes.
        processes: How many child processes run at once, at most.
        progress: Called with items done, or with steps of the only item.
        module: The worker.

    Raises:
        WriteError: The work folder cannot be written or is full; no child can be started.
    """
    _remove_leftovers(work)
    open_items = [(number, item) for number, item in enumerate(items) if not _is_done(Path(item["out"]))]
    shares = [open_items[start::processes] for start in range(max(1, processes))]
    events: SimpleQueue[tuple[str, int, str]] = SimpleQueue()
    done = len(items) - len(open_items)
    if progress is not None:
        progress(done, len(items))
    with ThreadPoolExecutor(max(1, processes)) as pool:
        stop = threading.Event()
        running = [pool.submit(_do_share, job, share, work, module, events, stop) for share in shares if share]
        try:
            failures = _follow(events, len(running), done, len(items), progress)
        except BaseException:  # an interrupt, or what progress raised: nothing goes on behind it
            stop.set()
            raise
        for share_run in running:
            share_run.result()  # what it raised
    if any(failure.is_full_disk for failure in failures):
        raise _full(work)
    return tuple(sorted(failures, key=lambda failure: failure.number))


def _remove_leftovers(work: Path) -> None:
    for left in work.glob(f"{JOB}*"):
        if left.is_dir() and not left.is_symlink():
            shutil.rmtree(left, ignore_errors=True)
        else:
            with suppress(OSError):  # it is no obstacle
                left.unlink()


def _check_space(work: Path) -> None:
    """A child that ended without a line about its item may have ended on a full disk, which only a trial finds out.

    Raises:
        CaptureError: There is no room.
        OSError: Nothing can be written for another reason.
    """
    try:
        require_space(work)
    except OSError as error:
        if is_full_disk(error):
            raise _full(work) from error
        raise


def _full(work: Path) -> CaptureError:
    return CaptureError(f"{work} has no space left", "free some and start again: what is done is kept")


def _is_done(path: Path) -> bool:
    """Whether a result is there and whole; one that is damaged is removed."""
    if not path.is_file():
        return False
    damage = find_damage(path) if path.suffix == ".npz" else None
    if damage is not None:
        logger.warning("%s is damaged (%s) and is made again", path, damage)
        path.unlink()
    return damage is None


def _follow(
    events: "SimpleQueue[tuple[str, int, str]]",
    shares: int,
    done: int,
    total: int,
    progress: Progress | None,
) -> list[ItemFailure]:
    """The failures, when every share has ended."""
    failures = []
    while shares:
        kind, number, text = events.get()
        if kind == "end":
            shares -= 1
        elif kind == "step" and progress is not None:
            progress(number, int(text))
        elif kind in _ENDS:
            done += 1
            if kind != "done":
                failures.append(ItemFailure(number=number, reason=text, is_full_disk=kind == "full-disk"))
            if progress is not None:
                progress(done, total)
    return failures


def _do_share(
    job: Mapping[str, Any],
    share: Sequence[tuple[int, Mapping[str, Any]]],
    work: Path,
    module: str,
    events: "SimpleQueue[tuple[str, int, str]]",
    stop: threading.Event,
) -> None:
    left, tries = list(share), 1
    try:
        while left:
            finished, code, ending = _run_child({**job, "items": left}, work, module, events, stop)
            if stop.is_set():
                return
            left = [entry for entry in left if entry[0] not in finished]
            if left:  # the child ended at the first of them
                _check_space(work)
                tries = 1 if finished else tries
                if code in _FROM_OUTSIDE and tries < _MAX_TRIES:
                    tries += 1
                    logger.warning("a process that looked for cameras was killed from outside; its work is done again")
                    continue
                tries = 1
                events.put(("failed", left[0][0], f"the process ended there ({ending})"))
                left = left[1:]
    except OSError as error:
        raise CaptureError(f"{work} cannot be used: {error.strerror}", "choose another folder") from error
    finally:
        events.put(("end", 0, ""))


def _run_child(
    job: Mapping[str, Any],
    work: Path,
    module: str,
    events: "SimpleQueue[tuple[str, int, str]]",
    stop: threading.Event,
) -> tuple[set[int], int, str]:
    """Items that a child has finished, its exit code, and its last output."""
    path = work / f"{JOB}{uuid.uuid4().hex[:12]}.json"
    finished: set[int] = set()
    try:
        path.write_text(json.dumps(job), encoding="utf-8")
        with (
            path.with_suffix(".log").open("w+b") as log,
            subprocess.Popen(
                bound_command([sys.executable, "-m", module, str(path)]),
                stdout=subprocess.PIPE, stderr=log, stdin=subprocess.DEVNULL, text=True, encoding="utf-8",
                errors="replace", env={**os.environ, **_SINGLE_THREADED},
            ) as child,
        ):  # fmt: skip
            assert child.stdout is not None
            ended = threading.Event()
            watch = threading.Thread(target=_kill_when_stopped, args=(child, stop, ended), daemon=True)
            watch.start()
            for line in child.stdout:
                kind, _, rest = line.strip().partition(" ")
                number, _, text = rest.partition(" ")
                if kind in _ENDS and number.isdigit():
                    finished.add(int(number))
                    events.put((kind, int(number), text))
                elif kind == "step" and number.isdigit() and text.isdigit():
                    events.put((kind, int(number), text))
            ended.set()
            watch.join()
            code = child.wait()
            log.seek(0)
            output = log.read()[-4000:].decode(errors="replace").strip().splitlines()
            last = output[-1][:300] if output else "no output"
            return finished, code, f"code {code}: {last}"
    finally:
        path.unlink(missing_ok=True)
        path.with_suffix(".log").unlink(missing_ok=True)


def _kill_when_stopped(child: "subprocess.Popen[str]", stop: threading.Event, ended: threading.Event) -> None:
    while not ended.wait(0.1):
        if stop.is_set():
            child.kill()
            return
