"""Bytes to messages: nothing raises, nothing grows, signatures count once, also after a restart."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import all as mavlink

from mkdaemon.gateways.mavlink.framing import Counts, Decoder, Encoder
from mkdaemon.gateways.mavlink.signing import AHEAD, Signing

WALL = 1_700_000_000.0
KEY = bytes(range(32))
PING = mavlink.MAVLink_ping_message(5, 6, 0, 0)


def feed(data, *, signing=None, cuts=None):
    counts = Counts()
    decoder = Decoder(counts, signing)
    step = cuts or len(data)
    found = [m for at in range(0, len(data), step) for m in decoder.feed(data[at : at + step], WALL)]
    return found, counts, decoder


@pytest.mark.parametrize("cuts", [1, 3, 7, None])
def test_messages_are_found_between_garbage(cuts):
    encoder = Encoder(9, None)
    data = b"\xfe\x00noise" + encoder.encode(PING, WALL) + b"\xfd" + encoder.encode(PING, WALL) + bytes(300)
    found, counts, _ = feed(data, cuts=cuts)
    assert [(m.get_type(), m.get_srcSystem(), m.get_seq()) for m in found] == [("PING", 9, 0), ("PING", 9, 1)]
    assert counts.messages == 2 and counts.garbage > 0


def test_a_broken_frame_hides_no_right_one_mavlink_1_is_understood_and_a_datagram_goes_on_in_no_other():
    encoder = Encoder(9, None)
    broken = bytearray(encoder.encode(PING, WALL))
    broken[12] ^= 1
    old = bytes(PING.pack(mavlink.MAVLink(None, 3, 4), force_mavlink1=True))
    found, counts, _ = feed(bytes(broken) + encoder.encode(PING, WALL) + old)
    assert [m.get_srcSystem() for m in found] == [9, 3] and counts.bad >= 1
    whole = Encoder(9, None).encode(PING, WALL)
    decoder = Decoder(Counts(), None)
    assert decoder.datagram(whole[:9], WALL) == []
    assert decoder.datagram(whole[9:], WALL) == []
    assert len(decoder.datagram(whole, WALL)) == 1


def test_signed_messages_are_taken_once_and_their_streams_not_remembered_without_end():
    signed = Encoder(9, Signing(KEY), 1).encode(PING, WALL)
    decoder = Decoder(Counts(), Signing(KEY))
    assert len(list(decoder.feed(signed, WALL))) == 1
    assert list(decoder.feed(signed, WALL)) == []
    assert decoder.counts.unsigned == 1
    signing = Signing(KEY)
    decoder = Decoder(Counts(), signing)
    for system in range(1, 101):
        list(decoder.feed(Encoder(system, Signing(KEY), 1).encode(PING, WALL), WALL))
    assert decoder.counts.messages == len(signing._newest) == 64


@pytest.mark.parametrize(
    "data",
    [
        Encoder(9, None).encode(PING, WALL),
        Encoder(9, Signing(bytes(32)), 1).encode(PING, WALL),
        Encoder(9, Signing(KEY), 1).encode(PING, WALL - 120.0),
    ],
    ids=["unsigned", "another key", "two minutes old"],
)
def test_what_is_not_rightly_signed_is_dropped(data):
    found, counts, _ = feed(data, signing=Signing(KEY))
    assert found == [] and counts.unsigned == 1


def stream(count):
    """A recorded stream: a frame a tenth of a second."""
    encoder = Encoder(255, Signing(KEY))
    beat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)
    return [encoder.encode(beat, WALL + number / 10) for number in range(count)]


def taken(path, frames, wall):
    decoder = Decoder(Counts(), Signing(KEY, path))
    return sum(len(decoder.datagram(frame, wall)) for frame in frames)


def test_a_recorded_stream_is_not_taken_after_a_restart(tmp_path):
    path = tmp_path / "state" / "times.json"
    recorded = stream(340)
    assert taken(path, recorded, WALL) == len(recorded)
    assert taken(path, recorded, WALL + 24.0) == 0
    later = Encoder(255, Signing(KEY)).encode(mavlink.MAVLink_ping_message(1, 2, 0, 0), WALL + 34.0 + AHEAD / 1e5)
    assert taken(path, [later], WALL + 40.0) == 1


@pytest.mark.parametrize("text", ["", "{}", "[[1]]", "[[1, 2, 3, []]]", "nonsense", None])
def test_a_broken_file_or_no_place_to_write_one_is_no_end(tmp_path, text):
    path = tmp_path / "times.json" / ("" if text is not None else "below a file")
    (tmp_path / "times.json").write_text(text or "")
    assert taken(path, stream(2), WALL) == 2
