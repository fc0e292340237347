#!/usr/bin/env python3
"""Write docs/json_output.schema.json, the JSON Schema of what each command prints with --json.

usage: tools/json_reference.py
"""

import dataclasses
import json
import types
import typing
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from usdfoliage.asset.looks.plain import PlainLook
from usdfoliage.asset.validation.findings import Finding
from usdfoliage.cli.json_output import SCHEMA_VERSION
from usdfoliage.jobs.edits.edit import Change
from usdfoliage.jobs.export.request import PROFILES
from usdfoliage.jobs.info import AssetInfo
from usdfoliage.jobs.report.table import Row

PAGE = Path(__file__).resolve().parents[1] / "docs" / "json_output.schema.json"
TEXT, NUMBER, COUNT = {"type": "string"}, {"type": "number"}, {"type": "integer"}
TEXT_OR_NULL = {"type": ["string", "null"]}
SECONDS = {"type": "object", "additionalProperties": NUMBER}
_SIMPLE: dict[object, dict[str, Any]] = {
    str: TEXT,
    Path: TEXT,
    int: COUNT,
    float: NUMBER,
    bool: {"type": "boolean"},
    types.NoneType: {"type": "null"},
    object: {},
}


def schema_of(kind: Any) -> dict[str, Any]:
    """The schema of what json makes of a value of this type."""
    if kind in _SIMPLE:
        return _SIMPLE[kind]
    if dataclasses.is_dataclass(kind):
        hints = typing.get_type_hints(kind)
        return keys({field.name: schema_of(hints[field.name]) for field in dataclasses.fields(kind)})
    origin, parts = typing.get_origin(kind), typing.get_args(kind)
    if origin in (typing.Union, types.UnionType):
        return {"anyOf": [schema_of(part) for part in parts]}
    if origin is tuple and Ellipsis not in parts:
        return {"type": "array", "prefixItems": [schema_of(part) for part in parts], "minItems": len(parts)}
    if origin in (tuple, Sequence):
        return {"type": "array", "items": schema_of(parts[0])}
    if origin is Mapping:
        return {"type": "object", "additionalProperties": schema_of(parts[1])}
    raise TypeError(f"no schema is known of {kind}")


def keys(properties: Mapping[str, Any]) -> dict[str, Any]:
    """An object that has all of these keys, and perhaps others in later versions."""
    return {"type": "object", "properties": dict(properties), "required": list(properties)}


def listed(items: Mapping[str, Any]) -> dict[str, Any]:
    return {"type": "array", "items": dict(items)}


def made(**more: Any) -> dict[str, Any]:
    """What a command prints that makes something."""
    remedy = listed({"anyOf": [TEXT, {"type": "object", "additionalProperties": TEXT_OR_NULL}]})
    remark = keys({**dict.fromkeys(("code", "severity", "subject", "text"), TEXT), "remedy": remedy})
    return keys(
        {
            "asset": TEXT_OR_NULL,
            "report": TEXT_OR_NULL,
            "facts": listed(schema_of(Row)),
            "remarks": listed(remark),
            **more,
        }
    )


def commands() -> dict[str, dict[str, Any]]:
    """By the name of each command that has --json."""
    figures = {"type": ["object", "null"]}
    plant = {
        "verdict": {"enum": ["built", "failed", "fault", "invalid", "skipped"]},
        "error": TEXT,
        "errors": COUNT,
        "withheld": figures,
        "seconds": SECONDS,
    }
    of_batch = made(**plant, name=TEXT, capture=TEXT)
    step = keys({"step": TEXT, "chunks": COUNT, "needs": listed(TEXT), "estimate_s": NUMBER})
    steps = keys({"steps": listed(step)})
    counts = dict.fromkeys(("errors", "warnings", "accepted"), COUNT)
    validated = {
        "asset": TEXT,
        "scene": _SIMPLE[bool],
        **counts,
        "variantSelections": listed(TEXT),
        "usdValidationNvidia": TEXT_OR_NULL,
        "findings": listed(schema_of(Finding)),
    }
    return {
        "bake": made(),
        "batch": made(plants=listed(of_batch)),
        "branches": made(variations=listed(TEXT)),
        "build": made(**plant),
        "capture": made(cloud=TEXT, seconds=SECONDS),
        "crown": made(),
        "forest": {"anyOf": [made(), steps]},
        "edit": made(changes=listed(schema_of(Change))),
        "export": made(profile={"enum": list(PROFILES)}),
        "info": {"anyOf": [schema_of(AssetInfo), schema_of(PlainLook)]},
        "leaves": made(withheld=figures),
        "lobed": {"anyOf": [made(), made(leaves=listed(made()))]},
        "scatter": made(),
        "sketch": made(),
        "task": steps,
        "validate": keys(validated),
    }


def page() -> str:
    """The text of the file."""
    versioned = keys({"schema": {"const": SCHEMA_VERSION}})
    schema = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "What usdfoliage prints with --json",
        "description": "$defs has a schema for each command; each object has the version in its key schema. Other keys "
        "may be added without a new version.",
        "$defs": {name: {"allOf": [versioned, content]} for name, content in commands().items()},
    }
    return json.dumps(schema, indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
