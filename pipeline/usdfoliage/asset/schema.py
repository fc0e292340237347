"""The usdFoliage schemas: their names and their registration with USD.

schemas/usdFoliage/schema.usda explains the properties.
"""

import sys
from pathlib import Path

from pxr import Plug

from usdfoliage.asset.resources import plugin_folders, resource_folder
from usdfoliage.errors import AssetError

PLANT_API = "FoliagePlantAPI"
LEAF_API = "FoliageLeafAPI"
LOBED_LEAF_API = "FoliageLobedLeafAPI"
SKELETON_API = "FoliageSkeletonAPI"
CROWN_API = "FoliageCrownAPI"
FOREST_API = "FoliageForestAPI"
SCHEMAS = (PLANT_API, LEAF_API, LOBED_LEAF_API, SKELETON_API, CROWN_API, FOREST_API)


def register_plugins() -> tuple[Path, ...]:
    """Register the schemas and the validators with USD's plug-in registry; returns their folders.

    USD reads the schemas when its schema registry is first asked, usually by the first stage, and never again, so this
    must come before. Plug-ins registered already, here or through PXR_PLUGINPATH_NAME, stay as they are.
    """
    modules = str(resource_folder("usd_plugins"))
    if modules not in sys.path:
        sys.path.append(modules)
    folders = plugin_folders()
    Plug.Registry().RegisterPlugins([str(folder) for folder in folders])
    return folders


def require_schemas() -> None:
    """Make sure that USD knows the schemas.

    Raises:
        AssetError: USD's schema registry was built before usdfoliage was imported.
    """
    from pxr import Usd  # heavier than Plug, and every import of usdfoliage passes through this module

    registry = Usd.SchemaRegistry()
    missing = [name for name in SCHEMAS if registry.FindAppliedAPIPrimDefinition(name) is None]
    if missing:
        raise AssetError(
            f"USD does not know {', '.join(missing)}: a stage was opened before usdfoliage was imported",
            "import usdfoliage first, or set what `usdfoliage env` prints",
        )
