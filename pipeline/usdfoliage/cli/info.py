"""Print what an asset contains: counts, sizes, leaf parameters, edits and layers."""

import argparse
from pathlib import Path

from usdfoliage.cli.json_output import add_json
from usdfoliage.cli.options.access import reads_alone
from usdfoliage.files.printable import printable_json
from usdfoliage.files.write_gate import Access


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument_group("input and output").add_argument(
        "asset", metavar="ASSET", type=Path, help="The input is the folder of an asset, its .usda file, or a look."
    )
    add_json(parser.add_argument_group("printed output"))


def declare(options: argparse.Namespace) -> Access:
    return reads_alone(options.asset)


def run(options: argparse.Namespace) -> int:
    import json
    from dataclasses import asdict

    from usdfoliage.jobs.info import describe_asset, format_info

    info = describe_asset(options.asset)
    if options.json:
        print(printable_json(json.dumps(asdict(info), indent=2, ensure_ascii=False)))
    else:
        print(format_info(info))
    return 0
