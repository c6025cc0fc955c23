"""JSON Schemas as viewers can read them: no references, no alternatives, a type everywhere.

Foxglove and Lichtblick throw on `$ref`, `anyOf` and an `enum` without a type, all of which pydantic writes.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

_DEEPEST: Final = 12
"""Deeper parts are shown as plain objects; the deepest of ours is 5."""
_NO_TYPE: Final[dict[str, Any]] = {"type": "object"}
_TYPES: Final = {bool: "boolean", int: "integer", float: "number", str: "string"}


def flatten_schema(schema: Mapping[str, Any]) -> dict[str, Any]:
    """A schema without references, alternatives, nulls and limits."""
    return _flatten(schema, schema.get("$defs", {}), 0)


def _flatten(part: Mapping[str, Any], definitions: Mapping[str, Any], depth: int) -> dict[str, Any]:
    if depth > _DEEPEST:
        return dict(_NO_TYPE)
    described = {"description": part["description"]} if isinstance(part.get("description"), str) else {}
    if "$ref" in part:
        found = definitions.get(str(part["$ref"]).rpartition("/")[2], {})
        return {**_flatten(found, definitions, depth + 1), **described}
    for word in ("anyOf", "oneOf", "allOf"):
        choices = [one for one in part.get(word, ()) if one.get("type") != "null"]
        if choices:
            return {**_flatten(choices[0], definitions, depth + 1), **described}
    flat: dict[str, Any] = {"type": _type_of(part), **described}
    if "enum" in part:
        flat["enum"] = list(part["enum"])
    if flat["type"] == "object" and "properties" in part:
        properties = part["properties"].items()
        flat["properties"] = {name: _flatten(one, definitions, depth + 1) for name, one in properties}
    if flat["type"] == "array":
        first: object = part.get("items") or next(iter(part.get("prefixItems", ())), None)
        flat["items"] = _flatten(first if isinstance(first, Mapping) else {}, definitions, depth + 1)
    if part.get("format") == "binary":
        flat["contentEncoding"] = "base64"
    return flat


def _type_of(part: Mapping[str, Any]) -> str:
    given = part.get("type")
    if isinstance(given, list):
        given = next((one for one in given if one != "null"), None)
    if isinstance(given, str):
        return given
    values = [*part.get("enum", ()), *([part["const"]] if "const" in part else [])]
    return _TYPES.get(type(values[0]), "string") if values else "object"
