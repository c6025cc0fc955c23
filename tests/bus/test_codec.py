"""What is read from the bus: maps, setpoints and requests, each within its limits."""

from __future__ import annotations

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mkdaemon.bus.codec import MAX_DEPTH, TooLong, decode_map, read_command
from mkdaemon.bus.keys import find
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.mission import MissionPoint, WaypointsUploadRequest
from mkdaemon.telemetry.setpoint import StickSetpoint


@pytest.mark.parametrize(
    "raw",
    [
        b"\xc1", b"\xff\xff", b"\x91" * 3000, b"\x81\xa1a", b"\x81\x01\x02", b"\x81\xa1\xff\x01", b"\x93\x01\x02\x03",
        b"\xa3abc", b"\x80\x80", TooLong(5000, 4096), b"\x81\xa1a\xc7\x01\x05x", b"\x81\xa1a\xd6\xff\0\0\0\0",
        b"\x81\xc4\x01a\x02", b"\x82\xa1a\x01\xa1a\x02",
    ],
)  # fmt: skip
def test_what_is_no_map_is_refused_as_malformed(raw):
    with pytest.raises(CommandRejectedError) as caught:
        decode_map(raw)
    assert caught.value.token == "malformed"


@given(st.binary(max_size=200))
def test_no_bytes_at_all_break_the_reader(raw):
    try:
        fields = decode_map(raw)
    except CommandRejectedError as error:
        assert error.token == "malformed"
    else:
        assert isinstance(fields, dict)


def _nested(depth: int) -> dict:
    value: dict = {}
    for _ in range(depth):
        value = {"a": value}
    return value


def test_nesting_deeper_than_any_request_is_refused_before_it_breaks_the_audit():
    with pytest.raises(CommandRejectedError, match="nested deeper"):
        decode_map(msgpack.packb(_nested(MAX_DEPTH)))
    with pytest.raises(CommandRejectedError, match="nested deeper"):
        decode_map(b"\x81\xa1a" + b"\x91" * 300 + b"\x01")
    assert decode_map(msgpack.packb(_nested(MAX_DEPTH - 1))) == _nested(MAX_DEPTH - 1)


def test_parts_longer_than_in_any_request_are_refused():
    for value in ({"a": [0] * 513}, {"a": dict.fromkeys(map(str, range(257)))}, {"a": "x" * 4097}, {"a": b"x" * 4097}):
        with pytest.raises(CommandRejectedError, match="no msgpack"):
            decode_map(msgpack.packb(value))


GOOD = {"epoch": 1, "sequence": 2, "ttl": 0.3, "pitch": 0, "roll": 1.5, "yaw": 0.0, "throttle": -127}


@pytest.mark.parametrize(
    "change",
    [
        {"pitch": float("nan")}, {"pitch": float("inf")}, {"pitch": 127.1}, {"throttle": -128}, {"ttl": 0},
        {"ttl": 1.1}, {"epoch": -1}, {"epoch": 1.0}, {"epoch": "1"}, {"sequence": True}, {"extra": 1}, {"yaw": None},
        {"pitch": "60"}, {"pitch": b"60"}, {"pitch": True}, {"ttl": "0.3"}, {"throttle": [1]},
    ],
)  # fmt: skip
def test_setpoints_out_of_range_are_refused(change):
    with pytest.raises(CommandRejectedError) as caught:
        read_command(StickSetpoint, msgpack.packb(GOOD | change))
    assert caught.value.token == "bad_field"
    assert next(iter(change)) in caught.value.reason


def test_the_longest_honest_requests_fit():
    point = {
        "latitude_deg": -48.123456789, "longitude_deg": -111.123456789, "altitude": -1000.55, "kind": "waypoint",
        "radius": 255, "hold": 255, "heading_deg": 360, "poi": 255, "climb": 2.55, "speed": 2.55,
        "camera_angle_deg": -255, "name": "ABCD", "event": 255, "photo_distance": 255,
    }  # fmt: skip
    assert set(point) == set(MissionPoint.model_fields)
    upload = {"points": [point] * 254, "source": "x" * 200, "holder": "y" * 64}
    assert set(upload) < set(WaypointsUploadRequest.model_fields)
    raw = msgpack.packb(upload)
    assert len(decode_map(raw)["points"]) == 254
    assert len(raw) < find("do/waypoints_upload").max_bytes
    assert find("do/lease").max_bytes == 4096
    assert find("setpoint/stick").max_bytes == 512
