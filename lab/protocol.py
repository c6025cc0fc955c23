"""`python -m lab protocol`: how fast recorded traffic becomes typed messages.

Best of several rounds, in processor time: the least disturbed one.
"""

from __future__ import annotations

import time
from typing import Final

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


def measure_speed(stream: bytes, rounds: int) -> Row:
    """Decode bytes of a line again and again.

    Returns:
        `frames` that become typed messages, and how many do in a second, framing included.
    """
    # A short excerpt would time the loop more than the decoder.
    stream *= max(1, 100_000 // len(stream))
    chunks = [stream[at : at + _CHUNK] for at in range(0, len(stream), _CHUNK)]
    shortest, count = float("inf"), 0
    for _ in range(rounds):
        before = time.process_time()
        feed, decode, count = FrameDecoder().feed, MessageDecoder().decode, 0
        for chunk in chunks:
            for item in feed(chunk):
                if type(item) is not Dropped:
                    decode(item)  # type: ignore[arg-type]  # the test above leaves frames only
                    count += 1
        shortest = min(shortest, time.process_time() - before)
    return {"frames": count, "frames_per_s": round(count / shortest)}


def main(*, as_json: AsJson = False) -> int:
    """Measure decoding of genuine boards' traffic. About five seconds."""
    return show([{"what": "decoding", **measure_speed(recorded(), ROUNDS)}], ("what",), as_json=as_json)
