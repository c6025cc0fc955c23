"""`python -m lab protocol`: how fast recorded traffic becomes typed messages.

The peer is pymavlink decoding messages of about the same size in the same run, because a figure of one machine says
little on another. Best of several rounds: the least disturbed one. Processor time, not wall time, for the same reason.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Final

from cyclopts import Parameter

from lab.campaign import Row
from lab.places import CAPTURES, REFERENCE
from lab.tables import show
from mkdaemon.cli.arguments import AsJson
from mkdaemon.errors import MkError
from mkdaemon.protocol.boards import Direction
from mkdaemon.protocol.capture import read_chunks
from mkdaemon.protocol.decoder import MessageDecoder
from mkdaemon.protocol.framing import Dropped, FrameDecoder

_CHUNK: Final = 64
"""Bytes handed to the decoder at once: about what a serial port has after 11 ms."""


def recording_of(path: Path) -> bytes:
    """Return all bytes a capture received from the board.

    Raises:
        MkError: there is no such capture, or a line of it is damaged.
    """
    if not path.is_file():
        msg = f"{path} is missing: run the benchmark in the source tree or name a recording with --recording"
        raise MkError(msg)
    with path.open("rb") as stream:
        return b"".join(
            raw for _, direction, raw in read_chunks(stream, str(path)) if direction is Direction.FROM_BOARD
        )


def default_recording() -> Path:
    """Return the whole recording where it lies beside the source tree, otherwise the excerpt kept with the tests."""
    whole = REFERENCE / "captures" / "nc_mixed_60s.jsonl"
    return whole if whole.is_file() else CAPTURES / "nc_mixed_60s.jsonl"


def _best(run: Callable[[], int], rounds: int) -> tuple[float, int]:
    """Return the shortest processor time of a run [s], and what it counted."""
    shortest, count = float("inf"), 0
    gc.collect()
    for _ in range(rounds):
        before = time.process_time()
        count = run()
        shortest = min(shortest, time.process_time() - before)
    return shortest, count


def measure_speed(stream: bytes, source: str, *, rounds: int = 15) -> Row:
    """Decode a stream again and again and keep the best.

    Args:
        stream: bytes of the line.
        source: what they are, for the report.
        rounds: how often.

    Returns:
        Frames in it, and how many a second become typed messages, framing included; `framing_us` is the part of it
        until the frames are cut and checked. The peer is pymavlink, bytes to messages; 0 where it is not installed.
    """
    # A short excerpt would time the loop more than the decoder.
    stream *= max(1, 100_000 // len(stream))
    chunks = [stream[at : at + _CHUNK] for at in range(0, len(stream), _CHUNK)]

    def frames_only() -> int:
        feed = FrameDecoder().feed
        return sum(len(feed(chunk)) for chunk in chunks)

    def typed() -> int:
        feed, decode, count = FrameDecoder().feed, MessageDecoder().decode, 0
        for chunk in chunks:
            for item in feed(chunk):
                if type(item) is not Dropped:
                    decode(item)  # type: ignore[arg-type]  # the test above leaves frames only
                    count += 1
        return count

    framing_s, _ = _best(frames_only, rounds)
    seconds, frames = _best(typed, rounds)
    peer = measure_peer(rounds=max(1, rounds // 3))
    return {
        "source": source,
        "frames": frames,
        "frames_per_s": round(frames / seconds),
        "us_per_frame": round(seconds / frames * 1e6, 3),
        "mb_per_s": round(len(stream) / seconds / 1e6, 2),
        "framing_us": round(framing_s / frames * 1e6, 3),
        "peer_frames_per_s": round(peer),
        "ratio": round(frames / seconds / peer, 2) if peer else 0.0,
    }


def measure_peer(*, rounds: int = 5) -> float:
    """Return how many messages pymavlink decodes a second; 0 where it is not installed.

    Small, middle and large messages in the shares of our mixed recording: 46 bytes a message on the average, ours 50.
    """
    try:
        from pymavlink.dialects.v20 import ardupilotmega as peer
    except ImportError:
        return 0.0
    mav: Any = peer.MAVLink(None, 1, 1)
    ping = peer.MAVLink_ping_message(1000, 1, 1, 1)
    attitude = peer.MAVLink_attitude_message(1000, 0.1, -0.1, 1.2, 0.01, 0.02, 0.03)
    channels = peer.MAVLink_rc_channels_message(1000, 18, *range(1000, 1018), 200)
    state = peer.MAVLink_hil_state_quaternion_message(
        1000, [1.0, 0.1, 0.2, 0.3], 0.01, 0.02, 0.03, 424600000, -712700000, 1000, 10, 20, 30, 500, 510, 1, 2, 981
    )
    mixed = 2 * (ping,) + 4 * (attitude,) + (channels,) + 2 * (state,)
    stream = b"".join(message.pack(mav) for _ in range(250) for message in mixed)

    def run() -> int:
        return len(peer.MAVLink(None).parse_buffer(stream))

    seconds, messages = _best(run, rounds)
    return messages / seconds


def main(
    *,
    recording: Annotated[Path | None, Parameter(help="Capture to decode.")] = None,
    rounds: Annotated[int, Parameter(help="Repetitions; the best counts.")] = 15,
    as_json: AsJson = False,
) -> int:
    """Measure decoding against pymavlink: a recording of genuine boards, as often as told. About ten seconds.

    Raises:
        MkError: the recording is missing.
    """
    path = recording or default_recording()
    return show([measure_speed(recording_of(path), path.name, rounds=rounds)], ("source",), as_json=as_json)
