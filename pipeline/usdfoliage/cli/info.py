"""Print what an asset contains: counts, sizes, leaf parameters, edits and layers."""

import argparse
from pathlib import Path

from usdfoliage.cli.json_output import add_json


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument_group("input and output").add_argument(
        "asset", metavar="ASSET", type=Path, help="The input is the folder of an asset, its .usda file, or a look."
    )
    add_json(parser.add_argument_group("printed output"))


def run(options: argparse.Namespace) -> int:
    import json
    from dataclasses import asdict

    from usdfoliage.jobs.info import describe_asset, format_info

    info = describe_asset(options.asset)
    print(json.dumps(asdict(info), indent=2, ensure_ascii=False) if options.json else format_info(info))
    return 0
