"""`python -m lab protocol`: how fast recorded traffic becomes typed messages, and whether damaged traffic is survived.

The peer is pymavlink decoding messages of about the same size in the same run, because a figure of one machine says
little on another. Best of several rounds: the least disturbed one. Processor time, not wall time, for the same reason.
"""

from __future__ import annotations

import gc
import json
import random
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Final

from cyclopts import Parameter

from lab.places import CAPTURES, REFERENCE
from mkdaemon.cli.arguments import AsJson
from mkdaemon.errors import MkError
from mkdaemon.protocol.boards import Direction
from mkdaemon.protocol.capture import read_chunks
from mkdaemon.protocol.decoder import MessageDecoder, Unknown
from mkdaemon.protocol.framing import MAX_FRAME_CHARS, Dropped, FrameDecoder, encode_frame

_CHUNK: Final = 64
"""Bytes handed to the decoder at once: about what a serial port has after 11 ms."""
_GOOD: Final = b"\r#bv@x\r"


@dataclass(frozen=True, slots=True)
class Speed:
    """How fast frames become messages.

    Attributes:
        source: what was decoded.
        frames: frames in it.
        frames_per_s: frames to typed messages, framing included.
        us_per_frame: the same, the other way round.
        mb_per_s: bytes of the line.
        framing_us: part of it until the frames are cut and checked.
        peer_frames_per_s: pymavlink, bytes to messages; 0 where it is not installed.
        ratio: ours over the peer's; 0 where it is not installed.
    """

    source: str
    frames: int
    frames_per_s: float
    us_per_frame: float
    mb_per_s: float
    framing_us: float
    peer_frames_per_s: float
    ratio: float


@dataclass(frozen=True, slots=True)
class Survival:
    """What damaged bytes did.

    Attributes:
        fuzz_bytes: random and mutated bytes decoded.
        fuzz_messages: typed messages among them.
        fuzz_unknown: right frames without a message.
        fuzz_dropped: losses by reason.
        fuzz_pending_max: most bytes ever held back.
        fuzz_resynchronised: times a good frame put in after a block came out of it.
        fuzz_blocks: such blocks.
    """

    fuzz_bytes: int
    fuzz_messages: int
    fuzz_unknown: int
    fuzz_dropped: dict[str, int]
    fuzz_pending_max: int
    fuzz_resynchronised: int
    fuzz_blocks: int


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


def measure_speed(stream: bytes, source: str, *, rounds: int = 15) -> Speed:
    """Decode a stream again and again and keep the best.

    Args:
        stream: bytes of the line.
        source: what they are, for the report.
        rounds: how often.
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
    return Speed(
        source=source,
        frames=frames,
        frames_per_s=round(frames / seconds),
        us_per_frame=round(seconds / frames * 1e6, 3),
        mb_per_s=round(len(stream) / seconds / 1e6, 2),
        framing_us=round(framing_s / frames * 1e6, 3),
        peer_frames_per_s=round(peer),
        ratio=round(frames / seconds / peer, 2) if peer else 0.0,
    )


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


def survive(stream: bytes, total: int, *, seed: int = 1) -> Survival:
    """Decode random and mutated bytes; a good frame must come out after every block.

    Args:
        stream: recorded bytes to damage.
        total: bytes to decode.
        seed: of everything random.
    """
    rng = random.Random(seed)
    decoder, typing = FrameDecoder(), MessageDecoder()
    dropped: dict[str, int] = {}
    messages = unknown = fed = pending = good = blocks = 0
    while fed < total:
        block = _damaged(stream, rng) if rng.random() < 0.6 else _random_frames(rng)
        block += _GOOD
        at, last = 0, b""
        while at < len(block):
            step = rng.randrange(1, 300)
            for item in decoder.feed(block[at : at + step]):
                last = item.raw
                if isinstance(item, Dropped):
                    dropped[item.reason.value] = dropped.get(item.reason.value, 0) + 1
                elif isinstance(typing.decode(item), Unknown):
                    unknown += 1
                else:
                    messages += 1
            pending = max(pending, decoder.pending)
            at += step
        blocks += 1
        good += last == _GOOD[1:]
        fed += len(block)
    return Survival(fed, messages, unknown, dict(sorted(dropped.items())), pending, good, blocks)


def _damaged(stream: bytes, rng: random.Random) -> bytes:
    """A piece of the recording with flips, deletions and insertions."""
    start = rng.randrange(max(1, len(stream) - 4096))
    piece = bytearray(stream[start : start + 4096])
    for _ in range(rng.randrange(1, 80)):
        at = rng.randrange(len(piece))
        fault = rng.randrange(4)
        if fault == 0:
            piece[at] ^= 1 << rng.randrange(8)
        elif fault == 1:
            del piece[at : at + rng.randrange(1, 20)]
        elif fault == 2:
            piece[at:at] = rng.randbytes(rng.randrange(1, 8))
        else:
            piece[at] = rng.choice(b"#\r=|\x1b\0")
        piece = piece or bytearray(b"#")
    return bytes(piece)


def _random_frames(rng: random.Random) -> bytes:
    """Noise, noise of the alphabet, or right frames with random contents."""
    kind = rng.randrange(3)
    if kind == 0:
        return rng.randbytes(4096)
    if kind == 1:
        return bytes(rng.choices(b"#\r" + bytes(range(0x3D, 0x7D)), k=4096))
    parts = []
    for _ in range(40):
        letter = chr(rng.randrange(0x41, 0x7B))
        parts.append(encode_frame(rng.randrange(28), letter, rng.randbytes(rng.randrange(180))))
    return b"".join(parts)


def main(
    *,
    recording: Annotated[Path | None, Parameter(help="Capture to decode.")] = None,
    fuzz_bytes: Annotated[int, Parameter(help="Random and mutated bytes to survive.")] = 10_000_000,
    rounds: Annotated[int, Parameter(help="Repetitions; the best counts.")] = 15,
    as_json: AsJson = False,
) -> int:
    """Measure decoding against pymavlink and survive damaged bytes; exit code 1 when a good frame was missed.

    It decodes a recording of genuine boards as often as told, and feeds the decoder random and mutated bytes. About ten
    seconds.

    Raises:
        MkError: the recording is missing.
    """
    path = recording or default_recording()
    stream = recording_of(path)
    speed = measure_speed(stream, path.name, rounds=rounds)
    survival = survive(stream, fuzz_bytes)
    if as_json:
        print(json.dumps({**asdict(speed), **asdict(survival)}))
    else:
        print(f"{speed.source}: {speed.frames_per_s} frames/s, {speed.us_per_frame} us a frame, {speed.mb_per_s} MB/s")
        print(f"pymavlink: {speed.peer_frames_per_s} messages/s; ratio {speed.ratio}")
        print(
            f"{survival.fuzz_bytes} damaged bytes: {survival.fuzz_resynchronised} of {survival.fuzz_blocks} recovered"
        )
    is_sound = survival.fuzz_resynchronised == survival.fuzz_blocks and survival.fuzz_pending_max <= MAX_FRAME_CHARS
    return 0 if is_sound else 1
