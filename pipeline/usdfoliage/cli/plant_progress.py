"""A progress bar for builds, on stderr when that is a terminal; lines for logs where it is not."""

import sys
import time
from types import TracebackType

from tqdm import tqdm

_BETWEEN_S = 20.0  # lines of a log, at least


class PlantBar:
    """Shows what runs, how far all the work is, and how long it will take."""

    def __init__(self) -> None:
        self._bar = tqdm(
            total=1000,
            leave=False,
            disable=None,  # silent where stderr is no terminal
            bar_format="{desc:<34.34} {bar:30} {percentage:3.0f}% {elapsed} < {remaining}",
        )
        self._started_s = self._reported_s = time.monotonic()

    def __enter__(self) -> "PlantBar":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.close()

    def show(self, plant: str, what: str, share: float) -> None:
        """What runs of which plant, and the share of all work that is done, 0 to 1."""
        self._bar.set_description_str(f"{plant}: {what}", refresh=False)
        self._bar.n = max(self._bar.n, round(1000 * min(share, 1.0)))
        self._bar.refresh()
        if self._bar.disable:
            self._report(f"{plant}: {what}", min(share, 1.0))

    def _report(self, what: str, share: float) -> None:
        """A line for a log, now and then."""
        now_s = time.monotonic()
        if now_s - self._reported_s < _BETWEEN_S:
            return
        self._reported_s = now_s
        taken_s = now_s - self._started_s
        left = f", about {taken_s * (1 - share) / share:.0f} s left" if share > 0.02 else ""
        print(f"{what}, {share:.0%} done in {taken_s:.0f} s{left}", file=sys.stderr, flush=True)

    def write(self, line: str) -> None:
        """Print a line on stdout, above the bar."""
        tqdm.write(line)
        sys.stdout.flush()
