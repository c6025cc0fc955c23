"""Recordings: raw bytes and captures, good and damaged."""

from __future__ import annotations

import io

import pytest

from mkdaemon.errors import MkError
from mkdaemon.protocol.boards import Direction
from mkdaemon.protocol.capture import Chunk, read_chunks


def test_raw_bytes_have_no_time():
    chunks = list(read_chunks(io.BytesIO(b"#bv@x\r" * 2000), "x"))
    assert all(chunk[:2] == (None, Direction.FROM_BOARD) for chunk in chunks)
    assert b"".join(chunk.raw for chunk in chunks) == b"#bv@x\r" * 2000


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


def test_blanks_before_raw_bytes_are_bytes():
    assert b"".join(chunk.raw for chunk in read_chunks(io.BytesIO(b"\r\n #bv@x\r"), "x")) == b"\r\n #bv@x\r"
    assert [chunk.raw for chunk in read_chunks(io.BytesIO(b"\r\n"), "x")] == [b"\r\n"]


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
