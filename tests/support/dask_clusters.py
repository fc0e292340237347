"""A Dask scheduler with workers, of processes that a test starts, and ends."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path


@dataclass
class DaskCluster:
    """A scheduler on this machine, and its workers."""

    folder: Path
    address: str
    scheduler: subprocess.Popen[bytes]
    workers: list[subprocess.Popen[bytes]] = field(default_factory=list)

    def add_worker(self, *options: str) -> None:
        """Start another one, of one thread."""
        arguments = ["worker", self.address, "--nthreads", "1", "--host", "127.0.0.1", "--no-dashboard", *options]
        self.workers.append(_start(self.folder, f"worker{len(self.workers)}", arguments))


@contextmanager
def dask_cluster(folder: Path, workers: int = 2, *options: str) -> Iterator[DaskCluster]:
    """A cluster that ends with the body; options are those of dask worker."""
    file = folder / "scheduler.json"
    arguments = ["scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file)]
    scheduler = _start(folder, "scheduler", arguments)
    cluster = None
    try:
        end = time.monotonic() + 60
        while not (file.exists() and file.read_text()):
            assert scheduler.poll() is None, (folder / "scheduler.log").read_text()
            assert time.monotonic() < end, "the scheduler does not start"
            time.sleep(0.05)
        cluster = DaskCluster(folder=folder, address=json.loads(file.read_text())["address"], scheduler=scheduler)
        for _ in range(workers):
            cluster.add_worker(*options)
        yield cluster
    finally:
        started = [*(cluster.workers if cluster else ()), scheduler]
        for process in started:
            process.terminate()
        for process in started:
            try:
                process.wait(timeout=20)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _start(folder: Path, name: str, arguments: list[str]) -> subprocess.Popen[bytes]:
    with (folder / f"{name}.log").open("wb") as log:
        return subprocess.Popen(
            [sys.executable, "-m", "dask", *arguments],
            stdout=log,
            stderr=subprocess.STDOUT,
            env={**os.environ, "DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "10s"},
            cwd=folder,
        )
