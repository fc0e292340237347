"""Print what an asset holds: counts, sizes, ranges of the leaf parameters, edits, layers."""

import argparse
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("asset", metavar="ASSET", type=Path, help="asset folder, its .usda, or a look")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of lines")


def run(options: argparse.Namespace) -> int:
    import json
    from dataclasses import asdict

    from usdfoliage.jobs.info import describe_asset, format_info

    info = describe_asset(options.asset)
    print(json.dumps(asdict(info), indent=2, ensure_ascii=False) if options.json else format_info(info))
    return 0
