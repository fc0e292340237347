"""Make docs/schema_reference.md: every schema and every property of it, out of schemas/usdFoliage/schema.usda.

usage: .venv/bin/python tools/schema_reference.py [-o FILE]

The doc of a property in schema.usda is one sentence of parts with semicolons between them: meaning; unit: …; range: …;
length: …. Edit it there, then run tools/generate_schema.py and this.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

from pxr import Sdf

ROOT = Path(__file__).resolve().parents[1]
SCHEMA_SOURCE = ROOT / "schemas" / "usdFoliage" / "schema.usda"
SCHEMA_PAGE = ROOT / "docs" / "schema_reference.md"
COLUMNS = ("property", "type", "default", "meaning", "unit", "range", "length")
PARTS = ("unit", "range", "length")

HEAD = """\
<!-- made by tools/schema_reference.py from schemas/usdFoliage/schema.usda; do not edit -->

# Schemas

All are API schemas without code, of the library `usdFoliage`: the prim keeps its own type (Mesh, PointInstancer) and
draws in an application that does not know them. `eval "$(usdfoliage env)"` makes them known to any USD program; an
asset opens without that, and loses nothing. Lengths are in metres where no unit is stated, angles in degrees.

A default is a schema's fallback: it does not reach a shader, so usdfoliage writes every edit into the asset.
"""


def schema_page(source: Path = SCHEMA_SOURCE) -> str:
    """The whole page."""
    layer = Sdf.Layer.FindOrOpen(str(source))
    classes = [prim for prim in layer.rootPrims if "apiSchemaType" in prim.customData]
    rows = [
        f"| [`{prim.name}`](#{prim.name.lower()}) | {_applies_to(prim)} | {_paragraphs(prim.documentation)[0]} |"
        for prim in classes
    ]
    blocks = [HEAD.rstrip("\n"), "\n".join(["| schema | applies to | what it is |", "| --- | --- | --- |", *rows])]
    for prim in classes:
        blocks += [f"## {prim.name}", f"Applies to {_applies_to(prim)}.", *_paragraphs(prim.documentation)]
        head = [f"| {' | '.join(COLUMNS)} |", f"| {' | '.join('---' for _ in COLUMNS)} |"]
        blocks.append("\n".join([*head, *_property_rows(prim)]))
    return "\n\n".join(blocks) + "\n"


def split_doc(text: str) -> dict[str, str]:
    """The parts of a property's doc: meaning, unit, range and length as far as they are stated."""
    found: dict[str, str] = {"meaning": ""}
    part = "meaning"
    for piece in " ".join(text.split()).rstrip(".").split("; "):
        name, _, rest = piece.partition(": ")
        if name in PARTS:
            part, found[name] = name, rest
        else:  # a semicolon within a part
            found[part] = f"{found[part]}; {piece}" if found[part] else piece
    return found


def _property_rows(prim: Sdf.PrimSpec) -> Iterator[str]:
    for spec in prim.properties:
        parts = split_doc(spec.documentation)
        is_attribute = isinstance(spec, Sdf.AttributeSpec)
        kind = str(spec.typeName) if is_attribute else "rel"
        default = "" if not is_attribute or spec.default is None else f"`{spec.default}`"
        cells = [f"`{spec.name}`", f"`{kind}`", default, parts["meaning"], *(parts.get(name, "") for name in PARTS)]
        yield f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


def _applies_to(prim: Sdf.PrimSpec) -> str:
    return ", ".join(f"`{kind}`" for kind in prim.customData["apiSchemaCanOnlyApplyTo"])


def _paragraphs(text: str) -> list[str]:
    return [" ".join(paragraph.split()) for paragraph in text.split("\n\n")]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=SCHEMA_PAGE, help="page to write")
    parser.parse_args().output.write_text(schema_page(), encoding="utf-8")


if __name__ == "__main__":
    main()
