"""What the stage that writes a plant's asset knows of it, in a file beside the asset in its result."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

from usdfoliage.errors import CaptureError
from usdfoliage.files.json import read_json
from usdfoliage.jobs.report.table import Row

ASSET_FACTS = "asset_facts.json"


@dataclass(frozen=True, kw_only=True)
class AssetFacts:
    """The numbers of a plant's asset; the rows of reports are made of them."""

    leaves: int
    foliage: str  # the kind of the leaves, as foliage.kind of the settings
    branches: int

    def count_rows(self) -> list[Row]:
        """The rows of the report on how many leaves and branches there are."""
        return [
            Row(name="leaves", value=f"{self.leaves:,}", remark=self.foliage),
            Row(name="branches", value=f"{self.branches:,}"),
        ]


def write_asset_facts(folder: Path, facts: AssetFacts) -> None:
    """Write the file into the folder of the result."""
    (folder / ASSET_FACTS).write_text(json.dumps(asdict(facts), indent=1) + "\n", encoding="utf-8")


def read_asset_facts(folder: Path) -> AssetFacts:
    """The facts in the folder of a result; CaptureError where they cannot be read."""
    try:
        values = read_json(folder / ASSET_FACTS)
        return AssetFacts(
            leaves=int(values["leaves"]), foliage=str(values["foliage"]), branches=int(values["branches"])
        )
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise CaptureError(f"{folder / ASSET_FACTS} cannot be read ({error})", "run the same command again") from error
