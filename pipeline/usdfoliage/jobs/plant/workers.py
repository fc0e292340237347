"""Who does tasks, as the user chooses."""

from collections.abc import Iterator
from contextlib import contextmanager

from usdfoliage.jobs.plant.dask_workers import connect_dask
from usdfoliage.jobs.plant.executor_choice import ExecutorChoice
from usdfoliage.jobs.plant.executors import Workers
from usdfoliage.jobs.plant.processes import open_processes, threads_each


@contextmanager
def open_workers(where: ExecutorChoice) -> Iterator[tuple[Workers | None, int]]:
    """Who does the tasks, None for this process; threads of each task.

    Raises:
        FoliageError: The scheduler does not answer, or has no workers.
    """
    if where.scheduler:
        with connect_dask(where.scheduler) as workers:
            yield workers, where.threads or 1
    elif where.jobs > 1:
        with open_processes(where.jobs) as workers:
            yield workers, where.threads or threads_each(where.jobs)
    else:
        yield None, where.threads
