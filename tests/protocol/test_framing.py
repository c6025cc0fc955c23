from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mkdaemon.errors import EncodeError
from mkdaemon.protocol.framing import MAX_FRAME_CHARS, Dropped, DropReason, Frame, FrameDecoder, encode_frame
from tests.protocol.strategies import split

GOOD = b"#bv@x\r"
ADDRESSES = st.integers(0, 27)
LETTERS = st.characters(min_codepoint=0x21, max_codepoint=0x7E).filter(lambda letter: letter != "#")
PAYLOADS = st.binary(max_size=378)


def slow_encode(address: int, command: str, payload: bytes) -> bytes:
    """The framing written out bit by bit, to hold the fast one against."""
    payload += bytes(-len(payload) % 3)
    out = bytearray(b"#" + bytes([0x61 + address]) + command.encode())
    for first, second, third in zip(payload[::3], payload[1::3], payload[2::3], strict=True):
        out += bytes(
            0x3D + sextet
            for sextet in (first >> 2, (first & 3) << 4 | second >> 4, (second & 15) << 2 | third >> 6, third & 63)
        )
    total = sum(out) % 4096
    return bytes(out) + bytes([0x3D + total // 64, 0x3D + total % 64, 13])


@given(ADDRESSES, LETTERS, PAYLOADS)
def test_encoding_is_the_written_out_one(address, command, payload):
    assert encode_frame(address, command, payload) == slow_encode(address, command, payload)


@given(ADDRESSES, LETTERS, PAYLOADS, st.lists(st.integers(0, 520), max_size=8))
def test_a_frame_survives_any_chunking(address, command, payload, cuts):
    wire = encode_frame(address, command, payload)
    decoder = FrameDecoder()
    found = [item for part in split(wire, cuts) for item in decoder.feed(part)]
    assert found == [Frame(address, command, payload + bytes(-len(payload) % 3), wire)]
    assert decoder.pending == 0


@pytest.mark.parametrize(
    ("address", "command", "payload"),
    [(28, "v", b""), (-1, "v", b""), (1, "", b""), (1, "vv", b""), (1, "#", b""), (1, " ", b""), (1, "é", b"")],
)
def test_what_cannot_be_framed_is_refused(address, command, payload):
    with pytest.raises(EncodeError, match="one printable letter"):
        encode_frame(address, command, payload)


def test_a_payload_too_long_is_refused():
    assert len(encode_frame(1, "s", bytes(378))) <= MAX_FRAME_CHARS
    with pytest.raises(EncodeError, match="382 bytes"):
        encode_frame(1, "s", bytes(382))


@pytest.mark.parametrize(
    ("raw", "expected"),
    [
        (b"", []),
        (b"\r\r\n \0\t\r", []),
        (GOOD, [(None, GOOD)]),
        (b"\r\r" + GOOD, [(None, GOOD)]),
        (b"boot v0.24\r" + GOOD, [("text", b"boot v0.24"), (None, GOOD)]),
        (b"\r\r\n UART2 init...ok" + GOOD, [("text", b"\n UART2 init...ok"), (None, GOOD)]),
        (b"\x1b\x1b\x55\xaa\x00" + GOOD, [("text", b"\x1b\x1b\x55\xaa\x00"), (None, GOOD)]),
        (b"#" + GOOD, [("length", b"#"), (None, GOOD)]),
        (b"##bA?RV" + GOOD, [("length", b"#"), ("length", b"#bA?RV"), (None, GOOD)]),
        (b"tail#bA" + GOOD, [("text", b"tail"), ("length", b"#bA"), (None, GOOD)]),
        (b"#bv@y\r" + GOOD, [("checksum", b"#bv@y\r"), (None, GOOD)]),
        (b"#bv@\r", [("length", b"#bv@\r")]),
        (b"#bv=@x\r", [("length", b"#bv=@x\r")]),
        (b"#\r", [("length", b"#\r")]),
        (b"#bv@}\r", [("characters", b"#bv@}\r")]),
        (b"#bv@x\n#bv@x\r", [("length", b"#bv@x\n"), (None, GOOD)]),
        (b"#Bv@X\r", [("characters", b"#Bv@X\r")]),
        (b"#b\xff\xff\xff\r", [("characters", b"#b\xff\xff\xff\r")]),
        (b"#" + b"b" * 600 + b"\r" + GOOD, [("length", b"#" + b"b" * 600 + b"\r"), (None, GOOD)]),
    ],
)
def test_what_is_no_frame_is_named(raw, expected):
    found = FrameDecoder().feed(raw)
    assert [(item.reason.value if isinstance(item, Dropped) else None, item.raw) for item in found] == expected
    decoder = FrameDecoder()
    piecewise = [item for at in range(0, len(raw), 3) for item in decoder.feed(raw[at : at + 3])]
    assert [item for item in piecewise if isinstance(item, Frame)] == [
        item for item in found if isinstance(item, Frame)
    ]


def with_checksum(head: bytes) -> bytes:
    total = sum(head) % 4096
    return head + bytes([0x3D + total // 64, 0x3D + total % 64, 13])


@pytest.mark.parametrize(
    "head",
    [
        b"#bD0000",
        b"#bD====\x01===",
        b"#bD}}}}",
        b"#bD~===",
        b"#bDA0B+",
        b"#AD====",
        b"#}D====",
        b"#b\x7f====",
        b"#b ====",
    ],
)
def test_a_right_checksum_does_not_excuse_a_foreign_character(head):
    raw = with_checksum(head)
    assert FrameDecoder().feed(raw) == [Dropped(DropReason.CHARACTERS, raw)]


@given(
    st.lists(st.binary(max_size=600) | st.sampled_from([b"#", b"\r", GOOD, GOOD[:3], b"#b" + b"=" * 300]), max_size=12)
)
def test_any_bytes_leave_it_alive_bounded_and_ready_and_each_is_in_one_result_or_idle(chunks):
    decoder, found = FrameDecoder(), []
    for chunk in chunks:
        found += decoder.feed(chunk)
        assert decoder.pending <= MAX_FRAME_CHARS
    found += decoder.flush()
    idle = b"\r \n\t\0"
    assert b"".join(item.raw for item in found).translate(None, idle) == b"".join(chunks).translate(None, idle)
    assert decoder.feed(b"\r" + GOOD)[-1] == Frame(1, "v", b"", GOOD)
