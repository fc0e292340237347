"""The pictures of an asset, drawn while a task writes it, and what became of them."""

from dataclasses import dataclass, field
from pathlib import Path

from usdfoliage.asset.packages.asset_shape import AssetShape
from usdfoliage.asset.packages.cards import AssetPictures
from usdfoliage.errors import PreviewError, PreviewTimeoutError
from usdfoliage.jobs.plant.pages.cards import draw_asset_pictures
from usdfoliage.jobs.plant.settings import PictureStageSettings
from usdfoliage.remarks import Remark, remark


@dataclass(eq=False)
class AssetDrawing:
    """Draws a thumbnail and cards where they are asked for, and keeps the asset's shape.

    Attributes:
        settings: Which pictures.
        folder: They are drawn there.
        shapes: Of the asset, one when it was written.
        remarks: One where pictures are missing.
        is_late: Whether they were not drawn within their time.
    """

    settings: PictureStageSettings
    folder: Path
    shapes: list[AssetShape] = field(default_factory=list)
    remarks: list[Remark] = field(default_factory=list)
    is_late: bool = False

    def draw(self, interface: Path, shape: AssetShape) -> AssetPictures | None:
        """The pictures, as write_plant_asset calls for them; None without any."""
        self.shapes.append(shape)
        if not self.settings.make:
            return None
        try:
            return draw_asset_pictures(interface, shape, self.folder, self.settings)
        except PreviewError as error:
            self.is_late = isinstance(error, PreviewTimeoutError)
            what = "no thumbnail and no cards" if self.settings.cards else "no thumbnail"
            text = f"the asset has {what}: {error.text}"
            self.remarks.append(remark("thumbnail-missing", text, remedy=error.remedy))
            return None
