"""Work on many views at once: numpy, OpenCV and the native functions let go of the interpreter while they count."""

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

MAX_AT_ONCE = 4  # large pictures that are worked on at a time, however many cores there are: memory is finite

Item = TypeVar("Item")
Result = TypeVar("Result")


def map_threaded(function: Callable[[Item], Result], items: Iterable[Item], *, threads: int = 0) -> Iterator[Result]:
    """The results of a function that changes nothing but its result, in the order of the items.

    Args:
        function: Of one item. What it raises is raised where its result would have come.
        items: Taken all at once.
        threads: At most so many, 0 for one per core; the results are the same.
    """
    every = list(items)
    workers = min(threads or os.cpu_count() or 1, len(every))
    if workers < 2:
        yield from map(function, every)
        return
    with ThreadPoolExecutor(workers) as pool:
        yield from pool.map(function, every)


def map_ahead(function: Callable[[Item], Result], items: Iterable[Item], threads: int) -> Iterator[Result]:
    """As map_threaded, but no more items are taken ahead than there are threads: memory is finite."""
    if threads < 2:
        yield from map(function, items)
        return
    with ThreadPoolExecutor(threads) as pool:
        waiting: deque[Future[Result]] = deque()
        for item in items:
            waiting.append(pool.submit(function, item))
            if len(waiting) > threads:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


def share_cores(threads: int = 0) -> tuple[int, int]:
    """How many large pictures are worked on at once, and by how many threads each.

    Args:
        threads: In all, 0 for one per core.
    """
    every = threads or os.cpu_count() or 1
    at_once = min(every, MAX_AT_ONCE)
    return at_once, every // at_once
