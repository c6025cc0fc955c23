"""`python -m lab protocol`: how fast recorded traffic becomes typed messages.

The peer is pymavlink decoding messages of about the same size in the same run, because a figure of one machine says
little on another. Best of several rounds: the least disturbed one. Processor time, not wall time, for the same reason.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Callable
from typing import Any, Final

from lab.campaign import Row
from lab.places import CAPTURES, REFERENCE
from lab.tables import show
from mkdaemon.cli.arguments import AsJson
from mkdaemon.protocol.boards import Direction
from mkdaemon.protocol.capture import read_chunks
from mkdaemon.protocol.decoder import MessageDecoder
from mkdaemon.protocol.framing import Dropped, FrameDecoder

ROUNDS: Final = 15
_CHUNK: Final = 64
"""Bytes handed to the decoder at once: about what a serial port has after 11 ms."""
RECORDING: Final = "nc_mixed_60s.jsonl"
"""Of genuine boards; an excerpt of it is kept with the tests."""


def recorded() -> bytes:
    """All bytes that boards sent, of the whole recording where it lies beside the source tree."""
    whole = REFERENCE / "captures" / RECORDING
    with (whole if whole.is_file() else CAPTURES / RECORDING).open("rb") as stream:
        return b"".join(raw for _, way, raw in read_chunks(stream, RECORDING) if way is Direction.FROM_BOARD)


def _best(run: Callable[[], int], rounds: int) -> float:
    """What a run counts in a second of processor time, at best."""
    shortest, count = float("inf"), 0
    gc.collect()
    for _ in range(rounds):
        before = time.process_time()
        count = run()
        shortest = min(shortest, time.process_time() - before)
    return count / shortest


def measure_speed(stream: bytes, rounds: int) -> Row:
    """Decode bytes of a line again and again.

    Returns:
        `frames` that become typed messages, and how many do in a second, framing included, also of the peer; None where
        pymavlink is not installed.
    """
    # A short excerpt would time the loop more than the decoder.
    stream *= max(1, 100_000 // len(stream))
    chunks = [stream[at : at + _CHUNK] for at in range(0, len(stream), _CHUNK)]

    def typed() -> int:
        feed, decode, count = FrameDecoder().feed, MessageDecoder().decode, 0
        for chunk in chunks:
            for item in feed(chunk):
                if type(item) is not Dropped:
                    decode(item)  # type: ignore[arg-type]  # the test above leaves frames only
                    count += 1
        return count

    ours, peer = _best(typed, rounds), measure_peer(max(1, rounds // 3))
    ratio = round(ours / peer, 2) if peer else None
    return {"frames": typed(), "frames_per_s": round(ours), "peer_frames_per_s": peer and round(peer), "ratio": ratio}


def measure_peer(rounds: int) -> float | None:
    """How many messages pymavlink decodes a second; None where it is not installed.

    Small, middle and large messages in the shares of our mixed recording: 46 bytes a message on the average, ours 50.
    """
    try:
        from pymavlink.dialects.v20 import ardupilotmega as peer
    except ImportError:
        return None
    mav: Any = peer.MAVLink(None, 1, 1)
    ping = peer.MAVLink_ping_message(1000, 1, 1, 1)
    attitude = peer.MAVLink_attitude_message(1000, 0.1, -0.1, 1.2, 0.01, 0.02, 0.03)
    channels = peer.MAVLink_rc_channels_message(1000, 18, *range(1000, 1018), 200)
    state = peer.MAVLink_hil_state_quaternion_message(
        1000, [1.0, 0.1, 0.2, 0.3], 0.01, 0.02, 0.03, 424600000, -712700000, 1000, 10, 20, 30, 500, 510, 1, 2, 981
    )
    mixed = 2 * (ping,) + 4 * (attitude,) + (channels,) + 2 * (state,)
    stream = b"".join(message.pack(mav) for _ in range(250) for message in mixed)
    return _best(lambda: len(peer.MAVLink(None).parse_buffer(stream)), rounds)


def main(*, as_json: AsJson = False) -> int:
    """Measure decoding of genuine boards' traffic against pymavlink. About ten seconds."""
    return show([{"what": "decoding", **measure_speed(recorded(), ROUNDS)}], ("what",), as_json=as_json)
