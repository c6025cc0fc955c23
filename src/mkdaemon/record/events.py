"""Events of the flight core in a recording: one entry for each event and each tick.

The payload is a msgpack map of `event`, its fields, and `reply`, what the core answered; the class of the event is the
last part of the key. Events that follow from recorded bytes by pure code are left out (`DERIVED`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from enum import Enum
from functools import cache
from hashlib import blake2b
from typing import Any, Final, get_type_hints

import msgpack
from pydantic import TypeAdapter

from mkdaemon.control.events import (
    Event,
    FlightctrlReported,
    FrameConfirmed,
    FrameSent,
    LeaseAsked,
    MotorsReported,
    Reply,
    StateValue,
)
from mkdaemon.errors import CommandRejectedError, MkError
from mkdaemon.telemetry.control import LeaseGrant
from mkdaemon.telemetry.setpoint import SETPOINTS, Setpoint

CORE: Final = "core/"
"""Beginning of the keys of the flight core's events, after `mk/<vehicle>/`."""
TICK: Final = f"{CORE}Tick"
"""The flight core decided: a map of `slept` [s], or nothing."""
DERIVED: Final = frozenset({StateValue, MotorsReported, FlightctrlReported, FrameSent, FrameConfirmed})
"""A replay makes them of recorded bytes, as the daemon does."""
_KIND: Final = "kind of setpoint"
_EVENTS: Final[Mapping[str, type[Event]]] = {cls.__name__: cls for cls in Event.__subclasses__()}
_FIELDS: Final[dict[type, tuple[str, ...] | None]] = {}
_SETPOINTS: Final = {kind.suffix: kind for kind in SETPOINTS}


def suffix_of(event: Event) -> str:
    """The key of an event, without `mk/<vehicle>/`."""
    return CORE + type(event).__name__


def pack_event(event: Event, reply: Reply | None, key: bytes | None = None) -> bytes:
    """An event and its answer as bytes.

    Args:
        event: input of the core.
        reply: what it answered; None where it failed on it.
        key: by which secrets of leases are replaced, so that equal ones stay equal and none can be read; None where
            they are replaced already.
    """
    if key is not None and isinstance(event, LeaseAsked):
        request = event.request.model_copy(update={"secret": _hidden(event.request.secret, key)})
        event = replace(event, request=request, secret=_hidden(event.secret, key))
        if reply is not None and isinstance(reply.lease, LeaseGrant):
            reply = replace(reply, lease=reply.lease.model_copy(update={"secret": _hidden(reply.lease.secret, key)}))
    packed: bytes = msgpack.packb({"event": _plain(event), "reply": reply}, default=_plain, buf_size=1024)
    return packed


def unpack_event(suffix: str, payload: bytes) -> Event:
    """The event of an entry.

    Raises:
        MkError: another version recorded it.
    """
    name = suffix.removeprefix(CORE)
    try:
        cls = _EVENTS[name]
        packed = msgpack.unpackb(payload, strict_map_key=False)["event"]
        return cls(**{field: _built(hint, packed[field]) for field, hint in _hints(name).items()})
    except (ValueError, TypeError, LookupError, AttributeError, msgpack.exceptions.UnpackException) as error:
        reason = " ".join(str(error).split())[:200]
        msg = f"{suffix}: not as the event is today ({reason}); verify the recording with the version that made it"
        raise MkError(msg) from error


def _hidden(secret: str, key: bytes) -> str:
    return secret and blake2b(secret.encode(), key=key, digest_size=8).hexdigest()


def _plain(value: Any) -> Any:
    """What msgpack can pack of a value; the frequent ones first."""
    names = _names(type(value))
    if names is not None:
        return {name: getattr(value, name) for name in names}
    if isinstance(value, Setpoint):
        return {_KIND: value.suffix, **value.__dict__}
    if isinstance(value, CommandRejectedError):
        return {"token": value.token, "reason": value.reason, "fix": value.fix}
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, Mapping):
        return dict(value)
    inner = getattr(value, "__dict__", None)
    return value.tolist() if inner is None else inner


def _names(cls: type) -> tuple[str, ...] | None:
    """The fields of a dataclass; None for what is none. Asking `dataclasses` each time takes longer than packing."""
    if cls not in _FIELDS:
        _FIELDS[cls] = tuple(field.name for field in fields(cls)) if is_dataclass(cls) else None
    return _FIELDS[cls]


def _built(hint: Any, packed: Any) -> Any:
    """A field as it was."""
    if hint is Setpoint:
        return _adapter(_SETPOINTS[packed.pop(_KIND)]).validate_python(packed, strict=False)
    if hint is CommandRejectedError:
        return CommandRejectedError(**packed)
    return _adapter(hint).validate_python(packed, strict=False)


@cache
def _hints(name: str) -> dict[str, Any]:
    return get_type_hints(_EVENTS[name])


@cache
def _adapter(hint: Any) -> TypeAdapter[Any]:
    return TypeAdapter(hint)
