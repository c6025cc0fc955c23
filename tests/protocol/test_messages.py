"""The whole table: worked frames, random values, damaged frames, and which messages are dangerous."""

from __future__ import annotations

import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from mkdaemon.protocol.decoder import MessageDecoder
from mkdaemon.protocol.framing import Dropped, Frame, FrameDecoder
from mkdaemon.protocol.messages import motor_controller_checksum
from mkdaemon.protocol.wire import Board, Direction, WireMessage
from tests.places import DATA
from tests.protocol.strategies import CLASSES, class_name, messages, split

VECTORS = json.loads((DATA / "wire_vectors.json").read_text(encoding="utf-8"))
FRAMED = [vector for vector in VECTORS["vectors"] if vector["command"] is not None]
POINTS = {(Board.NC, letter): "2x" for letter in "swX"}


@pytest.mark.parametrize("vector", FRAMED, ids=lambda vector: vector["name"])
def test_worked_frame_both_ways(vector):
    wire = bytes.fromhex(vector["frame_hex"])
    (frame,) = FrameDecoder().feed(wire)
    assert isinstance(frame, Frame)
    assert (frame.address, frame.id, frame.payload.hex()) == (
        vector["address"],
        vector["command"],
        vector["decoded_hex"],
    )
    message = MessageDecoder(POINTS).decode(frame)
    assert isinstance(message, WireMessage), message
    assert message.to_frame(Board(vector["address"])) == wire
    payload = bytes.fromhex(vector["payload_hex"])
    assert message.encode()[: len(payload)] == payload
    rebuilt = type(message).model_validate(message.model_dump())
    assert rebuilt.encode() == message.encode()


EXPECTED_FAULTS = {
    "checksum low character off by one": ["checksum"],
    "line feed instead of CR": [],
    "missing checksum character": ["length"],
    "second # in the middle": ["length", "v"],
}


@pytest.mark.parametrize("vector", VECTORS["negative"], ids=lambda vector: vector["name"])
def test_damaged_frame_is_named(vector):
    found = FrameDecoder().feed(bytes.fromhex(vector["frame_hex"]))
    names = [item.reason.value if isinstance(item, Dropped) else item.id for item in found]
    assert names == EXPECTED_FAULTS[vector["name"]]


@settings(max_examples=150)
@given(cls=st.sampled_from(CLASSES), data=st.data(), cuts=st.lists(st.integers(0, 300), max_size=5))
def test_random_values_survive_the_line_in_any_chunking(cls, data, cuts):
    message = data.draw(messages(cls))
    wire = message.to_frame()
    decoder = FrameDecoder()
    (frame,) = (item for part in split(wire, cuts) for item in decoder.feed(part))
    assert isinstance(frame, Frame)
    read = cls.decode(frame.payload)
    assert read.to_frame() == wire
    if not cls.spec.longest:
        assert read == message
    layouts = {(board, cls.spec.id): cls.spec.layout for board in cls.spec.boards}
    found = MessageDecoder(layouts).decode(frame)
    assert isinstance(found, WireMessage)
    assert found.spec.id == cls.spec.id
    assert cls.spec.test is not None or isinstance(found, cls)


JUNK = (
    st.none()
    | st.booleans()
    | st.floats()
    | st.integers()
    | st.integers(-300, 300)
    | st.text(max_size=30)
    | st.binary(max_size=30)
    | st.lists(st.integers(-300, 300) | st.floats(), max_size=70)
)


@settings(max_examples=100)
@given(cls=st.sampled_from(CLASSES), data=st.data())
def test_whatever_is_put_in_a_message_is_refused_or_fits_the_wire(cls, data):
    """No NaN, nothing out of range, nothing short gets out."""
    fields = data.draw(messages(cls)).model_dump()
    spoiled = data.draw(st.sets(st.sampled_from(sorted(fields)), min_size=1, max_size=3)) if fields else {"none"}
    try:
        built = cls(**{**fields, **{name: data.draw(JUNK) for name in spoiled}})
    except ValidationError:
        return
    wire = built.encode()
    assert len(wire) == cls.spec.size or cls.spec.longest
    assert len(wire) >= cls.spec.size
    # What stands behind a NUL in a text is stale to a reader.
    if not any(slot.wire.is_text for slot in cls.spec.slots):
        assert cls.decode(wire).encode() == wire


@given(address=st.integers(0, 27), letter=st.integers(0x21, 0x7E).map(chr), payload=st.binary(max_size=200))
def test_any_payload_decodes_or_is_named(address, letter, payload):
    frame = Frame(address, letter, payload + bytes(-len(payload) % 3), b"")
    found = MessageDecoder().decode(frame)
    if isinstance(found, WireMessage):
        assert len(found.encode()) >= found.spec.size


@pytest.mark.parametrize("cls", CLASSES, ids=class_name)
def test_every_received_byte_pattern_makes_a_message(cls):
    size = cls.spec.size
    for payload in (bytes(size), b"\xff" * size, bytes((7 * at) % 256 for at in range(size))):
        read = cls.decode(payload)
        # Text behind a NUL or trailing blanks is stale and not kept; everything else is.
        if not any(slot.wire.is_text for slot in cls.spec.slots):
            assert read.encode() == payload
        assert json.loads(read.model_dump_json()) == read.model_dump(mode="json")


DANGEROUS = {
    *("extern_control", "motor_test", "serial_channels", "receiver_bridge", "reset", "compass_heading"),
    *("arm_motors", "disarm_motors", "recalibrate", "beep", "settings_request", "settings_reset", "write_settings"),
    *("select_settings", "write_mixer", "write_motor_controller", "redundancy_setpoints", "compass_feed"),
    *(
        "motor_controller_request",
        "display_request",
        "send_target",
        "write_waypoint",
        "redirect",
        "write_navi_parameter",
        "time_request",
    ),
}


def test_the_danger_table():
    """docs/protocol.md, "Danger", row by row."""
    assert {cls.spec.key for cls in CLASSES if cls.spec.danger} == DANGEROUS
    assert all(cls.spec.direction is Direction.TO_BOARD for cls in CLASSES if cls.spec.danger)


def test_motor_controller_checksum():
    assert motor_controller_checksum(bytes.fromhex("0200ff1e634000")) == 0x6C
