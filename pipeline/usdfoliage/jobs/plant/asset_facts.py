"""What the stage that writes a plant's asset knows of it, in a file beside the asset in its result."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from usdfoliage.asset.packages.asset_shape import AssetShape
from usdfoliage.errors import CaptureError
from usdfoliage.files.json import read_json
from usdfoliage.jobs.leaves.page import origin_rows
from usdfoliage.jobs.report.table import Row

ASSET_FACTS = "asset_facts.json"


@dataclass(frozen=True, kw_only=True, eq=False)
class AssetFacts:
    """The numbers of a plant's asset; the rows of reports are made of them."""

    leaves: int
    foliage: str  # the kind of the leaves, as foliage.kind of the settings
    branches: int
    shape: AssetShape
    origins: Mapping[str, int] = field(default_factory=dict)  # leaves of each origin, as leaf.model.count_origins
    is_drawable: bool = True  # whether its first pictures were drawn within their time, if any were tried

    @property
    def height_m(self) -> float | None:
        """Height above the ground."""
        extent_m = self.shape.extent_m
        return None if extent_m is None else float(extent_m[1][1] - min(extent_m[0][1], 0))

    @property
    def width_m(self) -> float | None:
        """The larger side of its ground plan."""
        extent_m = self.shape.extent_m
        return None if extent_m is None else float((extent_m[1] - extent_m[0])[[0, 2]].max())

    def count_rows(self) -> list[Row]:
        """The rows of the report on how many leaves and branches there are."""
        return [
            Row(name="leaves", value=f"{self.leaves:,}", remark=self.foliage),
            *origin_rows(self.origins),
            Row(name="branches", value=f"{self.branches:,}"),
        ]


def write_asset_facts(folder: Path, facts: AssetFacts) -> None:
    """Write the file into the folder of the result."""
    shape = facts.shape
    values = {
        "leaves": facts.leaves,
        "foliage": facts.foliage,
        "origins": dict(facts.origins),
        "branches": facts.branches,
        "is_drawable": facts.is_drawable,
        "extent_m": None if shape.extent_m is None else shape.extent_m.tolist(),
        "asset_from_capture": shape.asset_from_capture.tolist(),
        "variants": {name: list(members) for name, members in shape.variants.items()},
        "selections": dict(shape.selections),
    }
    (folder / ASSET_FACTS).write_text(json.dumps(values, indent=1) + "\n", encoding="utf-8")


def read_asset_facts(folder: Path) -> AssetFacts:
    """The facts in the folder of a result; CaptureError where they cannot be read."""
    try:
        values = read_json(folder / ASSET_FACTS)
        extent_m = values["extent_m"]
        shape = AssetShape(
            extent_m=None if extent_m is None else np.array(extent_m, np.float64).reshape(2, 3),
            asset_from_capture=np.array(values["asset_from_capture"], np.float64).reshape(4, 4),
            variants={str(name): tuple(map(str, members)) for name, members in values["variants"].items()},
            selections={str(name): str(member) for name, member in values["selections"].items()},
        )
        return AssetFacts(
            leaves=int(values["leaves"]),
            foliage=str(values["foliage"]),
            branches=int(values["branches"]),
            is_drawable=bool(values["is_drawable"]),
            shape=shape,
            origins={str(name): int(count) for name, count in values["origins"].items()},
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise CaptureError(f"{folder / ASSET_FACTS} cannot be read ({error})", "run the same command again") from error
