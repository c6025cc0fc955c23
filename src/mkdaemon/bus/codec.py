"""Values on the bus: msgpack maps, an encoding string that names them, and their JSON Schema.

Maps and not arrays, so readers need no table and additions break nobody.
"""

from __future__ import annotations

from typing import Any, Final, TypeVar

import msgpack
from pydantic import BaseModel, ValidationError

from mkdaemon.telemetry.base import Command
from mkdaemon.telemetry.refusals import Token, refuse

MEDIA_TYPE: Final = "application/msgpack"
MAX_MAP_BYTES: Final = 1 << 20
"""Longest payload read from a client [bytes]; the largest honest one is a settings block of a few hundred."""

_Command = TypeVar("_Command", bound=Command)


def encode(value: BaseModel) -> bytes:
    """Pack a model, and the models inside it, as a map.

    Packing through `__dict__` takes half the time of `model_dump`.
    """
    packed: bytes = msgpack.packb(value.__dict__, default=_plain)
    return packed


def _plain(value: Any) -> Any:
    # A model first, and without asking it for what it lacks: pydantic takes 2 us to say that there is no `tolist`.
    fields = getattr(value, "__dict__", None)
    return value.tolist() if fields is None else fields


def encode_map(value: dict[str, Any]) -> bytes:
    """Pack a map that may hold models."""
    packed: bytes = msgpack.packb(value, default=_plain)
    return packed


def schema_name(model: type[BaseModel]) -> str:
    """Name and version of a model's schema, for example `Attitude.v1`; a wire message's layout is in its class name."""
    return f"{model.__name__}.v{getattr(model, 'schema_version', 1)}"


def encoding_of(model: type[BaseModel]) -> str:
    """The encoding string of a model, `application/msgpack;mk.<Name>.v<N>`."""
    return f"{MEDIA_TYPE};mk.{schema_name(model)}"


def decode_map(raw: bytes) -> dict[str, Any]:
    """Unpack what somebody sent; nothing at all is an empty map.

    Raises:
        CommandRejectedError: `malformed`: too long, no msgpack, no map, or keys that are no words.
    """
    if not raw:
        return {}
    if len(raw) > MAX_MAP_BYTES:
        raise refuse(Token.MALFORMED, detail=f"{len(raw)} bytes are more than {MAX_MAP_BYTES}")
    try:
        value = msgpack.unpackb(raw)
    except (ValueError, TypeError, RecursionError, msgpack.exceptions.UnpackException) as error:
        raise refuse(Token.MALFORMED, detail=f"no msgpack, {type(error).__name__}") from error
    if not isinstance(value, dict) or not all(isinstance(key, str) for key in value):
        raise refuse(Token.MALFORMED, detail="msgpack, but no map with words as keys")
    return value


def read_command(model: type[_Command], raw: bytes) -> _Command:
    """Unpack and check a command.

    Raises:
        CommandRejectedError: `malformed` or `bad_field`.
    """
    fields = decode_map(raw)
    try:
        return model.model_validate(fields)
    except ValidationError as error:
        raise refuse(Token.BAD_FIELD, name=model.__name__, detail=first_mistake(error)) from error


def first_mistake(error: ValidationError) -> str:
    """The first thing a validation found wrong, in a few words."""
    mistakes = error.errors(include_url=False)
    first = mistakes[0]
    field = ".".join(str(part) for part in first["loc"]) or "the map"
    if first["type"] == "extra_forbidden":
        return f"{field} is no field of it"
    reason = first["msg"].removeprefix("Value error, ")
    more = f" (and {len(mistakes) - 1} more)" if len(mistakes) > 1 else ""
    return f"{field}: {reason[:1].lower()}{reason[1:]}{more}"
