"""Photographs of real plants in, editable OpenUSD foliage assets out."""

import signal
import sys

# pxr swallows the interrupt that arrives while its modules load, and runs on half loaded. On the command line it ends
# the program instead, until usdfoliage.cli.interrupts.handle_interrupts takes over.
if sys.argv[0] == "-m" or sys.argv[0].replace("\\", "/").rsplit("/", 1)[-1] in ("usdfoliage", "usdfoliage.exe"):
    signal.signal(signal.SIGINT, signal.SIG_DFL)

from usdfoliage.asset.schema import register_plugins
from usdfoliage.errors import AssetError, CaptureError, FitError, FoliageError, PreviewError

__version__ = "0.1.0"

__all__ = ["AssetError", "CaptureError", "FitError", "FoliageError", "PreviewError", "__version__"]

register_plugins()  # before the first stage: USD reads schemas only once
