"""How far work has come: reported as it goes on, and timed by step."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Progress = Callable[[int, int], None]  # called with the parts that are done, and how many there are
StepProgress = Callable[[str, float], None]  # called with the name of a step, and the share of it that is done
PlantProgress = Callable[[str, str, float], None]  # called with a plant, what runs, and the share of all that is done

_PARTS = 1000  # of a step whose progress is reported as a share


@contextmanager
def follow_step(name: str, seconds: dict[str, float], progress: StepProgress | None) -> Iterator[Progress]:
    """A step of a run, from its start to its end.

    Args:
        name: Of the step.
        seconds: By step; that of this one is put there when it ends.
        progress: Called at the start, at the end, and with what is reported between.

    Yields:
        What to call with the progress of the step.
    """
    start = time.perf_counter()
    if progress:
        progress(name, 0.0)
    yield lambda done, total: progress(name, done / max(total, 1)) if progress else None
    seconds[name] = time.perf_counter() - start
    if progress:
        progress(name, 1.0)


def progress_in_step(name: str, progress: StepProgress | None) -> Progress | None:
    """What to call with the parts of a step, to report them as that step; None where nobody listens."""
    return None if progress is None else lambda done, total: progress(name, done / max(total, 1))


def progress_of_shares(progress: Progress) -> StepProgress:
    """What to call with named steps whose shares are those of all the work, to report them as one."""
    return lambda name, share: progress(round(_PARTS * share), _PARTS)


class PartCounter:
    """Adds up pieces of work to one progress."""

    def __init__(self, progress: Progress | None, total: int) -> None:
        self._progress, self._total, self._done = progress, total, 0

    def add(self, parts: int = 1) -> None:
        """Report that so many more parts are done."""
        self._done = min(self._done + parts, self._total)
        if self._progress is not None:
            self._progress(self._done, self._total)

    def next_piece(self, parts: int) -> Progress | None:
        """What to call with the progress of the next piece, which has so many parts; None where nobody listens."""
        if self._progress is None:
            return None
        report, before = self._progress, self._done
        self._done += parts
        return lambda done, total: report(before + parts * done // max(total, 1), self._total)
