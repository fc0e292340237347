"""Photographs of real plants in, editable OpenUSD foliage assets out."""

from usdfoliage.asset.schema import register_plugins
from usdfoliage.errors import AssetError, CaptureError, FitError, FoliageError, PreviewError

__version__ = "0.1.0"

__all__ = ["AssetError", "CaptureError", "FitError", "FoliageError", "PreviewError", "__version__"]

register_plugins()  # before the first stage: USD reads schemas only once
