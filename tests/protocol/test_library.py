"""`mkdaemon.protocol` as a program of somebody else uses it."""

from __future__ import annotations

import io
import subprocess
import sys
import textwrap

from mkdaemon.protocol import (
    Board,
    Chunk,
    Direction,
    Dropped,
    DropReason,
    TrafficDecoder,
    Unknown,
    decode_capture,
    messages,
)
from tests.places import CAPTURES, ROOT

CAPTURE = CAPTURES / "nc_mixed_60s.jsonl"


def run_python(script: str) -> str:
    """Run a script in a new interpreter and return what it printed."""
    command = [sys.executable, "-c", textwrap.dedent(script)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout


def test_the_package_imports_no_input_or_output_and_ten_lines_decode_a_capture():
    loaded, counts = run_python(
        f"""
        import sys
        from collections import Counter
        from mkdaemon.protocol import MESSAGES, WireMessage, decode_capture

        print(len(MESSAGES) > 90, {{"zenoh", "serial", "cv2", "numpy", "asyncio"}} & set(sys.modules))
        seen = Counter()
        with open({str(CAPTURE)!r}, "rb") as recording:
            for t, direction, frame, content in decode_capture(recording):
                if isinstance(content, WireMessage):
                    seen[content.spec.name] += 1
        print(seen["OsdData"], seen["DebugData"])
        """
    ).splitlines()
    assert loaded.split() == ["True", "set()"]
    assert [int(count) > 0 for count in counts.split()] == [True, True]


def test_losses_and_unknown_frames_have_their_own_types():
    found = list(decode_capture(io.BytesIO(b"hello\r#bi@k\r#bv@x\r#bv")))
    assert [type(item.content) for item in found] == [Dropped, Unknown, messages.VersionRequest, Dropped]
    assert [item.board for item in found] == [None, Board.FC, Board.FC, None]
    assert isinstance(found[0].content, Dropped)
    assert found[0].content.reason is DropReason.TEXT


def test_the_directions_do_not_mix():
    decoder = TrafficDecoder()
    assert decoder.feed(Chunk(0.0, Direction.FROM_BOARD, b"#bv")) == []
    assert decoder.feed(Chunk(0.1, Direction.TO_BOARD, b"@x\r"))[0].frame is None
    (whole,) = decoder.feed(Chunk(0.2, Direction.FROM_BOARD, b"@x\r"))
    assert (whole.t, whole.direction) == (0.2, Direction.FROM_BOARD)
    assert isinstance(whole.content, messages.VersionRequest)
