"""Tables that are printed for programs: messages, and faults of the simulator."""

from __future__ import annotations

import json

from mkdaemon.cli.mkctl.app import app as mkctl
from mkdaemon.cli.mkdaemon.app import app
from mkdaemon.cli.program import run
from mkdaemon.protocol.wire import MESSAGES
from mkdaemon.telemetry.sim_faults import FAULTS


def printed(capsys, *tokens):
    assert run(app, ["schema", *tokens]) == 0
    return json.loads(capsys.readouterr().out)


def test_the_table_has_a_row_for_every_place(capsys):
    rows = printed(capsys, "--wire")
    assert [(row["board"], row["id"], row["layout"]) for row in rows] == [
        (board.word, letter, layout) for board, letter, layout in MESSAGES
    ]


def test_a_row_says_all_of_a_layout(capsys):
    (row,) = (row for row in printed(capsys, "--wire") if (row["board"], row["id"], row["layout"]) == ("fc", "b", "v2"))
    assert (row["name"], row["direction"], row["size"], row["reply"]) == ("ExternControl", "to_board", 7, "B")
    assert row["danger"] == "flies the aircraft"
    roll = row["fields"][1]
    assert roll["meaning"].startswith("Positive on the wire: stick LEFT")
    del roll["meaning"]
    assert roll == {
        "name": "roll",
        "firmware_word": "Roll",
        "type": "s8",
        "offset": 1,
        "unit": "stick",
        "scale": -1.0,
        "zero": 0,
        "si_unit": "stick",
        "values": None,
    }
    assert row["fields"][5]["values"]["VALID"] == 1


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
