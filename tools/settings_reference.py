"""Make docs/settings.md: every setting of a build, with its default and what it means.

usage: .venv/bin/python tools/settings_reference.py [-o FILE]

What a setting means, its unit and its range are the comment beside its field in the code, as `usdfoliage build
--print-plan` prints it too. Edit it there.
"""

import argparse
import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from usdfoliage.jobs.plant.settings import BuildSettings
from usdfoliage.jobs.work.field_comments import field_comments, split_comment
from usdfoliage.jobs.work.renamed_settings import RENAMED_SETTINGS
from usdfoliage.jobs.work.settings_file import format_value

SETTINGS_PAGE = Path(__file__).resolve().parents[1] / "docs" / "settings.md"
ONCE = ("seed", "threads")  # stated for all tables at once, at the top or by an option

HEAD = """\
<!-- made by tools/settings_reference.py from the comments beside the settings in the code; do not edit -->

# Settings of a build

    usdfoliage build --print-plan > plant.toml            # all of them, with their defaults and these comments
    usdfoliage build CAPTURE -o ASSET --plan plant.toml   # keep the lines that you change: the rest stays as it is

A table of the file is a stage, and a table within it a step of that stage: `[capture.depth]` holds `sources = 9`.
`"auto"` leaves the choice to the data. A name that does not exist, a wrong type and a value out of range are errors
that name the setting and the file. A changed setting does again only the stages that depend on it. `usdfoliage capture`
and `usdfoliage leaves` have the same tables, without the name of the stage, in `--print-settings` and `--settings`.
`usdfoliage leaves` also has `[capture.depth]`, `[capture.sky]` and `capture.mask`, for photographs without depth.

Few are worth changing for one plant: `plant.species`, `branches.roots`, `branches.cloud_leaves`, `foliage.kind`,
`capture.pose_estimation.focal_px`, `capture.depth.max_side_px`, and `make` of a stage that is not wanted.

"""

OLD_NAMES = """\
These names of an earlier version are still read, with a warning that gives the new name. The next version does not read
them."""


def settings_page() -> str:
    """The whole page."""
    blocks = [HEAD.rstrip("\n")]
    for place, settings in walk_settings(BuildSettings()):
        rows = list(_rows(settings, at_top=not place))
        if not place or "." not in place:
            blocks.append(f"## {place or 'all stages'}")
        else:
            blocks.append(f"### {place}")
        blocks.append((type(settings).__doc__ or "").splitlines()[0])
        if rows:
            blocks.append(
                "\n".join(
                    ["| setting | default | unit | range | what it is |", "| --- | --- | --- | --- | --- |", *rows]
                )
            )
    blocks.append("## Old names")
    blocks.append(OLD_NAMES)
    renamed = [f"| `{old}` | `{new}` |" for old, new in RENAMED_SETTINGS.items()]
    blocks.append("\n".join(["| old name | name |", "| --- | --- |", *renamed]))
    return "\n\n".join(blocks) + "\n"


def walk_settings(settings: Any, place: str = "") -> Iterator[tuple[str, Any]]:
    """Every dataclass of nested settings, by its table's name, the outer before the inner."""
    yield place, settings
    for field in dataclasses.fields(settings):
        value = getattr(settings, field.name)
        if dataclasses.is_dataclass(value):
            yield from walk_settings(value, f"{place}.{field.name}" if place else field.name)


def _rows(settings: Any, *, at_top: bool) -> Iterator[str]:
    comments = field_comments(type(settings))
    for field in dataclasses.fields(settings):
        value = getattr(settings, field.name)
        if dataclasses.is_dataclass(value) or (field.name in ONCE and not at_top):
            continue
        meaning, unit, allowed = split_comment(comments.get(field.name, ""))
        cells = (f"`{field.name}`", f"`{format_value(value)}`", unit, allowed, meaning)
        yield f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=SETTINGS_PAGE, help="page to write")
    parser.parse_args().output.write_text(settings_page(), encoding="utf-8")


if __name__ == "__main__":
    main()
