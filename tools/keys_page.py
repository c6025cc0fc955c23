"""The tables of docs/keys.md: keys, refusals and payloads."""

from __future__ import annotations

import math
import types
from collections.abc import Callable, Iterable, Iterator, Mapping
from enum import Enum
from functools import partial
from itertools import chain
from typing import Any, Final, Literal, Union, get_args, get_origin

from pydantic import BaseModel

from mkdaemon.bus.codec import schema_name
from mkdaemon.bus.keys import KEYS, KeySpec, Use
from mkdaemon.config.keys import limits_of
from mkdaemon.described import meanings_of
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.base import Command
from mkdaemon.telemetry.command import CommandResult, RatesRequest
from mkdaemon.telemetry.control import LeaseState
from mkdaemon.telemetry.refusals import Token
from tools.client_sources import models_in
from tools.markdown import table


def with_parts(models: Iterable[type[BaseModel]]) -> list[type[BaseModel]]:
    """Return models and, each behind the one that has it first, the models in their fields."""
    found: dict[type[BaseModel], None] = {}

    def add(model: type[BaseModel]) -> None:
        if model not in found:
            found[model] = None
            for part in _leaves(model):
                if issubclass(part, BaseModel):
                    add(part)

    for model in models:
        add(model)
    return list(found)


def enums_of(models: Iterable[type[BaseModel]]) -> list[type[Enum]]:
    """Return every enumeration in the fields of models, by name."""
    found = {leaf for model in models for leaf in _leaves(model) if issubclass(leaf, Enum)}
    return sorted(found, key=lambda kind: kind.__name__)


def members_of(kind: type[Enum]) -> str:
    """Return the values of an enumeration."""
    return ", ".join(f"`{member.value}`" for member in kind)


def link_to(model: type[BaseModel]) -> str:
    """Return a link to the table of a model."""
    name = schema_name(model)
    return f"[{name}](#{name.replace('.', '').lower()})"


def fields_of(model: type[BaseModel]) -> Iterator[str]:
    """Return the section of a model; what clients send says which fields it needs."""
    about = " ".join((model.__doc__ or "").split("\n\n")[0].split())
    is_sent = issubclass(model, Command)
    needs = ("field", "type", "needed", "meaning") if is_sent else ("field", "type", "meaning")
    schema, meanings = model.model_json_schema(), meanings_of(model)
    yield f"### {schema_name(model)}\n\n{about}\n"
    rows = (
        (f"`{name}`", type_of(info.annotation), *([_need(name, schema)] if is_sent else []), meanings[name])
        for name, info in model.model_fields.items()
    )
    yield from table(needs, (tuple(" ".join(cell.split()) for cell in row) for row in rows))
    yield ""


def type_of(annotation: Any) -> str:
    """Return a type in words, enumerations and models as links."""
    if annotation is None or annotation is type(None):
        return "null"
    origin, args = get_origin(annotation), get_args(annotation)
    if origin in (Union, types.UnionType):
        return " | ".join(type_of(arg) for arg in args)
    if origin is Literal:
        return " | ".join(f"`{value}`" for value in args)
    if origin is not None:
        inner = ", ".join("..." if arg is Ellipsis else type_of(arg) for arg in args)
        return inner if origin not in (tuple, list, dict) else f"{'map' if origin is dict else 'list'} of {inner}"
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return link_to(annotation)
    if isinstance(annotation, type) and issubclass(annotation, Enum):
        return f"[{annotation.__name__}](#{annotation.__name__.lower()})"
    return str(getattr(annotation, "__name__", annotation))


def _need(name: str, schema: dict[str, Any]) -> str:
    """What a client must know to fill a field: whether it is required, its default, its range."""
    field = schema["properties"][name]
    needed = "required" if name in schema.get("required", ()) else f"default {_plain(field.get('default'))}"
    return ", ".join(filter(None, (needed, limits_of(field))))


def _plain(value: object) -> str:
    words = {None: "null", True: "true", False: "false", "": "empty"}
    return words.get(value, f"`{value}`") if isinstance(value, str | bool | None) else f"{value}"


def _leaves(model: type[BaseModel]) -> Iterator[type[BaseModel | Enum]]:
    for info in model.model_fields.values():
        yield from models_in(info.annotation)


_SAYS: Final = {
    Use.PUBLISHED: ("payload", "when", "fresh (s)"),
    Use.CLIENT: ("payload", "when", "fresh (s)"),
    Use.QUERY: ("request", "reply"),
    Use.SETPOINT: ("payload",),
    Use.TOKEN: (),
}
"""What the table of each use says between the key and its meaning."""
_COMMAND: Final = "cmd/<board>/<message>"


def _keys(use: Use, _: None) -> Iterator[str]:
    return table(("key", "who", *_SAYS[use], "what"), (_row(spec) for spec in KEYS if spec.use is use))


def _refusals(_: None) -> Iterator[str]:
    rows = ((f"`{token}`", token.status.value, token.reason, token.fix) for token in Token)
    return table(("token", "status", "reason", "fix"), rows)


def _payloads(_: None) -> Iterator[str]:
    return chain.from_iterable(map(fields_of, _models()))


def _enumerations(_: None) -> Iterator[str]:
    rows = ((f'<a id="{kind.__name__.lower()}"></a>{kind.__name__}', members_of(kind)) for kind in enums_of(_models()))
    return table(("name", "values"), rows)


def _row(spec: KeySpec) -> tuple[str, ...]:
    cells = {
        "payload": link_to(spec.carries) if spec.carries else "none",
        "request": link_to(spec.carries) if spec.carries else "none",
        "reply": link_to(spec.reply) if spec.reply else "",
        "when": spec.when,
        "fresh (s)": "" if spec.fresh is None else "until the next" if math.isinf(spec.fresh) else f"{spec.fresh:g}",
    }
    if spec.suffix == _COMMAND:  # the payload of a request is the message's own fields, as is that of its reply
        cells |= {"request": "its fields", "reply": "the answer's fields"}
    return (f"`{spec.suffix}`", _who(spec), *(cells[name] for name in _SAYS[spec.use]), spec.about)


def _who(spec: KeySpec) -> str:
    """Which program publishes a key, answers it, or reads it."""
    if spec.suffix.startswith("sim/"):
        return "simulator"
    return "the client that wants the lease" if spec.suffix.startswith("client/") else "daemon"


def _models() -> list[type[BaseModel]]:
    carried = [spec.carries for spec in KEYS if spec.carries is not None]
    replies = [spec.reply for spec in KEYS if spec.reply is not None]
    return with_parts([Stamp, *carried, *replies, CommandResult, LeaseState, RatesRequest])


TABLES: Final[Mapping[str, Callable[[None], Iterator[str]]]] = {
    "published": partial(_keys, Use.PUBLISHED),
    "clients": partial(_keys, Use.CLIENT),
    "queries": partial(_keys, Use.QUERY),
    "setpoints": partial(_keys, Use.SETPOINT),
    "tokens": partial(_keys, Use.TOKEN),
    "refusals": _refusals,
    "payloads": _payloads,
    "enumerations": _enumerations,
}
"""By the names that the page gives them."""
