"""Foliage in usdview: representations, guides, and the edits of leaves, in a menu and a panel.

The panel stands in the viewer of `usdfoliage view` too, whose USD has no usdview; there nothing is registered.
"""

import importlib.util

if importlib.util.find_spec("pxr.Usdviewq") is not None:
    from usdviewFoliage.container import FoliageContainer as FoliageContainer
