"""JSON Schemas of everything that crosses the bus."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

from pydantic import BaseModel

from mkdaemon.bus.codec import schema_name
from mkdaemon.bus.keys import KEYS
from mkdaemon.protocol.wire import MESSAGES, WireMessage
from mkdaemon.telemetry.command import CommandResult
from mkdaemon.telemetry.control import LeaseProbe, LeaseState
from mkdaemon.telemetry.traffic import FrameSample

__all__ = ["schema_json", "schema_names"]


@cache
def _models() -> dict[str, type[BaseModel]]:
    models: list[type[BaseModel]] = [
        CommandResult,
        LeaseProbe,
        LeaseState,
        *(spec.carries for spec in KEYS if spec.carries is not None),
    ]
    models.extend(spec.reply for spec in KEYS if spec.reply is not None)
    models.extend(MESSAGES.values())
    return {schema_name(model): model for model in models}


def schema_names() -> tuple[str, ...]:
    """Every schema that can be asked for, `<Name>.v<N>`."""
    return tuple(_models())


@cache
def schema_json(name: str) -> bytes | None:
    """The JSON Schema of a payload as UTF-8 JSON; None for an unknown name.

    A wire message is described as it stands under `rx/` and `tx/`: a `FrameSample` whose `fields` are the message's.
    """
    model = _models().get(name)
    if model is None:
        return None
    schema: dict[str, Any] = model.model_json_schema()
    if issubclass(model, WireMessage):
        envelope = FrameSample.model_json_schema()
        envelope["title"] = model.__name__
        envelope["description"] = (model.__doc__ or "").partition("\n")[0]
        envelope["$defs"] = schema.pop("$defs", {})
        envelope["properties"]["fields"] = schema
        schema = envelope
    return json.dumps(schema, ensure_ascii=False).encode()
