"""The steps of a run: told as they go on, and timed."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

# Says which step runs and how far it is, in [0, 1].
StepProgress = Callable[[str, float], None]


@contextmanager
def follow_step(
    name: str, seconds: dict[str, float], progress: StepProgress | None
) -> Iterator[Callable[[int, int], None]]:
    """A step of a run, from its start to its end.

    Args:
        name: Of the step.
        seconds: By step; that of this one is put there when it ends.
        progress: Told of the start, the end, and what is reported between.

    Yields:
        What reports (done, total) of the step.
    """
    start = time.perf_counter()
    if progress:
        progress(name, 0.0)
    yield lambda done, total: progress(name, done / max(total, 1)) if progress else None
    seconds[name] = time.perf_counter() - start
    if progress:
        progress(name, 1.0)
