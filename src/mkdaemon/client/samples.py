"""Values from the bus: the map as it came, and the typed value it stands for."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import msgpack

from mkdaemon.errors import ProtocolError

if TYPE_CHECKING:
    from pydantic import BaseModel

    from mkdaemon.protocol import WireMessage


@dataclass(frozen=True)
class Sample:
    """A value from the bus.

    Attributes:
        suffix: key without `mk/<vehicle>/`.
        fields: the map as it came; a schema is parsed JSON.
        encoding: as published, for example `application/msgpack;mk.Attitude.v1`.
    """

    suffix: str
    fields: dict[str, Any]
    encoding: str

    @property
    def schema(self) -> str | None:
        """Name and version of the schema, for example `Attitude.v1`; None where the encoding names none."""
        head, mark, name = self.encoding.rpartition(";mk.")
        return name if mark and head else None

    @property
    def age(self) -> float | None:
        """Time since the daemon published it, when the query was answered [s]; None for a value that was watched."""
        age = self.fields.get("age")
        return float(age) if isinstance(age, int | float) else None

    @cached_property
    def value(self) -> Any:
        """The telemetry value, for example an `Attitude`; the map where its schema is not known here.

        A frame under `rx/` or `tx/` is a `FrameSample` whose `fields` are the typed message.

        Raises:
            ProtocolError: the map does not fit the schema it names, or its key carries another one.
        """
        carried = _schema_at(self.suffix)
        if carried is not None and self.schema != carried:
            raise ProtocolError(f"{self.suffix} carries {self.schema}, no {carried}; update mkdaemon here or there")
        return typed_value(self.schema, self.fields)

    @property
    def known(self) -> Any:
        """The same; None where another version publishes it differently."""
        with suppress(ProtocolError):
            return self.value
        return None


def read_payload(encoding: str, raw: bytes) -> dict[str, Any]:
    """Unpack a payload; a value that is not a map is under `value`, an unreadable or foreign payload under `raw`."""
    value: Any = {"raw": raw}
    with suppress(ValueError, RecursionError, msgpack.UnpackException):
        if "msgpack" in encoding:
            value = msgpack.unpackb(raw)
        elif "json" in encoding:
            value = json.loads(raw)
    return value if isinstance(value, dict) and set(map(type, value)) <= {str} else {"value": value}


@lru_cache(maxsize=512)
def _schema_at(suffix: str) -> str | None:
    """The one schema that a key carries; None where it carries several, or is not in the table of keys."""
    from mkdaemon.bus.codec import schema_name
    from mkdaemon.bus.keys import find
    from mkdaemon.telemetry.traffic import FrameSample

    spec = find(suffix)
    return None if spec is None or spec.carries in (None, FrameSample) else schema_name(spec.carries)


def typed_value(schema: str | None, fields: dict[str, Any]) -> Any:
    """Make the value that a map stands for; the map itself where the schema is not known here.

    Args:
        schema: name and version, for example `Attitude.v1`.
        fields: the map.

    Raises:
        ProtocolError: the map does not fit the schema.
    """
    from pydantic import ValidationError

    from mkdaemon.bus.codec import first_mistake
    from mkdaemon.telemetry.traffic import FrameSample

    model = telemetry_models().get(schema or "")
    try:
        if model is not None:
            return model.model_validate(fields)
        message = _messages().get((schema or "").removesuffix(".v1"))
        if message is None:
            return fields
        envelope = FrameSample.model_validate(fields)
    except ValidationError as error:
        msg = f"this is no {schema} as known here: {first_mistake(error)}; update mkdaemon here or there"
        raise ProtocolError(msg) from error
    return envelope.model_copy(update={"fields": message_from(schema, envelope.fields)})


def message_from(schema: str | None, fields: Mapping[str, Any]) -> WireMessage:
    """Make the message again that the daemon describes.

    Args:
        schema: as the daemon names it, for example `VersionFc210.v1`.
        fields: the message's fields.

    Raises:
        ProtocolError: the schema is unknown here, or has other fields.
    """
    cls = _messages().get((schema or "").partition(".")[0])
    if cls is None or cls.model_fields.keys() != fields.keys():
        what = ", ".join(fields) or "empty"
        raise ProtocolError(f"the daemon answers with {schema} ({what}), unknown here; update mkdaemon here or there")
    # Not validated: what a board says may be outside the limits of what may be sent.
    return cls.decode(cls.model_construct(**{name: _plain(value) for name, value in fields.items()}).encode())


def _plain(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


@cache
def telemetry_models() -> dict[str, type[BaseModel]]:
    """What published values are, by the name and version of their schema."""
    from mkdaemon.bus.codec import schema_name
    from mkdaemon.bus.keys import KEYS

    return {schema_name(spec.carries): spec.carries for spec in KEYS if spec.carries is not None}


@cache
def _messages() -> dict[str, type[WireMessage]]:
    from mkdaemon.protocol import MESSAGES

    return {cls.__name__: cls for cls in MESSAGES.values()}


def viewer_schema(name: str) -> bytes | None:
    """The JSON Schema of `<Name>.v<N>` as viewers read it, UTF-8 JSON; None where it is not known here.

    Args:
        name: as encodings name it, for example `Attitude.v1`.
    """
    from mkdaemon.record.view import flatten_schema

    found = known_schema(name)
    return None if found is None else json.dumps(flatten_schema(json.loads(found))).encode()


def viewer_value(fields: Mapping[str, Any]) -> Any:
    """A map as JSON has it: bytes in base64, nothing that is null."""
    from mkdaemon.record.view import json_value

    return json_value(fields)


def known_schema(name: str) -> bytes | None:
    """The JSON Schema of `<Name>.v<N>` as UTF-8 JSON; None where it is not known here.

    Args:
        name: as encodings name it, for example `Attitude.v1`.
    """
    from mkdaemon.bus.schema import schema_json

    return schema_json(name)


def carried_schemas() -> Iterator[tuple[str, str]]:
    """Every key that is put, not asked, with the name and version of the schema of its values."""
    from mkdaemon.bus.codec import schema_name
    from mkdaemon.bus.keys import KEYS, Use

    for spec in KEYS:
        if spec.carries is not None and spec.use in {Use.PUBLISHED, Use.CLIENT, Use.SETPOINT}:
            yield spec.suffix, schema_name(spec.carries)
