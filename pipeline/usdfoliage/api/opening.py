"""From an asset on disk to its models, and to what validators find in it."""

from pathlib import Path

from usdfoliage.asset.validation.studio_profile import default_profile, read_profile
from usdfoliage.asset.validation.validate import ValidationReport, validate_asset
from usdfoliage.jobs.models import AssetModels, read_models


def open_asset(asset: str | Path) -> AssetModels:
    """Read the leaves, the skeleton and the crown of an asset, whichever of its variants are selected.

    Args:
        asset: The asset's folder, its `.usda`, or a look of it; then the edits are those of the look.

    Returns:
        The models, in the asset's frame: metres, right-handed, Y up. A part that the asset lacks is None.

    Raises:
        AssetError: The asset cannot be read, is none of usdfoliage or holds several plants; its leaves have no
            representation `bezier`; an array or a cubemap is missing or damaged; a transform shears the leaves, or
            moves the skeleton or the crown within the plant.
    """
    return read_models(Path(asset))


def validate(asset: str | Path, profile: str | Path | None = None) -> ValidationReport:
    """Run every validator on an asset, in all its variants; on a look over its asset; or on a scene as it is selected.

    Args:
        asset: The asset's folder, its `.usda`, a look, or a scene with plants.
        profile: The studio's rules and the warnings that it accepts, a TOML file; without it those of usdfoliage.

    Returns:
        The findings, errors first. The asset is good where `open_errors` is 0.

    Raises:
        AssetError: There is no plant, or the asset cannot be read.
        FoliageError: The profile cannot be read.
    """
    return validate_asset(Path(asset), read_profile(Path(profile) if profile is not None else default_profile()))
