"""The tables of docs/keys.md: keys, refusals and payloads."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from itertools import chain
from typing import Final

from pydantic import BaseModel

from mkdaemon.bus.keys import KEYS, KeySpec, Use
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.command import CommandResult, RatesRequest
from mkdaemon.telemetry.control import LeaseState
from mkdaemon.telemetry.refusals import Token
from tools.markdown import table
from tools.model_tables import enums_of, fields_of, link_to, members_of, with_parts

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
