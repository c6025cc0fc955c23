"""A signed stream that was recorded is not taken after a restart."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import all as mavlink

from mkdaemon.gateways.mavlink.framing import Counts, Decoder, Encoder
from mkdaemon.gateways.mavlink.signing import AHEAD, Signing

KEY, WALL = bytes(range(32)), 1_700_000_000.0


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
