"""The shape of an asset as it is composed."""

from pathlib import Path

from usdfoliage.asset.looks.look import open_asset
from usdfoliage.asset.packages.asset_shape import AssetShape
from usdfoliage.asset.packages.contents import interface_of, read_plant_facts, require_plant


def read_shape(asset: Path) -> AssetShape:
    """What an application finds on the root prim."""
    interface, _ = interface_of(asset)
    stage = open_asset(interface)  # which prims do not keep
    facts = read_plant_facts(require_plant(stage, asset), interface)
    return AssetShape(
        extent_m=facts.extent,
        asset_from_capture=facts.asset_from_capture,
        variants=facts.variants,
        selections=facts.selections,
    )


def list_shape(shape: AssetShape) -> tuple[object, ...]:
    """All values of a shape, the order of its variant sets too, to compare them."""
    extent_m = None if shape.extent_m is None else shape.extent_m.tolist()
    variants = [(name, tuple(members)) for name, members in shape.variants.items()]
    return extent_m, shape.asset_from_capture.tolist(), variants, dict(shape.selections)
