"""Wire fields: one annotation carries type, firmware word, unit, scale, limits and bits of a field.

Everything that must know a field reads it from here: codec, validation, JSON Schema, documentation, command line,
simulator and tests.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from functools import cache
from typing import Any, Final, Self

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, core_schema

from mkdaemon.errors import EncodeError
from mkdaemon.protocol.units import Unit

_RANGES: Final = {
    "b": (-(2**7), 2**7 - 1),
    "B": (0, 2**8 - 1),
    "h": (-(2**15), 2**15 - 1),
    "H": (0, 2**16 - 1),
    "i": (-(2**31), 2**31 - 1),
    "I": (0, 2**32 - 1),
}
_TYPE_NAMES: Final = {"b": "s8", "B": "u8", "h": "s16", "H": "u16", "i": "s32", "I": "u32", "s": "char"}


class WireEnum(IntEnum):
    """An enumeration that keeps values it does not know, because boards newer than this table exist."""

    @classmethod
    def _missing_(cls, value: object) -> Self | None:
        if not isinstance(value, int):
            return None
        member = int.__new__(cls, value)
        member._name_ = f"UNKNOWN_{value}"
        member._value_ = value
        return member


@cache
def _divisor(scale: float) -> float:
    """How many counts make one, where that is whole; 0 otherwise. 167 * 0.1 is 16.700000000000003, 167 / 10 is not."""
    counts = round(1 / scale)
    return counts if abs(counts * scale - 1) < 1e-12 else 0


@dataclass(frozen=True, slots=True, kw_only=True)
class WireField:
    """One field of a packed little-endian structure.

    Attributes:
        code: `struct` letter of one item; `s` for characters.
        mk: the firmware's word for it.
        count: number of items, or of characters or bytes.
        is_array: the Python value is a tuple of `count` integers.
        is_bytes: the Python value is `bytes` of length `count`.
        longest: for the last field of a message of variable length, the most bytes it can have (`count` is the least).
        unit: unit of one count, in words; empty for a plain number.
        scale: SI value in FLU/ENU axes = (wire value - zero) * scale; its sign is the sign between the firmware's axis
            and ours.
        zero: wire value that means nothing of it.
        si: unit after scaling.
        minimum: smallest value that may be sent.
        maximum: largest value that may be sent.
        only: the values that may be sent, where they are not a range; empty for all of the range.
        enum: meaning of the values or bits.
        pad: what fills unused characters.
        trim: whether padding is taken off when received.
    """

    code: str
    mk: str
    count: int = 1
    is_array: bool = False
    is_bytes: bool = False
    longest: int = 0
    unit: str = ""
    scale: float | None = None
    zero: int = 0
    si: str = ""
    minimum: int = 0
    maximum: int = 0
    only: frozenset[int] = frozenset()
    enum: type[IntEnum] | type[IntFlag] | None = None
    pad: str = "\0"
    trim: bool = True

    @property
    def is_text(self) -> bool:
        """Whether the Python value is a string."""
        return self.code == "s" and not self.is_bytes

    @property
    def format(self) -> str:
        """The field in `struct` notation, without byte order."""
        return self.code if self.count == 1 and self.code != "s" else f"{self.count}{self.code}"

    @property
    def type_name(self) -> str:
        """The wire type in the words of the protocol documentation, for example `s16[32]`."""
        if self.is_bytes:
            return f"u8[{self.count}..{self.longest}]" if self.longest else f"u8[{self.count}]"
        name = _TYPE_NAMES[self.code]
        return f"{name}[{self.count}]" if self.is_array or self.code == "s" else name

    def _check_only(self, value: int) -> int:
        if value not in self.only:
            msg = f"{value} is none of {', '.join(str(allowed) for allowed in sorted(self.only))}"
            raise ValueError(msg)
        return value

    def to_si(self, value: int) -> float:
        """Return the SI value [`si`; FLU] of a wire value; a field without a unit is its own value."""
        if self.scale is None:
            return float(value)
        divisor = _divisor(self.scale)
        return (value - self.zero) / divisor if divisor else (value - self.zero) * self.scale

    def from_si(self, value: float) -> int:
        """Return the nearest wire value of an SI value [`si`; FLU].

        Raises:
            EncodeError: the value is not a finite number or beyond what may be sent.
        """
        if not math.isfinite(value):
            msg = f"{self.mk}: {value} cannot be sent"
            raise EncodeError(msg)
        wire = round(value if self.scale is None else value / self.scale) + self.zero
        if not self.minimum <= wire <= self.maximum:
            msg = f"{self.mk}: {value} {self.si} is {wire} on the wire, outside {self.minimum}..{self.maximum}"
            raise EncodeError(msg)
        return wire

    def read_text(self, raw: bytes) -> str:
        """Return received characters as a string, padding taken off where the field is trimmed."""
        text = raw.decode("latin-1")
        if not self.trim:
            return text
        return text.partition("\0")[0].rstrip(self.pad + " ") if self.pad == " " else text.partition("\0")[0]

    def write(self, value: Any) -> Any:
        """Conversion from the Python value to what `struct` packs (arrays stay tuples).

        Raises:
            ValueError: a text or bytes that `struct` would cut short, or that is none.
        """
        if not (self.is_text or self.is_bytes):
            return value
        # What was received at variable length keeps up to two bytes of padding.
        kind, longest = (str, self.count) if self.is_text else (bytes, self.longest + 2 if self.longest else self.count)
        if not isinstance(value, kind) or not (0 if self.is_text else self.count) <= len(value) <= longest:
            msg = f"{value!r} is no {kind.__name__} of at most {longest}"
            raise ValueError(msg)
        return value.ljust(self.count, self.pad).encode("latin-1") if isinstance(value, str) else value

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        if self.is_bytes:
            return core_schema.bytes_schema(min_length=self.count, max_length=self.longest or self.count, strict=True)
        if self.is_text:
            return core_schema.str_schema(max_length=self.count, pattern=r"^[\x00-\xff]*$", strict=True)
        item: CoreSchema = core_schema.int_schema(strict=True, ge=self.minimum, le=self.maximum)
        if self.only:
            item = core_schema.no_info_after_validator_function(self._check_only, item)
        if self.enum is not None:
            item = core_schema.no_info_after_validator_function(self.enum, item)
        if self.is_array:
            return core_schema.tuple_schema(
                [item], variadic_item_index=0, min_length=self.count, max_length=self.count, strict=False
            )
        return item

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        described = handler(schema)
        described["x-firmware-word"] = self.mk
        described["x-wire-type"] = self.type_name
        if self.unit:
            described["x-unit"] = self.unit
        if self.scale is not None:
            described["x-scale"] = self.scale
            described["x-si-unit"] = self.si
        if self.only:
            described["enum"] = sorted(self.only)
        if self.zero:
            described["x-zero"] = self.zero
        if self.enum is not None:
            described["x-values"] = {member.name: int(member) for member in self.enum}
        return described


def _integer(
    code: str,
    mk: str,
    unit: Unit | str = "",
    *,
    limit: int | None = None,
    low: int | None = None,
    high: int | None = None,
    only: frozenset[int] = frozenset(),
    enum: type[IntEnum] | type[IntFlag] | None = None,
    count: int | None = None,
) -> WireField:
    smallest, largest = _RANGES[code]
    if limit is not None:
        smallest, largest = max(smallest, -limit), min(largest, limit)
    return WireField(
        code=code,
        mk=mk,
        count=1 if count is None else count,
        is_array=count is not None,
        unit=unit if isinstance(unit, str) else unit.wire,
        scale=None if isinstance(unit, str) else unit.scale,
        zero=0 if isinstance(unit, str) else unit.zero,
        si="" if isinstance(unit, str) else unit.si,
        minimum=smallest if low is None else low,
        maximum=largest if high is None else high,
        only=only,
        enum=enum,
    )


def U8(mk: str, unit: Unit | str = "", **options: Any) -> WireField:  # noqa: N802 - reads as the wire type it declares
    """Declare an unsigned byte; `limit`, `low`, `high` bound what is sent, `count` makes an array, `enum` its words."""
    return _integer("B", mk, unit, **options)


def S8(mk: str, unit: Unit | str = "", **options: Any) -> WireField:  # noqa: N802
    """Declare a signed byte."""
    return _integer("b", mk, unit, **options)


def U16(mk: str, unit: Unit | str = "", **options: Any) -> WireField:  # noqa: N802
    """Declare an unsigned 16-bit integer."""
    return _integer("H", mk, unit, **options)


def S16(mk: str, unit: Unit | str = "", **options: Any) -> WireField:  # noqa: N802
    """Declare a signed 16-bit integer."""
    return _integer("h", mk, unit, **options)


def S32(mk: str, unit: Unit | str = "", **options: Any) -> WireField:  # noqa: N802
    """Declare a signed 32-bit integer."""
    return _integer("i", mk, unit, **options)


def Text(mk: str, length: int, *, pad: str = "\0", trim: bool = True) -> WireField:  # noqa: N802
    """Declare `length` Latin-1 characters; with `trim` all from the first NUL on, and final blanks, is dropped."""
    return WireField(code="s", mk=mk, count=length, pad=pad, trim=trim)


def Raw(mk: str, length: int) -> WireField:  # noqa: N802
    """Declare `length` bytes whose meaning is declared elsewhere."""
    return WireField(code="s", mk=mk, count=length, is_bytes=True)


def Rest(mk: str, shortest: int, longest: int) -> WireField:  # noqa: N802
    """Declare the last field of a message of variable length: all bytes that follow, padding included."""
    return WireField(code="s", mk=mk, count=shortest, is_bytes=True, longest=longest)
