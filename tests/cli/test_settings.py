"""Parameter sets and mixers on the command line: what is told and refused; the board answers messages."""

from __future__ import annotations

import json
import re
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path

import pytest

from mkdaemon.cli.mkctl.app import app
from mkdaemon.cli.mkctl.connection import Connection
from mkdaemon.cli.program import EXIT_CONFIG, EXIT_FAILURE, EXIT_OK
from mkdaemon.client.settings_files import read_sets
from mkdaemon.errors import ConfigError
from tests.cli.conftest import Ctl
from tests.client.message_boards import BoardVehicle
from tests.protocol.procedures.talk import FlightCtrl


@pytest.fixture
def board(monkeypatch: pytest.MonkeyPatch) -> FlightCtrl:
    """A FlightCtrl behind a daemon that needs no line."""
    flight = FlightCtrl()

    @asynccontextmanager
    async def opened(connection: Connection) -> AsyncIterator[BoardVehicle]:
        yield BoardVehicle(flight)

    monkeypatch.setattr(Connection, "open", opened)
    return flight


@pytest.fixture
def ctl(typed: Ctl) -> Ctl:
    return partial(typed, app, "settings")


def test_list_and_show(board: FlightCtrl, ctl: Ctl) -> None:
    code, out, _ = ctl("list")
    assert (code, [line[:4] for line in out.splitlines()]) == (EXIT_OK, ["  1 ", "  2 ", "* 3 ", "  4 ", "  5 "])
    code, out, _ = ctl("show", "--slot", "2", "--json")
    shown = json.loads(out)
    assert (shown["slot"], shown["revision"], shown["values"]["gyro_p"]) == (2, 106, board.sets[2][30])
    assert ctl("show", "gyro_p")[1].splitlines()[1].split()[:2] == ["gyro_p", str(board.sets[3][30])]
    code, _, err = ctl("show", "gyro_q")
    assert code == EXIT_FAILURE
    assert "the nearest name is 'gyro_p'" in err
    assert board.live == board.sets[3]


def test_a_folder_keeps_five_sets_and_is_never_overwritten(board: FlightCtrl, ctl: Ctl, tmp_path: Path) -> None:
    folder = tmp_path / "backup"
    code, out, _ = ctl("backup", str(folder), "--json")
    assert (code, len(json.loads(out)["files"]), json.loads(out)["active"]) == (EXIT_OK, 5, 3)
    assert {slot: source.parameters.raw for slot, source in read_sets(folder).items()} == board.sets
    assert ctl("backup", str(folder))[0] == EXIT_CONFIG
    assert ctl("backup", str(folder), "--force")[0] == EXIT_OK
    one = tmp_path / "one.json"
    assert ctl("backup", str(one), "--slot", "5")[0] == EXIT_OK
    assert read_sets(one)[5].parameters.raw == board.sets[5]
    code, _, err = ctl("backup", str(one))
    assert (code, "already exists" in err) == (EXIT_CONFIG, True)
    (folder / "again.toml").write_text((folder / "set2.toml").read_text())
    with pytest.raises(ConfigError, match=r"set2\.toml: slot 2 is also in .*again\.toml; keep one of them"):
        read_sets(folder)


def test_files_and_boards_are_compared(board: FlightCtrl, ctl: Ctl, tmp_path: Path) -> None:
    before, after = tmp_path / "before.toml", tmp_path / "after.toml"
    ctl("backup", str(before), "--slot", "1")
    assert ctl("write", "gyro_p=7", "--slot", "1")[0] == EXIT_OK
    ctl("backup", str(after), "--slot", "1")
    code, out, _ = ctl("compare", str(before), str(after))
    assert code == EXIT_FAILURE
    assert out == f"set 1: gyro_p is {board.sets[2][30] - 7} in the first and 7 in the second\n"
    code, out, _ = ctl("compare", str(before), "--json")
    assert (code, json.loads(out)["1"][0]["name"]) == (EXIT_FAILURE, "gyro_p")
    assert ctl("compare", str(after))[:2] == (EXIT_OK, "no difference\n")


def test_restore_into_another_slot_and_edit_of_bits(board: FlightCtrl, ctl: Ctl, tmp_path: Path) -> None:
    file = tmp_path / "set.toml"
    ctl("backup", str(file), "--slot", "1")
    assert ctl("restore", str(file), "--slot", "4")[0] == EXIT_OK
    assert board.sets[4] == board.sets[1]
    assert ctl("restore", str(file), "--slot", "4")[1].splitlines()[-1] == "nothing had to be written"
    assert ctl("write", "global_config=compass,gps", "external_control=poti2")[0] == EXIT_OK
    assert ctl("write", "receiver=9", "altitude_channel=32", "external_control=poti8", "--dry-run")[0] == EXIT_OK
    assert (board.sets[3][13], board.sets[3][98]) == (0x28, 254)
    assert (board.active, board.live) == (3, board.sets[3])


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["write"], "nothing to change; write NAME=VALUE"),
        (["write", "gyro_p"], "'gyro_p' is not a change; write NAME=VALUE"),
        (["write", "gyro_q=1"], "the nearest name is 'gyro_p'"),
        (["write", "gyro_p=300"], "gyro_p takes 0..255"),
        (["write", "gyro_p=much"], "gyro_p .* cannot be 'much'"),
        (["restore", "none.toml"], "none.toml: cannot be read"),
        (["restore", "empty"], "no .toml or .json file in this folder"),
        (["restore", "photo.toml"], r"not text \(byte 128\)"),
        (["restore", "odd.toml"], "106 has 144 bytes, these are 2: raw bytes only; such sets are a record and never"),
        (["write", "receiver=10"], r"receiver takes 0\.\.9, not"),
        (["write", "altitude_channel=33"], r"altitude_channel takes 0\.\.32, not"),
        (["write", "orientation_angle=24"], r"orientation_angle takes 0\.\.23, not"),
    ],
)
def test_mistakes_are_one_line_with_the_fix(
    board: FlightCtrl,
    ctl: Ctl,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    words: list[str],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    (tmp_path / "photo.toml").write_bytes(bytes(range(256)))
    ctl("backup", "odd.toml", "--slot", "1")
    head = Path("odd.toml").read_text().partition("[values]")[0]
    Path("odd.toml").write_text(re.sub("(?m)^raw = .*", 'raw = "6a00"', head))
    before = dict(board.sets)
    code, _, err = ctl(*words)
    assert (code, err.count("\n")) == (EXIT_CONFIG, 1)
    assert re.search(message, err)
    assert board.sets == before


def test_motors_running_refuse_and_nothing_changes(board: FlightCtrl, ctl: Ctl) -> None:
    before = dict(board.sets)
    board.motors_running = True
    code, _, err = ctl("write", "gyro_p=7")
    assert (code, err.startswith("mkctl: write_refused")) == (EXIT_FAILURE, True)
    assert board.sets == before
