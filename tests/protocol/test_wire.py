from __future__ import annotations

from typing import Annotated

import pytest

from mkdaemon.errors import EncodeError, ProtocolError
from mkdaemon.protocol.boards import board_at
from mkdaemon.protocol.decoder import MessageDecoder, Unknown
from mkdaemon.protocol.fields import U16
from mkdaemon.protocol.framing import Frame, FrameDecoder, encode_frame
from mkdaemon.protocol.layout import lay_out
from mkdaemon.protocol.messages import (
    ControlConfirm,
    DisplayOld,
    Echo,
    ExternControlV2,
    ExternControlV3,
    Label,
    MotorTest,
    OsdFlags,
    OsdRequestV1,
    OsdRequestV2,
    RedundancySetpoints,
    TimeRequest,
    WriteSettings,
)
from mkdaemon.protocol.wire import MESSAGES, Board, WireMessage, request


def frame(address: int, letter: str, payload: bytes) -> Frame:
    (found,) = FrameDecoder().feed(encode_frame(address, letter, payload))
    assert isinstance(found, Frame)
    return found


def test_decode_accepts_padding_and_refuses_what_is_too_short():
    assert Echo.decode(b"\xa5\x5a\0") == Echo(pattern=0x5AA5)
    with pytest.raises(ProtocolError, match=r"Echo \(1\) needs 2 bytes, got 1"):
        Echo.decode(b"\xa5")


@pytest.mark.parametrize(
    "broken",
    [
        ExternControlV2.model_construct(pitch=300, roll=0, yaw=0, throttle=0),
        Label.model_construct(index=0, text=float("nan")),
        Label.model_construct(index=0, text="x" * 17),
        Label.model_construct(index=0, text="日本"),
        MotorTest.model_construct(motors=float("nan")),
        MotorTest.model_construct(motors=(float("nan"),) * 16),
        MotorTest.model_construct(motors=(0,) * 15),
        WriteSettings.model_construct(index=1, parameters=b"\x6a"),
        WriteSettings.model_construct(index=1, parameters=bytes(250)),
        WriteSettings.model_construct(index=1, parameters="6a"),
    ],
    ids=lambda message: message.spec.name,
)
def test_nothing_is_cut_short_or_made_up_on_its_way_to_the_wire(broken):
    """`struct` would cut a long text in silence, and "nan" is a text too."""
    with pytest.raises(EncodeError, match=broken.spec.name):
        broken.to_frame()


def test_si_of_a_field_by_name():
    stick = ExternControlV2(pitch=10, roll=10, yaw=10, throttle=10)
    assert (stick.si("pitch"), stick.si("roll"), stick.si("yaw")) == (10, -10, 10)
    with pytest.raises(ProtocolError, match="'nick'; it has pitch, roll"):
        stick.si("nick")


@pytest.mark.parametrize(
    ("address", "letter", "payload", "cls"),
    [
        (2, "o", b"\x32\0\0", OsdRequestV1),
        (2, "o", b"\x0a\0\4", OsdRequestV2),
        (1, "H", bytes(21), DisplayOld),
        (2, "b", bytes(9), ExternControlV3),
        (1, "b", bytes(9), ExternControlV2),
        (0, "b", bytes(9), ExternControlV2),
        (0, "t", bytes(16), MotorTest),
        (2, "t", b"\1", TimeRequest),
        (20, "!", b"\1", RedundancySetpoints),
        (2, "B", ControlConfirm(frame=1).encode(), ControlConfirm),
        (2, "O", bytes([11]) + bytes(23), OsdFlags),
    ],
)
def test_address_letter_length_and_contents_find_the_message(address, letter, payload, cls):
    decoder = MessageDecoder()
    for _ in range(2):
        assert isinstance(decoder.decode(frame(address, letter, payload)), cls)


@pytest.mark.parametrize(
    ("address", "letter", "payload", "reason"),
    [
        (2, "O", bytes([9]) + bytes(81), "no layout of 'O' has 84 bytes like this"),
        (1, "V", b"", "no layout of 'V' has 0 bytes like this"),
        (1, "z", b"", "fc has no command 'z'"),
        (1, "Z", Echo(pattern=1).encode(), "fc has no command 'Z'"),
        (0, "X", b"", "no layout of 'X' has 0 bytes like this"),
        (0, "~", b"", "any has no command '~'"),
        (8, "v", b"", "no board has address 8"),
        (0, "t", b"\1", "no layout of 't' has 3 bytes like this"),
    ],
)
def test_what_fits_no_message_is_named(address, letter, payload, reason):
    found = MessageDecoder().decode(frame(address, letter, payload))
    assert isinstance(found, Unknown)
    assert found.reason == reason
    assert found.board is board_at(address)


def test_a_place_in_the_table_is_taken_once():
    def declare() -> type[WireMessage]:
        @request(Board.FC, "v")
        class Second(WireMessage):
            """Claims a place that is taken."""

        return Second

    before = dict(MESSAGES)
    with pytest.raises(ProtocolError, match="Second and VersionRequest both claim"):
        declare()
    assert before == MESSAGES


class Loose(WireMessage):
    """Has a field nobody can encode."""

    value: int


class Wide(WireMessage):
    """Would need a table of 65536 members."""

    board: Annotated[Board, U16("b", enum=Board)]


@pytest.mark.parametrize(
    ("cls", "words"),
    [(Loose, r"Loose\.value has no wire type"), (Wide, r"Wide\.board is an enumeration of type u16")],
)
def test_a_field_without_a_wire_type_and_an_enumeration_wider_than_a_byte_are_refused(cls, words):
    with pytest.raises(ProtocolError, match=words):
        lay_out(cls)
