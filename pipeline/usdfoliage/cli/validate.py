"""Check an asset or a scene with the validators of usdfoliage, USD and NVIDIA.

An asset is checked in all its variants, and a look over its asset. A scene that refers to assets is checked in the
selection that it has, with its edits, but without the rules for an asset's own files and those of NVIDIA. The rules of
NVIDIA need the package usd-validation-nvidia.

The command prints one line for each finding: severity, validator, prim, and what is wrong. The exit code is 0 without
an error, and 3 with an error. The studio profile lists warnings that are accepted, with reasons; the last line counts
them, and -v prints them. The profile also has rules of the studio for names, kinds, textures, sizes, metadata and
variant sets.
"""

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from usdfoliage.cli.json_output import add_json, format_json
from usdfoliage.cli.options.access import reads_alone
from usdfoliage.files.printable import printable
from usdfoliage.files.write_gate import Access

if TYPE_CHECKING:
    from usdfoliage.asset.validation.findings import Finding
    from usdfoliage.asset.validation.validate import ValidationReport

EXIT_WITH_ERRORS = 3


def add_arguments(parser: argparse.ArgumentParser) -> None:
    files = parser.add_argument_group("input and output")
    files.add_argument(
        "asset",
        type=Path,
        metavar="ASSET",
        help="The input is the folder of an asset, its .usda file, a look, or a scene.",
    )
    files.add_argument(
        "--profile",
        type=Path,
        metavar="FILE",
        help="This TOML file has the studio's rules and accepted warnings. The default is the file that comes with "
        "usdfoliage.",
    )
    add_json(parser.add_argument_group("printed output"))


def declare(options: argparse.Namespace) -> Access:
    return reads_alone(options.asset, options.profile)


def run(options: argparse.Namespace) -> int:
    from usdfoliage.asset.validation.studio_profile import default_profile, read_profile
    from usdfoliage.asset.validation.validate import validate_asset

    profile = read_profile(options.profile or default_profile())
    report = validate_asset(options.asset, profile)
    print(_as_json(report) if options.json else _as_lines(report, options.verbose))
    return EXIT_WITH_ERRORS if report.open_errors else 0


def _as_lines(report: "ValidationReport", verbose: bool) -> str:
    lines = [printable(_line(finding)) for finding in report.findings if verbose or not finding.accepted]
    accepted = sum(bool(finding.accepted) for finding in report.findings)
    counts = [_count(report.count("error"), "error"), _count(report.count("warning"), "warning")]
    if report.count("info"):
        counts.append(f"{report.count('info')} info")
    counts.append(f"{accepted} accepted" + (" (-v shows them)" if accepted and not verbose else ""))
    if report.is_scene:
        lines.append(
            "note: this is a scene; validate an asset itself for its other variants, its files and NVIDIA's rules"
        )
    elif not report.nvidia:
        lines.append("note: usd-validation-nvidia did not run: it is not installed, or a layer cannot be read")
    looked = "as selected" if report.is_scene else f"in {_count(len(report.selections), 'variant selection')}"
    lines.append(f"{printable(report.asset)}: {', '.join(counts)}, {looked}")
    return "\n".join(lines)


def _line(finding: "Finding") -> str:
    rule = f"{finding.validator}.{finding.error}" if finding.error else finding.validator
    where = f" [{finding.where}]" if finding.where else ""
    if finding.accepted:
        return f"accepted: {rule} {finding.path}{where}: {finding.message} (accepted: {finding.accepted})"
    return f"{finding.severity}: {rule} {finding.path}{where}: {finding.message}"


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def _as_json(report: "ValidationReport") -> str:
    content = {
        "asset": str(report.asset),
        "scene": report.is_scene,
        "errors": report.count("error"),
        "warnings": report.count("warning"),
        "accepted": sum(bool(finding.accepted) for finding in report.findings),
        "variantSelections": list(report.selections),
        "usdValidationNvidia": report.nvidia or None,
        "findings": [asdict(finding) for finding in report.findings],
    }
    return format_json(content)
