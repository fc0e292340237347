"""Child processes that end when the process that started them ends, however that ends, SIGKILL included.

A child asks the kernel for it (Linux, prctl PR_SET_PDEATHSIG). Code of ours asks for itself. A program that is not ours
is started by this file, run as a script, `children.py PARENT PROGRAM …`, which asks, and then becomes the program: what
was asked lasts through exec. It imports nothing of the package, so that it starts within milliseconds.

The kernel counts the thread that started the child as its parent: start one where the thread waits for it.
"""

import ctypes
import os
import signal
import sys
from collections.abc import Sequence

_PR_SET_PDEATHSIG = 1
_NOT_STARTED = 127  # what a shell ends with for a program that cannot be started


def end_with_parent(parent: int) -> None:
    """In a child: be killed when the parent ends; ends at once where that has happened already.

    Args:
        parent: Process id of the parent, as the parent knows it.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent:
        os._exit(1)


def bound_command(words: Sequence[str]) -> list[str]:
    """The command line by which a program ends with this process; its first word is a path, not a name to look up."""
    return [sys.executable, "-I", "-S", __file__, str(os.getpid()), *words]


def main(arguments: Sequence[str]) -> int:
    """Become a program; 127 where that cannot be started."""
    end_with_parent(int(arguments[0]))
    try:
        os.execv(arguments[1], list(arguments[1:]))
    except OSError as error:
        print(f"{arguments[1]} cannot be started: {error.strerror}", file=sys.stderr)
        return _NOT_STARTED


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
