"""The whole table: worked frames, random values, rules every declaration keeps."""

from __future__ import annotations

import json
import re
from collections import defaultdict
from enum import IntFlag

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from mkdaemon.protocol import flags
from mkdaemon.protocol.decoder import MessageDecoder
from mkdaemon.protocol.errorcodes import ErrorCode, describe_error, error_since
from mkdaemon.protocol.framing import Dropped, Frame, FrameDecoder
from mkdaemon.protocol.messages import ESCAPE, motor_controller_checksum
from mkdaemon.protocol.wire import MESSAGES, Board, Direction, WireMessage
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


def test_there_are_64_worked_frames_and_the_escape():
    assert len(FRAMED) == 64
    (escape,) = (vector for vector in VECTORS["vectors"] if vector["command"] is None)
    assert bytes.fromhex(escape["frame_hex"]) == ESCAPE
    assert [item.reason.value for item in FrameDecoder().feed(ESCAPE + b"\r")] == ["text"]


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


@pytest.mark.parametrize("cls", CLASSES, ids=class_name)
@settings(max_examples=6, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data(), cuts=st.lists(st.integers(0, 300), max_size=5))
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


def test_the_table_is_keyed_by_what_each_class_says():
    for (board, letter, layout), cls in MESSAGES.items():
        assert board in cls.spec.boards
        assert (letter, layout) == (cls.spec.id, cls.spec.layout)
    assert Board.ANY not in {board for board, _, _ in MESSAGES}


def test_names_and_keys_belong_together():
    names = defaultdict(set)
    for cls in CLASSES:
        spec = cls.spec
        assert re.fullmatch(r"[a-z][a-z0-9_]*", spec.key)
        assert cls.__name__.startswith(spec.name) or spec.name in {"Version", "CompassFeed", "Time"}, cls.__name__
        for board in spec.boards:
            names[board, spec.key].add((spec.name, spec.id, spec.direction))
    doubled = {key for (_, key), found in names.items() if len(found) > 1}
    assert doubled == {"compass_feed"}, "the one message whose letter changed between releases"


def test_a_layout_told_by_its_first_byte_sends_no_other():
    for cls in CLASSES:
        if cls.spec.marker:
            assert cls.spec.slots[0].wire.only == cls.spec.marker, cls.__name__
            assert cls.model_fields[cls.spec.slots[0].name].default in cls.spec.marker


def test_every_answer_named_exists():
    for cls in CLASSES:
        spec = cls.spec
        if spec.reply is None:
            continue
        found = [
            other
            for other in CLASSES
            if other.spec.id == spec.reply
            and (set(other.spec.boards) & set(spec.boards) or spec.boards == (Board.MAG,))
        ]
        assert found, f"{cls.__name__} expects {spec.reply}"


def test_every_message_says_what_it_is_and_where_that_comes_from():
    for cls in CLASSES:
        assert cls.__doc__, cls.__name__
        assert cls.spec.sources, cls.__name__
        assert cls.spec.firmware, cls.__name__
        for slot in cls.spec.slots:
            assert slot.wire.mk
            assert re.fullmatch(r"[a-z][a-z0-9_]*", slot.name)
            assert not re.search("nick|gier|gas|hoehe", slot.name), f"{cls.__name__}.{slot.name}"


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


def test_roll_is_turned_and_pitch_is_not():
    for cls in CLASSES:
        for slot in cls.spec.slots:
            if slot.wire.scale is None:
                continue
            if slot.name in {"roll", "stick_roll"}:
                assert slot.wire.scale < 0, cls.__name__
            elif slot.name in {"pitch", "heading", "course", "stick_pitch"}:
                assert slot.wire.scale > 0, cls.__name__
    yaw = {cls.spec.layout: cls.spec.wire("yaw").scale for cls in CLASSES if cls.spec.name == "ExternControl"}
    assert yaw == {"v1": -1.0, "v2": 1.0, "v3": 1.0}


def test_every_enumeration_is_used_and_flags_are_single_bits():
    used = {slot.wire.enum for cls in CLASSES for slot in cls.spec.slots if slot.wire.enum}
    declared = {item for item in vars(flags).values() if isinstance(item, type) and item.__module__ == flags.__name__}
    assert declared - used == {flags.MenuKey}, "keys are sent inverted"
    for kind in declared:
        if issubclass(kind, IntFlag):
            assert all(int(member).bit_count() == 1 for member in kind)


def test_error_codes():
    assert [int(code) for code in ErrorCode] == list(range(48))
    assert all(describe_error(code) for code in ErrorCode)
    assert describe_error(0) == "no error"
    assert describe_error(21) == "GPS fix lost"
    assert describe_error(200) == "unknown error 200"
    assert error_since(32) == "2.02a"
    assert error_since(200) == ""


def test_a_version_names_its_release():
    released = {
        cls.decode(bytes([2, 12, 11, 0, 0, 0, 0, 0, 0, 0])).release for cls in CLASSES if cls.spec.name == "Version"
    }
    assert released == {"2.12a"}


def test_motor_controller_checksum():
    assert motor_controller_checksum(bytes.fromhex("0200ff1e634000")) == 0x6C
