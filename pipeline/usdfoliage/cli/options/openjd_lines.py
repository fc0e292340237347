"""What a job of Open Job Description reports to the farm on stdout, a line each."""

from dataclasses import dataclass, field


@dataclass
class OpenjdLines:
    """Prints progress, status and failure; nothing where it is not enabled.

    Source:
        Open Job Description, How Jobs Are Run, section Stdout/Stderr Messages.
    """

    enabled: bool
    _percent: float = field(default=-1.0, init=False)
    _status: str = field(default="", init=False)

    def begin(self, status: str) -> None:
        self.status(status)
        self.progress(0.0)

    def progress(self, share: float) -> None:
        """The share that is done, 0 to 1; printed when it is a percent more than was printed last."""
        percent = round(100 * min(max(share, 0.0), 1.0), 1)
        if percent >= self._percent + 1 or (percent == 100 and self._percent < 100):
            self._percent = percent
            self._print("progress", f"{percent:g}")

    def status(self, text: str) -> None:
        """What runs, when that is another than before."""
        if text != self._status:
            self._status = text
            self._print("status", text)

    def fail(self, text: str) -> None:
        """Why it failed."""
        self._print("fail", text)

    def _print(self, kind: str, text: str) -> None:
        if self.enabled:
            print(f"openjd_{kind}: {' '.join(text.split())}", flush=True)
