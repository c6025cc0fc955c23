"""`mkctl do <verb> --field value`, and commands that need no more: made from the table of verbs."""

from __future__ import annotations

import json
from typing import Any, Final, Literal, get_args, get_origin

from cyclopts import App
from pydantic.fields import FieldInfo

from mkdaemon.cli.mkctl.connection import Connection
from mkdaemon.cli.mkctl.madecommand import MadeCommand, make_command, option
from mkdaemon.cli.printing import short
from mkdaemon.client.asking import client_name
from mkdaemon.described import meanings_of
from mkdaemon.errors import ConfigError
from mkdaemon.telemetry.verbs import VERBS, Verb

_HOLDER: Final = "holder"
"""Field with the name of the client."""

app = App(
    name="do",
    help="Ask the daemon for any verb of docs/keys.md and print its answer. Values are words, or JSON: `3`, `[1, 2]`.",
)


async def ask(verb: Verb, given: dict[str, str | bool | None], connection: Connection) -> None:
    """Ask for a verb and print the answer.

    Raises:
        ConfigError: a value is not JSON where it has to be.
        CommandRejectedError: it was refused; says token, reason and fix.
    """
    fields: dict[str, Any] = {}
    for name, text in given.items():
        if text is not None and text is not False:
            fields[name] = text if text is True else _read(name, text, verb.request.model_fields[name].annotation)
    if _HOLDER in verb.request.model_fields:
        fields[_HOLDER] = client_name()
    async with connection.open() as uav:
        answer = await uav.command("do", verb.name, fields, patience=verb.patience)
    reply = answer.require()
    words = "\n".join(f"{name:24} {short(value)}" for name, value in reply.items())
    connection.show(reply, words or answer.status.value)


def _read(name: str, text: str, annotation: Any) -> Any:
    """A word where words are taken, else JSON."""
    if _takes_words(annotation):
        return text
    try:
        return json.loads(text)
    except ValueError as error:
        raise ConfigError(f"--{name.replace('_', '-')} {text!r}: give JSON, for example 3, true or [1, 2]") from error


def _takes_words(annotation: Any) -> bool:
    if get_origin(annotation) is Literal:
        return True
    return annotation is str or str in get_args(annotation)


def _example(verb: Verb, group: str, method: str) -> str:
    """The shortest call that is one."""
    needed = ((name, field) for name, field in verb.request.model_fields.items() if field.is_required())
    given = [f"--{name.replace('_', '-')} {_example_value(field)}" for name, field in needed if name != _HOLDER]
    return " ".join(["mkctl", group, method.replace("_", "-"), *given])


def _example_value(field: FieldInfo) -> str:
    """A value as it is typed; `TEXT` or `JSON` where it is the user's own."""
    words = get_args(field.annotation) if get_origin(field.annotation) is Literal else ()
    if words:
        return str(words[0])
    return "TEXT" if _takes_words(field.annotation) else "1" if field.annotation in (int, float) else "JSON"


def _command(verb: Verb, group: str, method: str) -> MadeCommand:
    """Make the function of one verb."""
    meanings = meanings_of(verb.request)
    options = [
        option(name, bool if field.annotation is bool else str, meanings[name], is_required=field.is_required())
        for name, field in verb.request.model_fields.items()
        if name != _HOLDER
    ]
    doc = f"{verb.about}\n\nExample: {_example(verb, group, method)}"
    return make_command(lambda given, connection: ask(verb, given, connection), options, doc)


_BY_NAME: Final = {verb.name: verb for verb in VERBS}
for _verb in VERBS:
    app.command(_command(_verb, app.name[0], _verb.name), name=_verb.name.replace("_", "-"))
route_start: Final = _command(_BY_NAME["route_start"], "waypoints", "start")
route_end: Final = _command(_BY_NAME["route_end"], "waypoints", "end")
