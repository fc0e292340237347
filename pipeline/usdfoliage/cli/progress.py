"""A progress bar for a job of named steps, on stderr when that is a terminal."""

from types import TracebackType

from tqdm import tqdm


class StepBar:
    """Shows the step that runs and how far it is."""

    def __init__(self) -> None:
        # disable=None: silent where stderr is no terminal, as on a farm.
        self._bar = tqdm(
            total=100, leave=False, disable=None, bar_format="{desc:<14} {bar:30} {percentage:3.0f}% {elapsed}"
        )

    def __enter__(self) -> "StepBar":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.close()

    def show(self, step: str, share: float) -> None:
        """The step and its share done, 0 to 1."""
        self._bar.set_description_str(step, refresh=False)
        self._bar.n = round(100 * share)
        self._bar.refresh()
