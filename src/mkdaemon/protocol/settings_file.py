"""Parameter sets as TOML or JSON: firmware, revision, slot, the raw bytes, and the same by name for people to read.

Raw bytes and named values must agree when a file is read, so a hand edit of one alone is found; delete `raw` to make
the names count. Pure text: the callers read and write the file.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from mkdaemon.errors import EncodeError, ProtocolError
from mkdaemon.foreignfiles import parse_json, parse_toml
from mkdaemon.protocol.settings import Layout, ParameterSet, Value, is_useful, layout_of, poti_number, poti_reference
from mkdaemon.protocol.settings_fields import ParameterKind

_FORMAT: Final = "mikrokopter-parameter-set"


@dataclass(frozen=True, slots=True)
class SettingsFile:
    """One parameter set and where it came from.

    Attributes:
        parameters: the set.
        slot: its index, 1..5.
        firmware: release of the FlightCtrl it was read from, for example `2.12a`.
        saved: wall time of the backup, ISO 8601; empty where not recorded.
    """

    parameters: ParameterSet
    slot: int
    firmware: str
    saved: str = ""

    def to_toml(self) -> str:
        """Return it as TOML."""
        lines = [f"{name} = {_toml(value)}" for name, value in self._head().items()]
        values = self._values()
        if values:
            lines += ["", "[values]", *(f"{name} = {_toml(value)}" for name, value in values.items())]
        return "\n".join(lines) + "\n"

    def to_json(self) -> str:
        """Return it as JSON."""
        return json.dumps({**self._head(), "values": self._values()}, indent=2, ensure_ascii=False) + "\n"

    def _head(self) -> dict[str, Any]:
        return {
            "format": _FORMAT,
            "firmware": self.firmware,
            "revision": self.parameters.revision,
            "slot": self.slot,
            "name": self.parameters.name,
            "saved": self.saved,
            "raw": self.parameters.raw.hex(),
        }

    def _values(self) -> dict[str, Any]:
        return {name: spell_value(self.parameters, name) for name in self.parameters.values()}

    @classmethod
    def parse(cls, text: str) -> SettingsFile:
        """Read TOML or JSON.

        Raises:
            ProtocolError: the text is neither, misses something, or its raw bytes and named values disagree.
        """
        content = _load(text)
        if content.get("format") != _FORMAT:
            msg = f"this is no parameter set: format is {content.get('format')!r}, not {_FORMAT!r}"
            raise ProtocolError(msg)
        slot, revision = content.get("slot"), content.get("revision")
        if not isinstance(slot, int) or not 1 <= slot <= 5:
            msg = f"slot is {slot!r}: a parameter set has a slot of 1 to 5"
            raise ProtocolError(msg)
        if not isinstance(revision, int) or not 0 <= revision <= 255:
            msg = f"revision is {revision!r}: a number of 0 to 255 is needed"
            raise ProtocolError(msg)
        parameters = _parameters(content, revision)
        if parameters.revision != revision:
            msg = f"revision says {revision}, the raw bytes say {parameters.revision}: one of them was changed"
            raise ProtocolError(msg)
        return cls(parameters, slot, str(content.get("firmware", "")), str(content.get("saved", "")))


Spelled = int | str | list[int] | list[str]
"""A value as a person reads it."""


class SpelledChange(NamedTuple):
    """One difference between two sets, as a person reads it."""

    name: str
    before: Spelled | None
    after: Spelled | None


def change_by_name(current: ParameterSet, wanted: Mapping[str, Spelled]) -> ParameterSet:
    """Return a set with some parameters changed.

    Args:
        current: the set.
        wanted: new values by name: `poti1`, bits as a list of names or as `name,name`, or plain values.

    Raises:
        ProtocolError: the layout is not known, has no such parameter, or the value does not fit it.
    """
    layout = current.layout
    if layout is None:
        msg = f"{current.reason}; nothing can be changed by name"
        raise ProtocolError(msg)
    values: dict[str, Value] = {}
    for name, given in wanted.items():
        parameter = layout.place(name).parameter
        is_list = isinstance(given, str) and (bool(parameter.bits) or "," in given) and not given.isdecimal()
        value = values[name] = parse_value(layout, name, _split_list(str(given)) if is_list else given)
        if isinstance(value, int) and value != current[name] and not is_useful(parameter, value):
            msg = f"{name} takes 0..{parameter.high}, not {value}: {parameter.meaning}"
            raise ProtocolError(msg)
    return current.replaced(values)


def _split_list(text: str) -> list[int] | list[str]:
    words = [word for word in text.split(",") if word]
    return [int(word) for word in words] if words and all(word.isdecimal() for word in words) else words


def spell_value(parameters: ParameterSet, name: str) -> Spelled:
    """Return a parameter the way a person reads it: `poti3`, names of set bits, or the plain value.

    Raises:
        ProtocolError: the layout is not known or has no such parameter.
    """
    value = parameters[name]
    if isinstance(value, tuple):
        return list(value)
    kind = parameters.layout.place(name).parameter.kind if parameters.layout else None
    if kind is ParameterKind.BITS:
        return list(parameters.flags(name))
    poti = poti_number(value) if kind is ParameterKind.POTI and isinstance(value, int) else None
    return f"poti{poti}" if poti else value


def spell_changes(before: ParameterSet, after: ParameterSet) -> tuple[SpelledChange, ...]:
    """Return what differs, both values the way a person reads them; None where a set has no such parameter."""

    def spell(parameters: ParameterSet, name: str, value: Value | None) -> Spelled | None:
        is_named = value is not None and parameters.layout is not None and name in parameters.values()
        return spell_value(parameters, name) if is_named else str(value) if value is not None else None

    return tuple(
        SpelledChange(name, spell(before, name, was), spell(after, name, becomes))
        for name, was, becomes in before.changes_to(after)
    )


def parse_value(layout: Layout, name: str, spelled: object) -> Value:
    """Return the value of what `spell_value` wrote or a person typed: also plain numbers for potis and bits.

    Raises:
        ProtocolError: the layout has no such parameter.
        EncodeError: it cannot be read as a value of this parameter.
    """
    kind = layout.place(name).parameter.kind
    if kind is ParameterKind.TEXT and isinstance(spelled, str):
        return spelled
    if isinstance(spelled, int) and not isinstance(spelled, bool):
        return spelled
    if isinstance(spelled, str) and spelled.isdecimal():
        return int(spelled)
    if isinstance(spelled, str) and kind is ParameterKind.POTI and spelled[:4] == "poti" and spelled[4:].isdecimal():
        return poti_reference(int(spelled[4:]))
    if isinstance(spelled, (list, tuple)):
        if kind is ParameterKind.BITS:
            return sum(_mask(layout, name, str(bit)) for bit in dict.fromkeys(spelled))
        if all(isinstance(item, int) for item in spelled):
            return tuple(spelled)
    msg = f"{name} ({kind.value}) cannot be {spelled!r}"
    raise EncodeError(msg)


def _mask(layout: Layout, name: str, bit: str) -> int:
    named = {known.name: known.mask for known in layout.bits(name)}
    unnamed = {f"bit_{index}": 1 << index for index in range(8)}
    mask = named.get(bit) or unnamed.get(bit)
    if mask is None:
        msg = f"{name} has no bit {bit!r}; it has {', '.join(named)}"
        raise EncodeError(msg)
    return mask


def _load(text: str) -> dict[str, Any]:
    try:
        content = parse_json(text) if text.lstrip().startswith("{") else parse_toml(text)
    except (json.JSONDecodeError, tomllib.TOMLDecodeError) as error:
        msg = f"this is neither TOML nor JSON: {error}"
        raise ProtocolError(msg) from error
    return dict(content)


def _parameters(content: Mapping[str, Any], revision: int) -> ParameterSet:
    values, raw_hex = content.get("values") or {}, content.get("raw")
    if not isinstance(values, dict):
        msg = "values is not a table of names"
        raise ProtocolError(msg)
    layout = layout_of(revision)
    if raw_hex is None:
        return _from_values(values, layout, revision)
    try:
        parameters = ParameterSet(bytes.fromhex(str(raw_hex)))
    except ValueError as error:
        msg = f"raw is not hexadecimal: {error}"
        raise ProtocolError(msg) from error
    if parameters.layout is None:
        return parameters
    for name, spelled in values.items():
        wanted = parse_value(parameters.layout, name, spelled)
        if parameters[name] != wanted:
            msg = (
                f"{name} is {spelled!r} by name but {spell_value(parameters, name)!r} in raw: "
                "delete raw to make the names count, or the name to keep raw"
            )
            raise ProtocolError(msg)
    return parameters


def _from_values(values: Mapping[str, Any], layout: Layout | None, revision: int) -> ParameterSet:
    if layout is None:
        msg = f"parameter revision {revision} is not known: only raw bytes can be read, and raw is missing"
        raise ProtocolError(msg)
    missing = [name for name in layout.places if name not in values]
    if missing:
        msg = f"without raw every parameter must be named; missing: {', '.join(missing[:5])}"
        raise ProtocolError(msg)
    blank = ParameterSet(bytes([revision]) + bytes(layout.size - 1))
    return blank.replaced({name: parse_value(layout, name, spelled) for name, spelled in values.items()})


def _toml(value: object) -> str:
    """Spell a value as TOML; JSON strings, numbers and flat arrays are TOML too (escapes included)."""
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=True).replace("\x7f", "\\u007f")
    return json.dumps(value)
