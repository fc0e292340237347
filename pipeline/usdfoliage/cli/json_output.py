"""The one JSON object that a command prints in place of its lines; docs/json_output.schema.json describes it."""

import argparse
import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from usdfoliage.files.printable import printable_json
from usdfoliage.remarks import Remark

if TYPE_CHECKING:
    from usdfoliage.jobs.report.table import Row

# The version of what commands print, in each object. It rises where a key goes or changes its meaning; a key that is
# new changes nothing.
SCHEMA_VERSION = 1


def add_json(parser: argparse._ActionsContainer) -> None:
    parser.add_argument("--json", action="store_true", help="Print one JSON object instead of lines of text.")


def format_made(
    *, asset: Path | None, report: Path | None, facts: "Iterable[Row]", remarks: Iterable[Remark], **more: object
) -> str:
    """What a command made, as JSON.

    Args:
        asset: What was written; None where nothing was.
        report: Its page; None where there is none.
        facts: Figures.
        remarks: With their codes and remedies.
        more: What this command alone has.
    """
    return format_json(list_made(asset=asset, report=report, facts=facts, remarks=remarks, **more))


def list_made(
    *, asset: Path | None, report: Path | None, facts: "Iterable[Row]", remarks: Iterable[Remark], **more: object
) -> dict[str, object]:
    """The keys and values that format_made writes."""
    return {
        "asset": None if asset is None else str(asset),
        "report": None if report is None else str(report),
        "facts": [asdict(row) for row in facts],
        "remarks": [each.as_json() for each in remarks],
        **more,
    }


def format_json(content: Mapping[str, object]) -> str:
    """One JSON object as text, with the version of its schema first."""
    return printable_json(json.dumps({"schema": SCHEMA_VERSION, **content}, indent=2, ensure_ascii=False))
