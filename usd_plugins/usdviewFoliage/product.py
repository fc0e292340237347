"""usdfoliage in a process of its own: it draws the average leaf, and writes looks.

Requests and replies are JSON, a line each; usdfoliage.jobs.preview.viewer answers them.
"""

import json
import os
import shutil
import subprocess

PROGRAM = "usdfoliage"


class ProductError(Exception):
    """What usdfoliage reports that it cannot do."""


class ProductGoneError(ProductError):
    """It does not answer any more."""


class Product:
    """A line to a process of usdfoliage."""

    def __init__(self, requests, replies) -> None:
        """Over two binary streams: to write to, to read from."""
        self._requests, self._replies = requests, replies

    def ask(self, **request) -> dict:
        """The reply to a request; ProductError where it is an error."""
        try:
            self._requests.write(json.dumps(request).encode() + b"\n")
            self._requests.flush()
            line = self._replies.readline()
        except OSError as error:
            raise ProductGoneError(f"usdfoliage does not answer: {error.strerror}") from error
        if not line:
            raise ProductGoneError("usdfoliage has ended")
        reply = json.loads(line)
        if "error" in reply:
            raise ProductError(reply["error"])
        return reply

    def leaf_curves(self, asset: str, edits: dict) -> list:
        """The curves of the average leaf under edits, with their control points."""
        return self.ask(op="leaf", asset=asset, edits=edits)["curves"]

    def leaf_bounds(self, asset: str, edits: dict) -> list:
        """What holds the edited leaves of each prim of leaves: {"leaf": corners, "among": corners}."""
        return self.ask(op="bounds", asset=asset, edits=edits)["bounds"]

    def write_look(self, path: str, asset: str, edits: dict) -> None:
        """Write a look of the asset, as `usdfoliage edit` does."""
        self.ask(op="save", path=path, asset=asset, edits=edits)


def inherited_product(request_fd: int, reply_fd: int) -> Product:
    """The process that started this one and waits at the other ends of two pipes."""
    return Product(os.fdopen(request_fd, "wb"), os.fdopen(reply_fd, "rb"))


def find_product() -> Product | None:
    """A process of the usdfoliage on PATH; None where there is none."""
    program = shutil.which(PROGRAM)
    if program is None:
        return None
    # Its Python is another one, which must not load this one's modules.
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONHOME")}
    process = subprocess.Popen(
        [program, "view", "--answer"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment
    )
    return Product(process.stdin, process.stdout)
