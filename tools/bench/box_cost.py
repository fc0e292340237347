"""What it costs that commands that open USD run in a child process: the same command with and without, in turns.

usage: tools/bench/box_cost.py [--runs N] [ASSET]

Without ASSET it makes a spray of 400 leaves. Prints, for each command, the median seconds by the clock of both and of
their difference; the exit code is 1 where a difference is above 0.3 s.
"""

import argparse
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

TARGET_S = 0.3
UNBOXED = "import sys; from usdfoliage.__main__ import main; sys.exit(main(sys.argv[1:]))"
BOXED = "import sys; from usdfoliage.__main__ import main; sys.exit(main())"


def seconds(code: str, words: list[str]) -> float:
    """By the clock, of one run.

    Raises:
        subprocess.CalledProcessError: The command failed.
    """
    began = time.perf_counter()
    subprocess.run([sys.executable, "-c", code, *words], check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - began


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("asset", nargs="?", metavar="ASSET", help="an asset or a look")
    parser.add_argument("--runs", type=int, default=7, help="of each (%(default)s)")
    options = parser.parse_args()
    missed = False
    with tempfile.TemporaryDirectory(prefix="usdfoliage-box-") as folder:
        asset = options.asset or str(Path(folder) / "spray")
        if not options.asset:
            seconds(UNBOXED, ["scatter", "-n", "400", "-o", asset])
        print(f"{'command':<10} {'without':>9} {'in a box':>9} {'more':>9}")
        for words in (
            ["info", asset],
            ["validate", asset],
            ["edit", asset, "--width", "1.3", "-o", str(Path(folder) / "look.usda")],
            ["bake", asset, "--force", "-o", str(Path(folder) / "baked")],
        ):
            pairs = [(seconds(UNBOXED, words), seconds(BOXED, words)) for _ in range(options.runs)]
            without, within = (statistics.median(column) for column in zip(*pairs, strict=True))
            more = statistics.median(second - first for first, second in pairs)
            missed |= more > TARGET_S
            print(f"{words[0]:<10} {without:>7.2f} s {within:>7.2f} s {more:>7.2f} s")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
