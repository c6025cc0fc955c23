"""Recorded traffic of genuine firmware: nothing is lost; and recordings that are damaged are named."""

from __future__ import annotations

import io
import json
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from mkdaemon.errors import MkError
from mkdaemon.protocol.boards import Direction
from mkdaemon.protocol.capture import Chunk, read_chunks
from mkdaemon.protocol.decoder import MessageDecoder, Unknown
from mkdaemon.protocol.framing import Dropped, Frame, FrameDecoder
from mkdaemon.protocol.wire import MESSAGES, WireMessage
from tests.places import CAPTURES

NAMES = ("fc_commands", "fc_debug_stream_95s", "fc_latency", "nc_commands", "nc_mixed_60s")
EXCERPTS = CAPTURES


def chunks(path: Path) -> Iterator[tuple[str, bytes]]:
    for line in path.read_text(encoding="utf-8").splitlines():
        entry = json.loads(line)
        yield entry["dir"], bytes.fromhex(entry["hex"])


def independent_count(stream: bytes) -> tuple[Counter[tuple[int, str]], int]:
    """Right frames by address and letter, and CR-ended pieces that are none; written bit by bit on purpose."""
    good: Counter[tuple[int, str]] = Counter()
    bad = 0
    piece: list[int] = []
    for byte in stream:
        if byte == 0x23:
            bad += bool(piece)
            piece = [byte]
        elif byte != 0x0D:
            piece.append(byte)
        else:
            body, check = piece[:-2], piece[-2:]
            total = sum(body) % 4096
            right = (
                len(piece) >= 5
                and (len(piece) - 5) % 4 == 0
                and check == [0x3D + total // 64, 0x3D + total % 64]
                and all(0x3D <= character <= 0x7C for character in piece[3:])
            )
            if right:
                good[piece[1] - 0x61, chr(piece[2])] += 1
            else:
                bad += bool(piece)
            piece = []
    return good, bad + bool(piece)


def decoded(path: Path) -> tuple[dict[str, list[WireMessage | Unknown]], dict[str, list[Frame]], list[Dropped]]:
    framing = {"rx": FrameDecoder(), "tx": FrameDecoder()}
    typing = MessageDecoder()
    messages: dict[str, list[WireMessage | Unknown]] = {"rx": [], "tx": []}
    frames: dict[str, list[Frame]] = {"rx": [], "tx": []}
    dropped: list[Dropped] = []
    for direction, raw in chunks(path):
        for item in framing[direction].feed(raw):
            if isinstance(item, Dropped):
                dropped.append(item)
            else:
                frames[direction].append(item)
                messages[direction].append(typing.decode(item))
    for decoder in framing.values():
        dropped += [item for item in decoder.flush() if isinstance(item, Dropped)]
    return messages, frames, dropped


def check_against_independent_count(path: Path) -> None:
    messages, frames, dropped = decoded(path)
    bad_total = 0
    for direction in ("rx", "tx"):
        stream = b"".join(raw for where, raw in chunks(path) if where == direction)
        good, bad = independent_count(stream)
        bad_total += bad
        assert Counter((frame.address, frame.id) for frame in frames[direction]) == good
        assert len(messages[direction]) == good.total()
        for message, frame in zip(messages[direction], frames[direction], strict=True):
            if isinstance(message, Unknown):
                assert (message.id, message.payload) == (frame.id, frame.payload)
                assert message.reason
            else:
                text = any(slot.wire.is_text and slot.wire.trim for slot in message.spec.slots)
                if not text and not message.spec.open_ended:
                    rebuilt = type(message).model_construct(**dict(message)).encode()
                    assert frame.payload.startswith(rebuilt), message
    assert len(dropped) == bad_total


@pytest.mark.parametrize("name", NAMES)
def test_excerpt(name):
    check_against_independent_count(EXCERPTS / f"{name}.jsonl")


def test_every_board_answer_in_the_excerpts_is_typed():
    """What a genuine board says is never unknown; only a host's deliberate mistakes are."""
    seen = set()
    for name in NAMES:
        messages, _, _ = decoded(EXCERPTS / f"{name}.jsonl")
        for message in messages["rx"]:
            assert isinstance(message, WireMessage), message
            seen.add(message.spec.id)
    assert seen == set("ABCDEGHJLNOPQTUVWXZ") & {letter for _, letter, _ in MESSAGES}


def test_a_capture_keeps_time_and_direction():
    text = b'{"t": 0.5, "dir": "tx", "hex": "2362"}\n\n{"t": 1, "dir": "rx", "hex": ""}\n'
    assert list(read_chunks(io.BytesIO(text), "x")) == [
        Chunk(0.5, Direction.TO_BOARD, b"#b"),
        Chunk(1.0, Direction.FROM_BOARD, b""),
    ]


def test_what_an_editor_puts_before_a_capture_is_passed_over():
    text = b'\xef\xbb\xbf\r\n \n{"t": 0.5, "dir": "tx", "hex": "2362"}\n'
    assert list(read_chunks(io.BytesIO(text), "x")) == [Chunk(0.5, Direction.TO_BOARD, b"#b")]
    with pytest.raises(MkError, match="x line 3"):
        list(read_chunks(io.BytesIO(b"\n\n{}\n"), "x"))


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (b"", "x is empty: nothing was recorded"),
        (b"{", "x line 1 is no capture line"),
        (b'{"t": 1, "dir": "rx"}\n', "x line 1"),
        (b'{"t": 1, "dir": "up", "hex": ""}\n', "x line 1"),
        (b'{"t": null, "dir": "rx", "hex": ""}\n', "x line 1"),
        (b'{"t": NaN, "dir": "rx", "hex": ""}\n', "x line 1"),
        (b'{"t": true, "dir": "rx", "hex": ""}\n', "x line 1"),
        (b'{"t": "1", "dir": "rx", "hex": ""}\n', "x line 1"),
        (b'{"t": 0, "dir": "rx", "hex": ""}\n{"t": 1, "dir": "rx", "hex": "2"}\n', "x line 2"),
        (b'{"t": 0, "dir": "rx", "hex": ""}\n[1]\n', "x line 2"),
        (b'{"t": 0, "dir": "rx", "hex": ""}\n\xff\xfe\n', "x line 2"),
    ],
)
def test_a_damaged_recording_is_named_with_its_line(text, reason):
    with pytest.raises(MkError, match=reason):
        list(read_chunks(io.BytesIO(text), "x"))


def test_what_a_pipe_has_is_handed_over_without_waiting_for_more():
    class Pipe(io.BytesIO):
        def read1(self, size: int | None = -1) -> bytes:
            return super().read(min(size or 0, 3))

    assert [chunk.raw for chunk in read_chunks(Pipe(b"#bv@x\r"), "x")] == [b"#", b"bv@", b"x\r"]
