"""The farthest form of an asset: six pictures of it on twelve triangles, for applications that know UsdGeomModelAPI."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from pxr import Sdf, Usd, UsdGeom

from usdfoliage.asset.materials.picture import copy_picture
from usdfoliage.asset.packages.asset_shape import AssetShape
from usdfoliage.asset.parts.part import AssetPlace

CARDS = "cards"  # folder of the asset
CARD_SIDES = ("XPos", "XNeg", "YPos", "YNeg", "ZPos", "ZNeg")  # from which each picture shows the asset


@dataclass(frozen=True, kw_only=True)
class AssetPictures:
    """Pictures of an asset that become part of it.

    A card shows the asset along an axis, without perspective, to the borders of its box; it lies as UsdGeomModelAPI
    wants it, with the picture's up along +Z on the sides of X and Y.
    """

    thumbnail: Path | None = None  # PNG
    cards: Mapping[str, Path] = field(default_factory=dict)  # PNG with alpha, by CARD_SIDES: all six or none

    def __post_init__(self) -> None:
        if self.cards and set(self.cards) != set(CARD_SIDES):
            raise ValueError(f"cards must be those of {', '.join(CARD_SIDES)}, not of {', '.join(self.cards)}")


DrawPictures = Callable[[Path, AssetShape], AssetPictures | None]  # called with the interface layer and what it holds


def copy_cards(place: AssetPlace, cards: Mapping[str, Path]) -> dict[str, str]:
    """Copy the pictures into an asset; returns their paths from its interface layer.

    Raises:
        AssetError: One cannot be read, or is no picture.
        WriteError: One cannot be written.
    """
    paths = {}
    for side, source in cards.items():
        target = place.folder / CARDS / f"{place.name}_{side}.png"
        copy_picture(source, target)
        paths[side] = f"./{CARDS}/{target.name}"
    return paths


def author_cards(prim: Usd.Prim, cards: Mapping[str, str]) -> None:
    """Name the pictures on the asset's root prim; the asset itself is drawn until somebody asks for cards.

    No draw mode is authored: a plant inherits that of the groups that it stands in.
    """
    model = UsdGeom.ModelAPI.Apply(prim)
    model.CreateModelCardGeometryAttr(UsdGeom.Tokens.cross)
    for side, path in cards.items():
        name = f"model:cardTexture{side}"
        prim.CreateAttribute(name, Sdf.ValueTypeNames.Asset, custom=False).Set(Sdf.AssetPath(path))


def read_cards(prim: Usd.Prim, folder: Path) -> dict[str, Path]:
    """The pictures that a root prim names, in the asset's folder; none where one of the six is not there."""
    cards = {}
    for side in CARD_SIDES:
        value = prim.GetAttribute(f"model:cardTexture{side}").Get()
        if not isinstance(value, Sdf.AssetPath) or not (folder / value.path).is_file():
            return {}
        cards[side] = folder / value.path
    return cards
