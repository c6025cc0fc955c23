"""Values on the bus: msgpack maps, an encoding string that names them, and their JSON Schema.

Maps and not arrays, so readers need no table and additions break no reader.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, Final, TypeVar

import msgpack
from pydantic import BaseModel, ValidationError

from mkdaemon.telemetry.base import Command
from mkdaemon.telemetry.refusals import Token, refuse

MEDIA_TYPE: Final = "application/msgpack"
MAX_DEPTH: Final = 8
"""Deepest nesting read from a client; the deepest honest one is 4. Packing it again for the audit must not fail."""
_LIMITS: Final = {
    "max_map_len": 256,
    "max_array_len": 512,
    "max_str_len": 4096,
    "max_bin_len": 4096,
    "max_ext_len": 0,
}
"""Longest parts of a map, so that a few bytes cannot claim much memory; a mission has 254 points."""

_Command = TypeVar("_Command", bound=Command)


@dataclass(frozen=True, slots=True)
class TooLong:
    """Stands for a payload that was not read because of its length.

    Attributes:
        size: its length [bytes].
        limit: length its key may have [bytes].
    """

    size: int
    limit: int


@dataclass(frozen=True, slots=True)
class TooLate:
    """Stands for a setpoint that was not read because it was sent too long ago, or at an unknown time.

    Attributes:
        size: its length [bytes].
        age: time since it was sent [s]; None where it has no stamp and came in a flood.
        limit: most that it may be [s].
    """

    size: int
    age: float | None
    limit: float


Payload = bytes | TooLong | TooLate
"""A received payload."""


def encode(value: BaseModel) -> bytes:
    """Pack a model, and the models inside it, as a map.

    Packing through `__dict__` takes half the time of `model_dump`, and room for 256 KB, as msgpack asks for it, twice
    that of room that grows.
    """
    packed: bytes = msgpack.packb(value.__dict__, default=_plain, buf_size=1024)
    return packed


def _plain(value: Any) -> Any:
    # A model first, and without asking it for what it lacks: pydantic takes 2 us to say that there is no `tolist`.
    fields = getattr(value, "__dict__", None)
    return value.tolist() if fields is None else fields


def encode_map(value: dict[str, Any]) -> bytes:
    """Pack a map that may hold models."""
    packed: bytes = msgpack.packb(value, default=_plain)
    return packed


def with_age(packed: bytes, age: float) -> bytes:
    """Add to one of our packed values how old it is [s], as answers with last values carry it."""
    return encode_map({**msgpack.unpackb(packed), "age": round(age, 6)})


def schema_name(model: type[BaseModel]) -> str:
    """Name and version of a model's schema, for example `Attitude.v1`; a wire message's layout is in its class name."""
    return f"{model.__name__}.v{getattr(model, 'schema_version', 1)}"


@cache
def encoding_of(model: type[BaseModel]) -> str:
    """The encoding string of a model, `application/msgpack;mk.<Name>.v<N>`."""
    return f"{MEDIA_TYPE};mk.{schema_name(model)}"


def decode_map(payload: Payload) -> dict[str, Any]:
    """Unpack a received payload; an empty one is an empty map.

    Raises:
        CommandRejectedError: `setpoint_late`; `malformed`: too long, no msgpack, no map, keys
            that are no words or come twice, parts longer or nested deeper than any honest request.
    """
    if isinstance(payload, TooLong):
        raise refuse(Token.MALFORMED, detail=f"{payload.size} bytes are more than {payload.limit}")
    if isinstance(payload, TooLate):
        unstamped = "too many come to know it, and they do not say when they were sent"
        late = "" if payload.age is None else f"sent {payload.age:.2f} s ago; {payload.limit:g} s is the limit"
        raise refuse(Token.SETPOINT_LATE, detail=late or unstamped)
    if not payload:
        return {}
    try:
        value = msgpack.unpackb(payload, object_pairs_hook=_map_of, **_LIMITS)
    except (ValueError, TypeError, RecursionError, msgpack.exceptions.UnpackException) as error:
        raise refuse(Token.MALFORMED, detail=f"no msgpack, {type(error).__name__}") from error
    if not isinstance(value, dict):
        raise refuse(Token.MALFORMED, detail="msgpack, but no map with words as keys")
    if _is_deeper(value, MAX_DEPTH):
        raise refuse(Token.MALFORMED, detail=f"it is nested deeper than {MAX_DEPTH}")
    return value


def _map_of(pairs: list[tuple[Any, Any]]) -> dict[str, Any]:
    fields = dict(pairs)
    if len(fields) != len(pairs):
        raise refuse(Token.MALFORMED, detail="a key comes twice")
    if not all(isinstance(key, str) for key in fields):
        raise refuse(Token.MALFORMED, detail="msgpack, but no map with words as keys")
    return fields


def _is_deeper(value: dict[str, Any] | list[Any], levels: int) -> bool:
    parts = value.values() if isinstance(value, dict) else value
    return levels == 0 or any(_is_deeper(part, levels - 1) for part in parts if isinstance(part, dict | list))


def read_command(model: type[_Command], payload: Payload) -> _Command:
    """Unpack and check a command.

    Raises:
        CommandRejectedError: `malformed` or `bad_field`.
    """
    return check_command(model, decode_map(payload))


def check_command(model: type[_Command], fields: dict[str, Any]) -> _Command:
    """Check the fields of a command.

    Raises:
        CommandRejectedError: `bad_field`.
    """
    try:
        return model.model_validate(fields)
    except ValidationError as error:
        raise refuse(Token.BAD_FIELD, name=model.__name__, detail=first_mistake(error)) from error


def first_mistake(error: ValidationError) -> str:
    """The first thing a validation found wrong, in a few words."""
    mistakes = error.errors(include_url=False, include_context=False, include_input=False)
    first = mistakes[0]
    field = ".".join(str(part) for part in first["loc"]) or "the map"
    if first["type"] == "extra_forbidden":
        return f"{field} is not a field of it"
    reason = first["msg"].removeprefix("Value error, ")
    more = f" (and {len(mistakes) - 1} more)" if len(mistakes) > 1 else ""
    return f"{field}: {reason[:1].lower()}{reason[1:]}{more}"
