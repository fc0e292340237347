"""Which file an asset is."""

from pathlib import Path

from usdfoliage.errors import AssetError

USD_SUFFIXES = (".usda", ".usdc", ".usd", ".usdz")


def usd_files_at_top(folder: Path) -> list[Path]:
    """The USD files at the top of a folder, sorted; an asset has exactly one, its interface layer."""
    return sorted(path for path in folder.iterdir() if path.suffix.lower() in USD_SUFFIXES and path.is_file())


def find_interface(asset: Path) -> Path:
    """The interface layer of an asset that is named by its folder or by that layer.

    Raises:
        AssetError: There is nothing of that name, or it is no asset.
    """
    if asset.is_file():
        if asset.suffix.lower() not in USD_SUFFIXES:
            raise AssetError(f"{asset} is no USD file; name an asset's folder or its .usda")
        return asset
    if not asset.is_dir():
        raise AssetError(f"{asset} does not exist; name an asset's folder or its .usda")
    try:
        layers = usd_files_at_top(asset)
    except OSError as error:
        raise AssetError(f"{asset} cannot be read: {error.strerror}") from error
    if not layers:
        raise AssetError(f"{asset} is no asset: it has no USD file at its top; name an asset's folder or its .usda")
    if len(layers) > 1:
        names = ", ".join(path.name for path in layers)
        raise AssetError(
            f"{asset} has {len(layers)} USD files at its top ({names}), an asset has one; name the one meant"
        )
    return layers[0]
