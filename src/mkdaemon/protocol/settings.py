"""Parameter sets of the FlightCtrl by name, for every revision known; bytes without a name stay unchanged.

A `ParameterSet` is its raw bytes, from the revision byte to the end of the name, as they cross the line behind their
index. Nothing is stored beside them, so a round trip is exact. Source: docs/protocol.md, "Settings".
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import Final, NamedTuple

from mkdaemon.errors import EncodeError, ProtocolError
from mkdaemon.protocol.framing import padded_length
from mkdaemon.protocol.settings_fields import Bit, ParameterKind, SettingParameter
from mkdaemon.protocol.settings_table import PARAMETERS, REVISIONS, SAME_LAYOUT

Value = int | str | tuple[int, ...]
"""A parameter's value: a number, the name, or a list of numbers."""

_FIRST_POTI: Final = 248


class ParameterPlace(NamedTuple):
    """Place of a parameter in a set."""

    parameter: SettingParameter
    offset: int
    length: int


@dataclass(frozen=True, slots=True)
class Layout:
    """The layout of one revision.

    Attributes:
        revision: the revision asked for.
        size: bytes from the revision byte to the end of the name.
        places: parameter by English name, in wire order.
        firmware: FlightCtrl releases that use this layout.
    """

    revision: int
    size: int
    places: Mapping[str, ParameterPlace]
    firmware: str

    def bits(self, name: str) -> tuple[Bit, ...]:
        """Return the bits a parameter has in this revision."""
        parameter = self.place(name).parameter
        return tuple(bit for bit in parameter.bits if bit.since <= self.revision <= bit.until)

    def place(self, name: str) -> ParameterPlace:
        """Return where a parameter stands.

        Raises:
            ProtocolError: this revision has no such parameter; names the nearest one.
        """
        place = self.places.get(name)
        if place is None:
            near = difflib.get_close_matches(name, self.places, n=1, cutoff=0.0)
            msg = f"parameter revision {self.revision} has no {name!r}; the nearest name is {near[0]!r}"
            raise ProtocolError(msg)
        return place


@cache
def layout_of(revision: int) -> Layout | None:
    """Return the layout of a revision; None where it is not known."""
    base = SAME_LAYOUT.get(revision, revision)
    if base not in REVISIONS:
        return None
    places: dict[str, ParameterPlace] = {}
    offset = 0
    for parameter in PARAMETERS:
        length = parameter.length(base)
        if length:
            places[parameter.name] = ParameterPlace(parameter, offset, length)
            offset += length
    return Layout(revision, offset, MappingProxyType(places), REVISIONS[base])


def known_revisions() -> tuple[int, ...]:
    """Return every revision with a known layout."""
    return tuple(sorted({*REVISIONS, *SAME_LAYOUT}))


def poti_number(value: int) -> int | None:
    """Return which poti (1..8) a value refers to; None for a plain number. 248 is poti 8, 255 is poti 1."""
    return 256 - value if _FIRST_POTI <= value <= 255 else None


def poti_reference(poti: int) -> int:
    """Return the value that refers to a poti.

    Raises:
        EncodeError: there is no such poti.
    """
    if not 1 <= poti <= 8:
        msg = f"poti {poti} does not exist: 1 to 8"
        raise EncodeError(msg)
    return 256 - poti


class SetChange(NamedTuple):
    """One difference between two sets."""

    name: str
    before: Value | None
    after: Value | None


@dataclass(frozen=True, slots=True)
class ParameterSet:
    """One parameter set.

    Attributes:
        raw: its bytes, from the revision byte to the end of the name; of an unknown revision all that was received.
    """

    raw: bytes

    def __post_init__(self) -> None:
        if not self.raw:
            msg = "a parameter set has at least its revision byte"
            raise ProtocolError(msg)

    @classmethod
    def from_payload(cls, parameters: bytes) -> ParameterSet:
        """Make a set of what follows the index in a settings frame; padding is cut off where the length is known.

        Raises:
            ProtocolError: there is not even a revision byte.
        """
        layout = layout_of(parameters[0]) if parameters else None
        if layout is not None and len(parameters) == padded_length(1 + layout.size) - 1:
            return cls(parameters[: layout.size])
        return cls(parameters)

    @property
    def revision(self) -> int:
        """Revision of the layout: the first byte."""
        return self.raw[0]

    @property
    def layout(self) -> Layout | None:
        """The layout; None where the revision is unknown or the length is not the revision's: raw bytes only."""
        layout = layout_of(self.revision)
        return layout if layout is not None and layout.size == len(self.raw) else None

    @property
    def reason(self) -> str | None:
        """Reason why only its raw bytes are known; None if its names are."""
        layout = layout_of(self.revision)
        if layout is None:
            return f"parameter revision {self.revision} is not known: raw bytes only"
        if layout.size != len(self.raw):
            return (
                f"parameter revision {self.revision} has {layout.size} bytes, these are {len(self.raw)}: raw bytes only"
            )
        return None

    def _known(self) -> Layout:
        layout = self.layout
        if layout is None:
            raise ProtocolError(self.reason)
        return layout

    @property
    def name(self) -> str:
        """The set's name; empty where the layout is not known."""
        return str(self["name"]) if self.layout is not None else ""

    def __getitem__(self, name: str) -> Value:
        """Return a parameter.

        Raises:
            ProtocolError: the layout is not known or has no such parameter.
        """
        parameter, offset, length = self._known().place(name)
        part = self.raw[offset : offset + length]
        if parameter.kind is ParameterKind.TEXT:
            return part.partition(b"\0")[0].decode("latin-1")
        if parameter.kind in {ParameterKind.LIST, ParameterKind.SPARE}:
            return tuple(part)
        return part[0]

    def values(self) -> dict[str, Value]:
        """Return all parameters by name, in wire order; empty where the layout is not known."""
        return {name: self[name] for name in self.layout.places} if self.layout is not None else {}

    def flags(self, name: str) -> tuple[str, ...]:
        """Return the names of the bits that are set; a bit without a name appears as `bit_N`.

        Raises:
            ProtocolError: the layout is not known or has no such parameter.
        """
        layout = self._known()
        names = {bit.mask: bit.name for bit in layout.bits(name)}
        value = self.raw[layout.place(name).offset]
        return tuple(names.get(1 << index, f"bit_{index}") for index in range(8) if value & (1 << index))

    def replaced(self, changes: Mapping[str, Value]) -> ParameterSet:
        """Return a set with some parameters changed, all other bytes as they are.

        Raises:
            ProtocolError: the layout is not known or has no such parameter.
            EncodeError: a value does not fit, or the revision itself would change.
        """
        layout = self._known()
        raw = bytearray(self.raw)
        for name, value in changes.items():
            place = layout.place(name)
            if place.offset == 0 and value != self.revision:
                msg = "the revision of a parameter set is its layout: it cannot be changed"
                raise EncodeError(msg)
            raw[place.offset : place.offset + place.length] = _to_bytes(place, value, self.raw)
        return ParameterSet(bytes(raw))

    def changes_to(self, other: ParameterSet) -> tuple[SetChange, ...]:
        """Return what differs, field by field; the whole as hex where the two cannot be compared by name."""
        if self.raw == other.raw:
            return ()
        if self.layout is None or other.layout is None:
            return (SetChange("raw", self.raw.hex(), other.raw.hex()),)
        before, after = self.values(), other.values()
        names = [*before, *(name for name in after if name not in before)]
        changed = tuple(
            SetChange(name, before.get(name), after.get(name)) for name in names if before.get(name) != after.get(name)
        )
        # Two texts can differ behind their NUL.
        return changed or (SetChange("raw", self.raw.hex(), other.raw.hex()),)


def _to_bytes(place: ParameterPlace, value: Value, current: bytes) -> bytes:
    parameter, offset, length = place
    if parameter.kind is ParameterKind.TEXT:
        if not isinstance(value, str) or len(value) > length or any(ord(letter) > 255 for letter in value):
            msg = f"{parameter.name} is text of at most {length} Latin-1 characters, not {value!r}"
            raise EncodeError(msg)
        old = current[offset : offset + length]
        # A name that does not change keeps whatever stands behind its NUL.
        same = old.partition(b"\0")[0].decode("latin-1") == value
        return old if same else value.encode("latin-1").ljust(length, b"\0")
    items = value if isinstance(value, tuple) else (value,)
    if len(items) != length:
        msg = f"{parameter.name} has {length} values, not {len(items)}"
        raise EncodeError(msg)
    for item in items:
        if not isinstance(item, int) or isinstance(item, bool) or not 0 <= item <= 255:
            msg = f"{parameter.name} takes 0..255, not {item!r}"
            raise EncodeError(msg)
    return bytes(item for item in items if isinstance(item, int))


def is_useful(parameter: SettingParameter, value: int) -> bool:
    """Whether a value lies in the range the firmware has a use for; a poti reference does where one is allowed."""
    return value <= parameter.high or (parameter.kind is ParameterKind.POTI and poti_number(value) is not None)
