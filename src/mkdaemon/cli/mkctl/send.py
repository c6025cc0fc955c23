"""`mkctl board send <request> --field value`: every MikroKopter request, generated from the table of messages."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import Any, Final, Literal

from cyclopts import App

from mkdaemon.cli.mkctl.board_request import find_board
from mkdaemon.cli.mkctl.connection import Connection
from mkdaemon.cli.mkctl.madecommand import MadeCommand, make_command, option
from mkdaemon.client.samples import message_from
from mkdaemon.described import meanings_of
from mkdaemon.errors import ConfigError
from mkdaemon.protocol.fields import WireField
from mkdaemon.protocol.layout import Slot
from mkdaemon.protocol.wire import MESSAGES, Board, Direction, WireMessage

_FILLERS: Final = ("reserved", "padding", "free_")
"""Prefixes of fields that a user does not set; the table has their values."""


@dataclass(frozen=True, slots=True)
class FieldForm:
    """One field to fill in.

    Attributes:
        name: English name.
        wire: how it stands on the wire.
        about: what it means.
        default: value where none is given; None where one must be given.
        is_required: every layout needs it.
        others: limits of layouts that differ from the first one's, by layout.
    """

    name: str
    wire: WireField
    about: str
    default: Any
    is_required: bool
    others: tuple[tuple[str, WireField], ...] = ()

    @property
    def help(self) -> str:
        """Meaning, unit and limits in one line."""
        wire = self.wire
        unit = f" [{wire.unit}]" if wire.unit else ""
        return f"{self.about}{' ' if self.about else ''}{self._limits()}{unit}"

    def _limits(self) -> str:
        wire = self.wire
        if wire.enum is not None:
            joiner = ", joined by commas: " if issubclass(wire.enum, IntFlag) else ": "
            return f"Name or number{joiner}{' '.join(member.name.lower() for member in wire.enum if member.name)}."
        if wire.is_bytes:
            return f"{wire.count}..{wire.longest or wire.count} bytes in hexadecimal."
        if wire.is_text:
            return f"At most {wire.count} characters."
        limits = ", ".join(map(str, sorted(wire.only))) if wire.only else f"{wire.minimum}..{wire.maximum}"
        limits += "".join(f" (layout {layout}: {o.minimum}..{o.maximum})" for layout, o in self.others)
        return f"{wire.count} numbers {limits}." if wire.is_array else f"{limits}."

    @property
    def example(self) -> str:
        """A value as it is typed; `HEX` where the bytes are the user's own."""
        wire = self.wire
        if wire.enum is not None:
            return next(member.name.lower() for member in wire.enum if member.name)
        if wire.is_bytes:
            return "HEX"
        if wire.is_text:
            return "TEXT"
        number = str(min(wire.only) if wire.only else min(max(1, wire.minimum), wire.maximum))
        return ",".join([number] * wire.count) if wire.is_array else number

    def read(self, text: str) -> Any:
        """Turn what was typed into the field's value.

        Raises:
            ConfigError: it is not a value of this field; names the field and what it takes.
        """
        try:
            return self._read(text)
        except (ValueError, KeyError) as error:
            msg = f"--{self.name.replace('_', '-')}: {text!r} does not fit; it takes: {self._limits()}"
            raise ConfigError(msg) from error

    def _read(self, text: str) -> Any:
        wire = self.wire
        if wire.is_text:
            return text if len(text) <= wire.count else _misfit()
        if wire.is_bytes:
            raw = bytes.fromhex(text)
            return raw if wire.count <= len(raw) <= (wire.longest or wire.count) else _misfit()
        if wire.is_array:
            numbers = tuple(self._number(word) for word in text.replace(",", " ").split())
            return numbers if len(numbers) == wire.count else _misfit()
        return self._number(text)

    def _number(self, text: str) -> int:
        """A number, or names of an enumeration; several names only where they are bits."""
        wire = self.wire
        try:
            number = int(text, 0)
        except ValueError:
            if wire.enum is None or ("," in text and not issubclass(wire.enum, IntFlag)):
                raise
            number = sum(self._member(wire.enum, word) for word in text.split(","))
        wires = (wire, *(other for _, other in self.others))
        fits = any(number in w.only if w.only else w.minimum <= number <= w.maximum for w in wires)
        return number if fits else _misfit()

    @staticmethod
    def _member(kind: type[IntEnum] | type[IntFlag], word: str) -> int:
        return int(kind[word.strip().upper().replace("-", "_")])


def _misfit() -> Any:
    raise ValueError


@dataclass(frozen=True, slots=True)
class RequestForm:
    """One request, all its layouts together: the daemon knows which of them the board speaks.

    Attributes:
        key: name of the request in keys.
        boards: who can be asked.
        about: what it does.
        danger: what harm it can do; empty where none.
        firmware: which releases know it.
        reply: command letter of the answer; None where none comes.
        fields: what can be given.
    """

    key: str
    boards: tuple[Board, ...]
    about: str
    danger: str
    firmware: str
    reply: str | None
    fields: tuple[FieldForm, ...]

    @property
    def command(self) -> str:
        """Its name on the command line."""
        return self.key.replace("_", "-")

    @property
    def example(self) -> str:
        """The shortest call that is one."""
        given = (f"--{field.name.replace('_', '-')} {field.example}" for field in self.fields if field.is_required)
        return " ".join(["mkctl board send", self.command, *given, *["--confirm"][: bool(self.danger)]])

    def read(self, given: Mapping[str, str | None]) -> dict[str, Any]:
        """Turn what was typed into the request's fields.

        Raises:
            ConfigError: a value does not fit.
        """
        forms = {field.name: field for field in self.fields}
        return {name: forms[name].read(text) for name, text in given.items() if text is not None}


def request_forms() -> dict[str, RequestForm]:
    """Every request of every board by its key."""
    layouts: dict[str, list[type[WireMessage]]] = {}
    for cls in MESSAGES.values():
        if cls.spec.direction is Direction.TO_BOARD and cls not in layouts.setdefault(cls.spec.key, []):
            layouts[cls.spec.key].append(cls)
    return {key: _form(key, classes) for key, classes in sorted(layouts.items())}


def _form(key: str, classes: list[type[WireMessage]]) -> RequestForm:
    first = classes[0]
    fields: dict[str, FieldForm] = {}
    for cls in classes:
        for slot in cls.spec.slots:
            if slot.name in fields or slot.name.startswith(_FILLERS) or _is_constant(slot, cls):
                continue
            named = [other for other in classes if slot.name in other.model_fields]
            owners = [other.model_fields[slot.name] for other in named]
            fields[slot.name] = FieldForm(
                name=slot.name,
                wire=slot.wire,
                about=meanings_of(named[0])[slot.name],
                default=None if owners[0].is_required() else owners[0].default,
                is_required=len(owners) == len(classes) and all(owner.is_required() for owner in owners),
                others=_other_limits(slot, classes),
            )
    return RequestForm(
        key=key,
        boards=tuple(dict.fromkeys(board for cls in classes for board in cls.spec.boards)),
        about=(first.__doc__ or "").strip().partition("\n")[0],
        danger=next((cls.spec.danger.effect for cls in classes if cls.spec.danger), ""),
        firmware="; ".join(dict.fromkeys(cls.spec.firmware for cls in classes)),
        reply=first.spec.reply,
        fields=tuple(fields.values()),
    )


def _is_constant(slot: Slot, cls: type[WireMessage]) -> bool:
    """Whether a field has one value only, which the table sets."""
    return slot.wire.minimum == slot.wire.maximum and not cls.model_fields[slot.name].is_required()


def _other_limits(slot: Slot, classes: list[type[WireMessage]]) -> tuple[tuple[str, WireField], ...]:
    """Layouts in which a number's limits differ from those of the layout that has it first."""
    first = (slot.wire.minimum, slot.wire.maximum)
    wires = ((cls.spec.layout, other.wire) for cls in classes for other in cls.spec.slots if other.name == slot.name)
    return tuple((layout, wire) for layout, wire in wires if (wire.minimum, wire.maximum) != first)


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
        board = board or await find_board(client, form.boards)
        answer = await client.command(board.word, form.key, fields)
    reply = answer.require()
    words = describe_reply(message_from(answer.reply_type, reply)) if reply else answer.reason
    found = {"status": answer.status, "reply": reply, "duration": answer.duration}
    at.show(found, words or f"answered: {answer.status}")


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


def _command(form: RequestForm) -> MadeCommand:
    """Make the function of one request."""

    async def run(given: dict[str, Any], connection: Connection) -> None:
        confirm, word = given.pop("confirm", False), given.pop("board", None)
        await send(form, None if word is None else Board[word.upper()], given, confirm, connection)

    options = [option(field.name, str, field.help, is_required=field.is_required) for field in form.fields]
    if len(form.boards) > 1:
        words = Literal[tuple(board.word for board in form.boards)]  # type: ignore[valid-type]
        options.append(option("board", words, "Board to ask; by default the one at the end of the line."))
    if form.danger:
        options.append(option("confirm", bool, f"I know the danger: {form.danger}."))
    return make_command(run, options, f"{form.about}\n\nFirmware: {form.firmware}.\n\nExample: {form.example}")


FORMS: Final = request_forms()
for _known in FORMS.values():
    app.command(_command(_known), name=_known.command)
