"""Print what an asset contains: counts, sizes, leaf parameters, edits and layers."""

import argparse
from pathlib import Path

from usdfoliage.cli.json_output import add_json
from usdfoliage.cli.options.access import reads_alone
from usdfoliage.files.write_gate import Access


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument_group("input and output").add_argument(
        "asset", metavar="ASSET", type=Path, help="The input is the folder of an asset, its .usda file, or a look."
    )
    add_json(parser.add_argument_group("printed output"))


def declare(options: argparse.Namespace) -> Access:
    return reads_alone(options.asset)


def run(options: argparse.Namespace) -> int:
    from dataclasses import asdict

    from usdfoliage.asset.looks.plain import read_plain_look
    from usdfoliage.cli.json_output import format_json
    from usdfoliage.jobs.info import describe_asset, format_info, format_plain_look

    plain = read_plain_look(options.asset)
    if plain is not None:
        print(format_json({**asdict(plain), "path": str(plain.path)}) if options.json else format_plain_look(plain))
        return 0
    info = describe_asset(options.asset)
    print(format_json(asdict(info)) if options.json else format_info(info))
    return 0
