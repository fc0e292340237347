"""A progress bar for builds, on stderr when that is a terminal; lines for logs where it is not."""

import sys
import time
from collections.abc import Sequence
from types import TracebackType

from tqdm import tqdm

_BETWEEN_S = 20.0  # lines of a log, at least
_RECENT = 0.5  # of the share that is done: how fast the rest of it went is how fast the work goes on
_KNOWN, _GROWN = 0.02, 0.01  # of all work: less was done, or was since then, than an estimate needs


_FORMAT = "{desc:<34.34} {bar:30} {percentage:3.0f}% {elapsed} < "


def estimate_left(samples: Sequence[tuple[float, float]], now_s: float) -> float | None:
    """Seconds that work will still take, as fast as the later half of what is done went; None where that is unknown.

    What comes before the work, and the first of many equal tasks, for which programs and tables are read, take longer
    than the rest.

    Args:
        samples: When, in seconds, and the share of all work that was done then, above 0 to 1; both ascend.
        now_s: The time now.
    """
    if not samples or samples[-1][1] <= _KNOWN:
        return None
    done = samples[-1][1]
    since_s, before = max((each for each in samples if each[1] <= _RECENT * done), default=samples[0])
    if done - before < _GROWN or now_s <= since_s:
        return None
    return (now_s - since_s) * (1 - done) / (done - before)


class PlantBar:
    """Shows what runs, how far all the work is, and how long it will take."""

    def __init__(self) -> None:
        self._bar = tqdm(
            total=1000,
            leave=False,
            disable=None,  # silent where stderr is no terminal
            bar_format=_FORMAT,
        )
        self._started_s = self._reported_s = time.monotonic()
        self._samples: list[tuple[float, float]] = []  # when, and the share that was done then, where it grew

    def __enter__(self) -> "PlantBar":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.close()

    def show(self, plant: str, what: str, share: float) -> None:
        """What runs of which plant, and the share of all work that is done, 0 to 1."""
        share = max(min(share, 1.0), self._samples[-1][1] if self._samples else 0.0)
        now_s = time.monotonic()
        if share > 0 and (not self._samples or share > self._samples[-1][1]):
            self._samples.append((now_s, share))
        left_s = estimate_left(self._samples, now_s)
        self._bar.set_description_str(f"{plant}: {what}", refresh=False)
        self._bar.n = round(1000 * share)
        self._bar.bar_format = _FORMAT + ("?" if left_s is None else tqdm.format_interval(left_s))
        self._bar.refresh()
        if self._bar.disable:
            self._report(f"{plant}: {what}", share, left_s)

    def _report(self, what: str, share: float, left_s: float | None) -> None:
        """A line for a log, now and then."""
        now_s = time.monotonic()
        if now_s - self._reported_s < _BETWEEN_S:
            return
        self._reported_s = now_s
        left = "" if left_s is None else f", about {left_s:.0f} s left"
        print(f"{what}, {share:.0%} done in {now_s - self._started_s:.0f} s{left}", file=sys.stderr, flush=True)

    def write(self, line: str) -> None:
        """Print a line on stdout, above the bar."""
        tqdm.write(line)
        sys.stdout.flush()
