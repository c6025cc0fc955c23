from __future__ import annotations

import math
from enum import IntFlag
from typing import Annotated

import pytest
from pydantic import BaseModel, ValidationError

from mkdaemon.errors import EncodeError
from mkdaemon.protocol.fields import S8, S16, S32, U8, U16, Raw, Rest, Text, WireEnum
from mkdaemon.protocol.units import DECI_DEG, DECIVOLT, FIVE_CM, GLOBE, MILLIMETRE, STICK, STICK_FROM_BOTTOM


class Colour(WireEnum):
    RED = 1


class Bits(IntFlag):
    ONE = 1


class Sample(BaseModel):
    angle: Annotated[int, S16("Nick", DECI_DEG)] = 0
    stick: Annotated[int, S8("Roll", -STICK, limit=100)] = 0
    slot: Annotated[int, U8("Slot", only=frozenset({1, 2, 255}))] = 1
    colour: Annotated[Colour, U8("Farbe", enum=Colour)] = Colour.RED
    bits: Annotated[Bits, U8("Bits", enum=Bits)] = Bits(0)
    row: Annotated[tuple[int, ...], U16("Reihe", count=3)] = (0, 0, 0)
    name: Annotated[str, Text("Name", 4)] = ""
    raw: Annotated[bytes, Raw("Bytes", 2)] = b"\0\0"
    rest: Annotated[bytes, Rest("Rest", 1, 3)] = b"\0"


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("angle", 32768),
        ("angle", 1.0),
        ("angle", math.nan),
        ("angle", True),
        ("angle", "1"),
        ("stick", 101),
        ("stick", -101),
        ("slot", 3),
        ("colour", 256),
        ("colour", "RED"),
        ("row", (1, 2)),
        ("row", (1, 2, 65536)),
        ("row", (1, 2, math.inf)),
        ("name", "12345"),
        ("name", "€"),
        ("raw", b"1"),
        ("raw", "12"),
        ("rest", b""),
        ("rest", b"1234"),
    ],
)
def test_what_does_not_fit_the_wire_is_refused(field, value):
    with pytest.raises(ValidationError):
        Sample(**{field: value})


def test_an_unknown_value_of_an_enumeration_is_kept():
    assert Colour(7).name == "UNKNOWN_7"
    assert int(Colour(7)) == 7
    assert Sample(colour=9).colour == 9
    with pytest.raises(ValueError, match="red"):
        Colour("red")


def test_decimal_units_give_decimal_numbers():
    """16.7 V, not 16.700000000000003: what a person and a log compare must be the number that was meant."""
    battery, place, height = U8("UBat", DECIVOLT), S32("Longitude", GLOBE), S16("Altimeter", FIVE_CM)
    assert [battery.to_si(counts) for counts in (164, 167, 168)] == [16.4, 16.7, 16.8]
    assert place.to_si(74590417) == 7.4590417
    assert [height.to_si(counts) for counts in (3, -7)] == [0.15, -0.35]
    assert S16("mm", MILLIMETRE).to_si(1001) == 1.001


def test_si_values_turn_to_flu_and_back():
    angle, roll, throttle = S16("AngleNick", DECI_DEG), S8("Roll", -STICK), U8("Gas", STICK_FROM_BOTTOM)
    assert angle.to_si(900) == pytest.approx(math.pi / 2)
    assert angle.from_si(-math.pi / 2) == -900
    assert roll.to_si(20) == -20
    assert roll.from_si(20.4) == -20
    assert throttle.to_si(127) == 0
    assert throttle.from_si(100) == 227
    assert U8("plain").to_si(7) == 7.0
    assert U8("plain").from_si(7.4) == 7


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 128.0, -129.0])
def test_an_si_value_that_cannot_be_sent_is_refused(value):
    with pytest.raises(EncodeError, match="Roll"):
        S8("Roll", STICK).from_si(value)
