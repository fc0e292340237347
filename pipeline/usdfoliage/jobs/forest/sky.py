"""The sky of a forest, as a picture in its maps."""

from pathlib import Path

from usdfoliage.asset.parts.part import MAPS
from usdfoliage.asset.parts.sky import SkyPrim, write_sky_picture
from usdfoliage.forest.sky import SUN_WIDTH_DEG, SkySettings, make_sky


def write_sky(folder: Path, name: str, settings: SkySettings) -> SkyPrim:
    """Write the picture of a sky into an asset's maps.

    Args:
        folder: Of the asset.
        name: Of the asset, with which the picture's name begins.
        settings: Where the sun is.

    Returns:
        Its lights, with the path as seen from the payload.

    Raises:
        WriteError: The picture cannot be written.
    """
    sky = make_sky(settings)
    (folder / "maps").mkdir(exist_ok=True)
    write_sky_picture(folder / "maps" / f"{name}_sky.exr", sky.radiance)
    return SkyPrim(
        picture=f"{MAPS}/{name}_sky.exr",
        to_sun=sky.to_sun,
        sun_irradiance=sky.sun_irradiance,
        sun_width_deg=SUN_WIDTH_DEG,
    )
