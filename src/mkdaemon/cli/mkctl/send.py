"""`mkctl send <request> --field value`: every MikroKopter request, generated from the table of messages."""

from __future__ import annotations

import inspect
import json
from collections.abc import Awaitable, Callable
from typing import Annotated, Any, Final, Literal

from cyclopts import App, Parameter

from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.mkctl.requests import FieldForm, RequestForm, request_forms
from mkdaemon.client import Vehicle
from mkdaemon.client.samples import message_from
from mkdaemon.protocol.wire import Board, WireMessage

app = App(
    name="send",
    help="Send one MikroKopter request and print the typed answer. Values are counts as on the wire, with units. "
    "Dangerous requests need --confirm and pass the daemon's gate.",
)


async def send(
    form: RequestForm, board: Board | None, given: dict[str, str | None], confirm: bool, at: Connection
) -> None:
    """Send one request and print what came back; to the board at the end of the line where none is named.

    Raises:
        ConfigError: a value does not fit its field.
        CommandRejectedError: the daemon refused; says token, reason and fix.
    """
    fields = form.read(given)
    if confirm:
        fields["confirm"] = True
    async with at.open() as client:
        board = board or await find_board(client, form)
        answer = await client.command(board.word, form.key, fields)
    reply = answer.require()
    if at.json:
        shown = {name: value.hex() if isinstance(value, bytes) else value for name, value in reply.items()}
        print(json.dumps({"status": answer.status, "reply": shown, "duration": answer.duration}))
    elif reply:
        print(describe_reply(message_from(answer.reply_type, reply)))
    else:
        print(answer.reason or f"answered: {answer.status}")


async def find_board(client: Vehicle, form: RequestForm) -> Board:
    """Return who is asked by default: the NaviCtrl where one is on the line, for it must not be passed through."""
    if len(form.boards) > 1:
        state = await client.link.state.latest()
        present = () if state is None else state.value.boards
        if Board.NC in form.boards and Board.NC.word in present:
            return Board.NC
    return form.boards[0]


def describe_reply(message: WireMessage) -> str:
    """Return an answer as one line a field, with units."""
    lines = []
    for slot in message.spec.slots:
        value, unit = getattr(message, slot.name), f" {slot.wire.unit}" if slot.wire.unit else ""
        text = value.hex() if isinstance(value, bytes) else repr(value) if isinstance(value, str) else str(value)
        if slot.wire.enum and isinstance(value, int):
            text = f"{int(value)} ({(slot.wire.enum(value).name or 'none').lower()})"
        lines.append(f"{slot.name:24} {text}{unit}")
    return "\n".join(lines)


def _command(form: RequestForm) -> Callable[..., Awaitable[None]]:
    """Make the function of one request, with a parameter for each field."""

    async def run(**given: Any) -> None:
        connection: Connection = given.pop("connection", HERE)
        confirm: bool = given.pop("confirm", False)
        word = given.pop("board", None)
        board = None if word is None else Board[word.upper()]
        await send(form, board, given, confirm, connection)

    parameters = [_parameter(field) for field in form.fields]
    if len(form.boards) > 1:
        words = Literal[tuple(board.word for board in form.boards)]  # type: ignore[valid-type]
        about = "Board to ask; by default the one at the end of the line."
        parameters.append(_keyword("board", words | None, about, default=None))
    if form.danger:
        about = f"I know the danger: {form.danger}."
        parameters.append(_keyword("confirm", bool, about, default=False, negative=()))
    parameters.append(
        inspect.Parameter("connection", inspect.Parameter.KEYWORD_ONLY, default=HERE, annotation=Connection)
    )
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    run.__doc__ = f"{form.about}\n\nFirmware: {form.firmware}."
    return run


def _parameter(field: FieldForm) -> inspect.Parameter:
    # A number may be negative, so a value that looks like an option is still a value.
    default = inspect.Parameter.empty if field.is_required else None
    return _keyword(
        field.name, str if field.is_required else str | None, field.help, default, allow_leading_hyphen=True
    )


def _keyword(name: str, kind: Any, about: str, default: Any, **options: Any) -> inspect.Parameter:
    annotation = Annotated[kind, Parameter(help=about, **options)]
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


FORMS: Final = request_forms()
for _form in FORMS.values():
    app.command(_command(_form), name=_form.command)
