"""Workers of a Dask scheduler that do tasks."""

import logging
import time
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from typing import Any

from usdfoliage.errors import FoliageError
from usdfoliage.jobs.plant.executors import Workers

logger = logging.getLogger(__name__)

PATIENCE_S = 60.0  # that workers may all be away: a nanny, or the farm, starts others


@contextmanager
def connect_dask(scheduler: str, timeout_s: float = 30.0, patience_s: float = PATIENCE_S) -> Iterator[Workers]:
    """The workers of a Dask scheduler; how many there are may change while they work.

    Args:
        scheduler: Its address.
        timeout_s: For it to answer, and to have workers.
        patience_s: For workers to come back.

    Raises:
        FoliageError: There is no Dask, no scheduler at that address, or it has no workers.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise FoliageError("a scheduler needs Dask", "install it with: pip install 'usdfoliage[dask]'") from error
    try:
        client = Client(scheduler, timeout=timeout_s, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise FoliageError(
            f"no Dask scheduler answers at {scheduler}: {error}", "start one with: dask scheduler"
        ) from error
    try:
        start = time.monotonic()
        while not _count_threads(client):
            if time.monotonic() - start > timeout_s:
                raise FoliageError(
                    f"the Dask scheduler at {scheduler} has no workers", f"start some with: dask worker {scheduler}"
                )
            time.sleep(0.2)
        last_seen = time.monotonic()

        def count() -> int:
            nonlocal last_seen
            threads = _count_threads(client)
            if threads:
                last_seen = time.monotonic()
            elif time.monotonic() - last_seen > patience_s:
                raise FoliageError(
                    f"the Dask scheduler at {scheduler} is gone, or has had no workers for {patience_s:.0f} s",
                    "start it or some workers, then the same command goes on from here",
                )
            return threads

        def open_executor() -> Executor:
            # The scheduler hands the task of a worker that died to another one. pure: the work folder knows what is
            # done, and Dask must not remember it.
            executor: Executor = client.get_executor(pure=False)
            return executor

        yield Workers(open_executor=open_executor, count=count)
    finally:
        client.close(timeout=5)


def _count_threads(client: Any) -> int:
    """Of all workers; 0 where the scheduler does not answer now."""
    try:
        return sum(client.nthreads().values())
    except (OSError, TimeoutError, RuntimeError, ValueError) as error:
        logger.info("the Dask scheduler does not answer: %s", error)
        return 0
