"""The child of usdfoliage.cli.box: one command, in a process that the parent may end.

It is started by its path, `boxed.py PARENT REPORTS NOISE COMMAND …`: the process id of the parent, two open pipes, and
the words of the command line.
"""

import contextlib
import os
import sys

del sys.path[0]  # the folder of this file: its modules have names of others
_PACKAGES = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))  # noqa: PTH100, PTH120


def main() -> None:
    """Run the command, with what libraries print by themselves in a pipe of the parent, and end.

    Nothing is taken down: a large stage takes seconds for that, in which the parent would end a child that has printed
    its result, and print an error below it.
    """
    parent, reports, noise, words = int(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), sys.argv[4:]
    sys.argv = ["usdfoliage", *words]
    if _PACKAGES not in sys.path:
        sys.path.append(_PACKAGES)  # where the parent found the package, should nothing else lead there
    from usdfoliage.files.children import end_with_parent

    end_with_parent(parent)
    from usdfoliage.files.delayed_interrupts import take_interrupts

    take_interrupts()  # before the package is imported one would end Python with a traceback
    from usdfoliage.cli.noise import move_streams

    move_streams(noise)
    os.close(noise)
    from usdfoliage.__main__ import main as run
    from usdfoliage.cli.box import announce, conclude

    code = run(
        words,
        prepare=lambda options: announce(options, reports),
        conclude=lambda: conclude(reports),
    )
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):  # its reader may have left
            stream.flush()
    os._exit(code)


if __name__ == "__main__":
    main()
