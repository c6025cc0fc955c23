"""Recorded values as JSON, for programs that show recordings and read no msgpack: Foxglove, Lichtblick, PlotJuggler.

Values keep their fields; bytes become base64, fields that are null are left out. Images and transforms get the schemas
by which viewers know them: https://docs.foxglove.dev/docs/sdk/schemas.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Mapping
from typing import Any, Final

import msgpack

from mkdaemon.record.entry import Entry, EntryKind
from mkdaemon.record.layout import ChannelFacts
from mkdaemon.stamp import NANOSECONDS, nanoseconds

_DEEPEST: Final = 12
"""Deeper parts are shown as plain objects; the deepest of ours is 5."""
_NO_TYPE: Final[dict[str, Any]] = {"type": "object"}
_TYPES: Final = {bool: "boolean", int: "integer", float: "number", str: "string"}


def flatten_schema(schema: Mapping[str, Any]) -> dict[str, Any]:
    """A schema without references, alternatives, nulls, limits, and arrays in arrays.

    Viewers refuse these: https://github.com/lichtblick-suite/lichtblick, packages/mcap-support/src/parseJsonSchema.ts.
    """
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
        item = _flatten(first if isinstance(first, Mapping) else {}, definitions, depth + 1)
        # An object without fields stands for any value: here for an array, or for bytes.
        flat["items"] = dict(_NO_TYPE) if item["type"] == "array" or "contentEncoding" in item else item
    if part.get("format") == "binary":
        flat["contentEncoding"] = "base64"
    return flat


def _type_of(part: Mapping[str, Any]) -> str:
    given = part.get("type")
    if isinstance(given, list):
        given = next((one for one in given if one != "null"), None)
    if isinstance(given, str) and given != "null":
        return given
    values = [*part.get("enum", ()), *([part["const"]] if "const" in part else [])]
    return _TYPES.get(type(values[0]), "string") if values else "object"


SHOWN: Final = frozenset({EntryKind.SAMPLE, EntryKind.SETPOINT, EntryKind.IMAGE})
SchemaSource = Callable[[str], bytes | None]
"""Returns the JSON Schema of `<Name>.v<N>`; None where it is not known."""

_NUMBER: Final = {"type": "number"}
_TEXT: Final = {"type": "string"}
_TIME: Final = {"type": "object", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}}
_IMAGE: Final = {
    "type": "object",
    "properties": {
        "timestamp": _TIME,
        "frame_id": _TEXT,
        "data": {"type": "string", "contentEncoding": "base64"},
        "format": _TEXT,
    },
}
_TRANSFORM: Final = {
    "type": "object",
    "properties": {
        "timestamp": _TIME,
        "parent_frame_id": _TEXT,
        "child_frame_id": _TEXT,
        "translation": {"type": "object", "properties": dict.fromkeys("xyz", _NUMBER)},
        "rotation": {"type": "object", "properties": dict.fromkeys("xyzw", _NUMBER)},
    },
}


class JsonView:
    """Shows samples, setpoints and images."""

    def __init__(self, schemas: SchemaSource) -> None:
        """Show values of known schemas.

        Args:
            schemas: knows them.
        """
        self._schemas = schemas

    def schema(self, facts: ChannelFacts) -> tuple[str, bytes] | None:
        """Name and JSON Schema of what `show` makes of a channel's entries; None where it shows none of them."""
        name = _name_of(facts.encoding)
        if facts.kind not in SHOWN or name is None:
            return None
        known = _WELL_KNOWN.get(name)
        if known is not None:
            return known[0], json.dumps(known[1]).encode()
        source = self._schemas(name)
        if source is None:
            return None
        return f"mk.{name}", json.dumps(flatten_schema(json.loads(source))).encode()

    def show(self, entry: Entry) -> bytes | None:
        """An entry as JSON; None where its payload is not a map."""
        try:
            value = msgpack.unpackb(entry.payload)
            known = _WELL_KNOWN.get(_name_of(entry.encoding) or "")
            shown = json_value(value) if known is None else known[2](entry, value)
            return None if shown is None else json.dumps(shown, allow_nan=False).encode()
        except (ValueError, TypeError, KeyError, RecursionError, msgpack.exceptions.UnpackException):
            return None


def _name_of(encoding: str) -> str | None:
    """Name and version of the schema of an encoding, for example `Attitude.v1`."""
    head, mark, name = encoding.rpartition(";mk.")
    return name if mark and head == "application/msgpack" else None


_SCALARS: Final = frozenset({bool, int, float, str})


def json_value(value: Any) -> Any:
    """A value of msgpack as JSON has it: bytes become base64, fields that are null are left out."""
    # Most parts are plain: a call for each of them would be most of the time.
    if isinstance(value, dict):
        return {
            str(name): part if type(part) in _SCALARS else json_value(part)
            for name, part in value.items()
            if part is not None
        }
    if isinstance(value, list):
        return [part if type(part) in _SCALARS else json_value(part) for part in value]
    return base64.b64encode(value).decode() if isinstance(value, bytes) else value


def _time(entry: Entry) -> dict[str, int]:
    sec, nsec = divmod(nanoseconds(entry.published), NANOSECONDS)
    return {"sec": sec, "nsec": nsec}


def _image(entry: Entry, value: dict[str, Any]) -> dict[str, Any] | None:
    if value["coding"] not in {"jpeg", "png"}:
        return None
    data = base64.b64encode(value["pixels"]).decode()
    return {
        "timestamp": _time(entry),
        "frame_id": f"camera/{value['camera']}",
        "data": data,
        "format": value["coding"],
    }


def _transform(entry: Entry, value: dict[str, Any]) -> dict[str, Any]:
    x, y, z = value["translation"]
    qw, qx, qy, qz = value["quaternion"]
    return {
        "timestamp": _time(entry),
        "parent_frame_id": value["parent"],
        "child_frame_id": value["child"],
        "translation": {"x": x, "y": y, "z": z},
        "rotation": {"x": qx, "y": qy, "z": qz, "w": qw},
    }


_Shown = Callable[[Entry, dict[str, Any]], dict[str, Any] | None]
_WELL_KNOWN: Final[dict[str, tuple[str, dict[str, Any], _Shown]]] = {
    "CameraFrame.v1": ("foxglove.CompressedImage", _IMAGE, _image),
    "Transform.v1": ("foxglove.FrameTransform", _TRANSFORM, _transform),
}
"""Schemas that viewers know: their name, their content, and how a value becomes one."""
