"""What is printed for programs: recorded frames as objects, the table of messages, faults of the simulator."""

from __future__ import annotations

import io
import json
import sys

import pytest

from mkdaemon.cli.mkctl.app import app as mkctl
from mkdaemon.cli.mkdaemon.app import app
from mkdaemon.cli.mkdaemon.decode import Decoding
from mkdaemon.cli.program import run
from mkdaemon.protocol.boards import Direction
from mkdaemon.protocol.capture import Chunk
from mkdaemon.protocol.messages import (
    EchoRequest,
    VersionFc210,
)
from mkdaemon.protocol.wire import MESSAGES
from mkdaemon.telemetry.sim_faults import FAULTS
from tests.places import CAPTURES

EXCERPTS = CAPTURES


def version(major: int, minor: int) -> bytes:
    return VersionFc210.decode(bytes([major, minor, 11, 0, 0, 0, 0, 22, 0, 0])).to_frame()


def decode(*chunks: tuple[str, bytes]) -> list[dict[str, object]]:
    return list(Decoding().run(Chunk(float(at), Direction(where), raw) for at, (where, raw) in enumerate(chunks)))


def test_what_is_no_message_becomes_an_object_too():
    found = decode(("rx", b"hello\r#bv@y\r#bv@}\r#bi@k\r#bvv@x\r#bA"), ("tx", b"#bv"))
    assert [(item.get("dropped"), item.get("board"), item.get("id")) for item in found] == [
        ("text", None, None),
        ("checksum", None, None),
        ("characters", None, None),
        ("unknown", "fc", "i"),
        ("length", None, None),
        ("length", None, None),
        ("length", None, None),
    ]
    assert [item["t"] for item in found] == [0.0] * 5 + [1.0] * 2
    assert all(bytes.fromhex(str(item["hex"])) for item in found)


def test_carriage_returns_that_a_terminal_turned_are_named():
    whole, cut = version(2, 14), version(2, 14)[:-3]
    decoding = Decoding()
    list(decoding.run([Chunk(0.0, Direction.FROM_BOARD, whole[:-1] + b"\n" + cut + b"\n" + whole[:-1] + b"\n")]))
    assert (decoding.dropped.total(), decoding.turned) == (3, 2)
    assert "2 of these are whole with CR for LF" in decoding.summary()
    assert "stty -F DEVICE raw" in decoding.summary()
    honest = Decoding()
    list(honest.run([Chunk(0.0, Direction.FROM_BOARD, whole + cut + b"\r\n")]))
    assert "CR for LF" not in honest.summary()


def command(capsys: pytest.CaptureFixture[str], *tokens: str) -> tuple[int, list[dict[str, object]], str]:
    code = run(app, ["decode", *tokens])
    out, err = capsys.readouterr()
    return code, [json.loads(line) for line in out.splitlines()], err


def test_excerpt_by_the_command(capsys):
    code, objects, err = command(capsys, str(EXCERPTS / "fc_commands.jsonl"))
    dropped = [item for item in objects if "dropped" in item]
    assert (code, len(objects) - len(dropped), {item["dropped"] for item in dropped}) == (0, 213, {"unknown"})
    assert f"213 messages, {len(dropped)} dropped" in err
    assert all({"t", "dir"} <= set(item) for item in objects)
    assert all({"board", "id", "hex"} <= set(item) for item in dropped)


def test_raw_bytes_and_standard_input_give_the_same(capsys, tmp_path, monkeypatch):
    raw = EchoRequest(pattern=7).to_frame() + b"boot\r" + version(2, 12)
    path = tmp_path / "bytes.bin"
    path.write_bytes(raw)
    from_file = command(capsys, str(path))

    class Input:
        buffer = io.BytesIO(raw)

    monkeypatch.setattr(sys, "stdin", Input)
    assert command(capsys, "-") == from_file
    code, objects, err = from_file
    assert code == 0
    assert [item.get("message") or item["dropped"] for item in objects] == ["EchoRequest", "text", "Version"]
    assert objects[0] == {
        "t": None,
        "dir": "rx",
        "board": "nc",
        "id": "z",
        "message": "EchoRequest",
        "layout": "1",
        "fields": {"pattern": 7},
    }
    assert "dropped: text" in err


def printed(capsys, *tokens):
    assert run(app, ["schema", *tokens]) == 0
    return json.loads(capsys.readouterr().out)


def test_the_table_has_a_row_for_every_place(capsys):
    rows = printed(capsys, "--wire")
    assert [(row["board"], row["id"], row["layout"]) for row in rows] == [
        (board.word, letter, layout) for board, letter, layout in MESSAGES
    ]


def test_without_the_option_it_is_a_json_schema_of_every_message(capsys):
    schemas = printed(capsys)
    assert set(schemas) == {cls.__name__ for cls in MESSAGES.values()}
    assert schemas["ExternControlV2"]["properties"]["pitch"]["maximum"] == 127


def test_faults_are_told_to_programs_too(capsys):
    assert run(mkctl, ["sim", "faults", "--json"]) == 0
    told = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [fault["name"] for fault in told] == list(FAULTS)
    weak = next(fault for fault in told if fault["name"] == "motor_weak")
    assert weak["effect"].endswith(".")
    assert weak["parameters"]["share"]["high"] == 1.0
