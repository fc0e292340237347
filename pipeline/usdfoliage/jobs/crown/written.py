"""How the options of a crown that was made are written down."""

from usdfoliage.asset.packages.leaf_package import AssetSettings


def describe_mesh_size(settings: AssetSettings, map_size: int) -> str:
    """The option --mesh-size that gives the same mesh again; auto where it is chosen by the silhouettes."""
    return "auto" if settings.crown_mesh_size is None else str(min(settings.crown_mesh_size, map_size))
