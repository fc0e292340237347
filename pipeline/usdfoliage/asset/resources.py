"""Where the files lie that a USD runtime or the preview interpreter loads.

In a source checkout they stand in the repository's root, in an installed package in usdfoliage/share.
"""

from pathlib import Path

from usdfoliage.errors import AssetError

_PACKAGE = Path(__file__).resolve().parents[1]
_PLACES = (_PACKAGE.parents[1], _PACKAGE / "share")


def resource_folder(relative: str) -> Path:
    """The folder of that name, such as "schemas/usdFoliage" or "hydra_preview".

    Raises:
        AssetError: It is neither in the checkout nor in the installed package.
    """
    for place in _PLACES:
        # A folder of the same name may stand beside an installed package; ours has the schemas beside it.
        if (place / "schemas" / "usdFoliage" / "plugInfo.json").is_file() and (place / relative).is_dir():
            return place / relative
    places = " and ".join(str(place) for place in _PLACES)
    raise AssetError(f"{relative} is missing, looked for in {places}", "install usdfoliage again")


def plugin_folders() -> tuple[Path, ...]:
    """What every program that reads assets has a use for: the schemas and the validators."""
    return resource_folder("schemas/usdFoliage"), resource_folder("usd_plugins/usdFoliageValidators")


def plugin_path_folders(*, validators: bool = True) -> tuple[Path, ...]:
    """The folders that go on PXR_PLUGINPATH_NAME: schemas, the validators or not, and the plug-in of usdview."""
    schemas, checks = plugin_folders()
    usdview = resource_folder("usd_plugins/usdviewFoliage")
    return (schemas, checks, usdview) if validators else (schemas, usdview)


def python_folders() -> tuple[Path, ...]:
    """The folders that go on PYTHONPATH: the plug-ins' parent, and the package's own in a source checkout.

    An installed package adds no other: beside it may lie another pxr, which a studio's Python must not see.
    """
    plugins = resource_folder("usd_plugins")
    return (plugins, _PACKAGE.parent) if plugins.parent == _PLACES[0] else (plugins,)
