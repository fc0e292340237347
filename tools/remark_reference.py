"""Make the chapter "What the remarks mean" of docs/input_guide.md: every code with what it means and what to do.

usage: .venv/bin/python tools/remark_reference.py [-o FILE]

The tables stand between two markers of the page, and the rest of it stays. Edit them in usdfoliage/remark_codes.py.
"""

import argparse
from pathlib import Path

from usdfoliage.remark_codes import SECTIONS, SEVERITIES, RemarkSection

GUIDE = Path(__file__).resolve().parents[1] / "docs" / "input_guide.md"
BEGIN = "<!-- made by tools/remark_reference.py from usdfoliage/remark_codes.py; do not edit -->"
END = "<!-- end of what tools/remark_reference.py makes -->"


def remark_tables() -> str:
    """The tables, a section each."""
    return "\n\n".join(_table(section) for section in SECTIONS)


def with_tables(page: str) -> str:
    """The page with its tables made again; ValueError where it lacks a marker."""
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"the page needs both markers, {BEGIN} and {END}")
    return f"{before}{BEGIN}\n\n{remark_tables()}\n\n{END}{after}"


def _table(section: RemarkSection) -> str:
    kinds = sorted(section.kinds.items(), key=lambda each: SEVERITIES.index(each[1].severity))
    rows = [f"| `{code}` | {kind.severity} | {kind.meaning} | {kind.action} |" for code, kind in kinds]
    return "\n".join(
        [f"### {section.title}", "", "| code | | what it means | what to do |", "| --- | --- | --- | --- |", *rows]
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=GUIDE, help="page to write")
    page = with_tables(GUIDE.read_text(encoding="utf-8"))
    parser.parse_args().output.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
