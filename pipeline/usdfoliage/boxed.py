"""The child of usdfoliage.cli.box: one command, in a process that the parent may end.

It is started by its path, `boxed.py REPORTS NOISE COMMAND …`: two open pipes, and the words of the command line.
"""

import io
import os
import sys
from typing import Any

del sys.path[0]  # the folder of this file: its modules have names of others
_PACKAGES = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))  # noqa: PTH100, PTH120


def main() -> int:
    """Run the command, with what libraries print by themselves in a pipe of the parent."""
    reports, noise, words = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3:]
    sys.argv = ["usdfoliage", *words]
    sys.stdout, sys.stderr = _moved(sys.stdout, 1, noise), _moved(sys.stderr, 2, noise)
    vars(sys).update(__stdout__=sys.stdout, __stderr__=sys.stderr)  # by which the width of a terminal is asked
    os.close(noise)
    if _PACKAGES not in sys.path:
        sys.path.append(_PACKAGES)  # where the parent found the package, should nothing else lead there
    from usdfoliage.__main__ import main as run
    from usdfoliage.cli.box import announce, follow_parent

    follow_parent()
    return run(words, prepare=lambda options: announce(options, reports))


def _moved(stream: Any, number: int, noise: int) -> Any:
    """A stream of ours on a descriptor of its own, and the noise of libraries in its old place."""
    if stream is None:
        return None
    kept = os.dup(number)
    os.dup2(noise, number)
    is_line = number == 2 or os.isatty(kept)
    raw = io.FileIO(kept, "w")
    return io.TextIOWrapper(
        io.BufferedWriter(raw), encoding=stream.encoding, errors=stream.errors, line_buffering=is_line
    )


if __name__ == "__main__":
    sys.exit(main())
