"""What commands print with --json, checked against docs/json_output.schema.json."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

SCHEMAS = json.loads((Path(__file__).parents[3] / "docs" / "json_output.schema.json").read_text(encoding="utf-8"))[
    "$defs"
]
_TYPES: Mapping[str, type | tuple[type, ...]] = {
    "object": dict,
    "array": list,
    "string": str,
    "number": (int, float),
    "integer": int,
    "boolean": bool,
    "null": type(None),
}
_KNOWN = frozenset(
    ("type", "properties", "required", "additionalProperties", "items", "prefixItems", "minItems", "allOf", "anyOf")
)


def read_output(command: str, text: str) -> dict[str, Any]:
    """The object that a command has printed; it conforms to the command's schema."""
    content = json.loads(text)
    assert find_fault(content, SCHEMAS[command]) == ""
    return content


def find_fault(value: Any, schema: Mapping[str, Any], at: str = "$") -> str:
    """The first place where a value does not conform, empty where it does; for what our schemas use of JSON Schema."""
    assert set(schema) <= _KNOWN | {"const", "enum"}, f"unknown keys in {sorted(schema)}"
    names = schema.get("type", [])
    names = [names] if isinstance(names, str) else names
    if names and not any(
        isinstance(value, _TYPES[name]) and (name == "boolean" or not isinstance(value, bool)) for name in names
    ):
        return f"{at} is {value!r}, not {' or '.join(names)}"
    if "const" in schema and value != schema["const"]:
        return f"{at} is {value!r}, not {schema['const']!r}"
    if "enum" in schema and value not in schema["enum"]:
        return f"{at} is {value!r}, none of {schema['enum']}"
    faults = []
    if "anyOf" in schema:
        tried = [find_fault(value, each, at) for each in schema["anyOf"]]
        faults.append("" if "" in tried else "; ".join(tried))
    faults += [find_fault(value, each, at) for each in schema.get("allOf", ())]
    if isinstance(value, dict):
        properties = schema.get("properties", {})
        faults += [f"{at} has no {name}" for name in schema.get("required", ()) if name not in value]
        for name, each in value.items():
            faults.append(
                find_fault(each, properties.get(name, schema.get("additionalProperties", {})), f"{at}.{name}")
            )
    if isinstance(value, list):
        first = schema.get("prefixItems", [])
        if len(value) < schema.get("minItems", 0):
            faults.append(f"{at} has {len(value)} items")
        for number, each in enumerate(value):
            part = first[number] if number < len(first) else schema.get("items", {})
            faults.append(find_fault(each, part, f"{at}[{number}]"))
    return next((fault for fault in faults if fault), "")
