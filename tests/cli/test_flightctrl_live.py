"""Every command for a FlightCtrl against a whole daemon and a simulated aircraft, in virtual time."""

from __future__ import annotations

import json

import pytest

from lab.rigs.desk import desk
from mkdaemon.cli.program import EXIT_CONFIG, EXIT_FAILURE, EXIT_OK
from mkdaemon.missions import write_mission
from tests.cli.conftest import mission


@pytest.fixture(scope="module", autouse=True)
def aircraft(tmp_path_factory):
    """`mkctl` is at the desk of an aircraft."""
    with desk(tmp_path_factory.mktemp("aircraft"), board="fc"):
        yield


def test_without_a_navictrl_an_upload_says_so(ctl, tmp_path):
    file = tmp_path / "mission.csv"
    write_mission(mission(2), file)
    for words in (("upload", str(file)), ("verify", str(file)), ("clear",), ("read", str(tmp_path / "b.csv"))):
        code, _, err = ctl("waypoints", *words)
        assert (code, err.count("\n")) == (EXIT_FAILURE, 1)
        assert "board_unreachable: nc cannot be reached from here: the line ends at a FlightCtrl" in err


def test_settings_are_written_as_the_board_takes_them(ctl):
    changes = ("gyro_p=85", "throttle_max=5")
    out = ctl("settings", "write", *changes, "--slot", "1", "--dry-run")[1]
    assert "set 1: would change gyro_p from 90 to 85" in out
    out = ctl("settings", "write", *changes, "--slot", "1")[1]
    assert "the FC changed throttle_max from 5 to 100" in out
    out = ctl("settings", "list", "--json")[1]
    assert [row["slot"] for row in json.loads(out) if row["active"]] == [3]


def test_mixer_and_motor_controllers(ctl, tmp_path):
    file = tmp_path / "mixer.toml"
    assert ctl("board", "mixer", "read", str(file))[::2] == (EXIT_OK, "")
    file.write_text(file.read_text().replace("1 = [64, 64, 0, 64]", "1 = [60, 64, 0, 64]"))
    code, _, err = ctl("board", "mixer", "write", str(file))
    assert code == EXIT_CONFIG
    assert "--confirm" in err
    assert ctl("board", "mixer", "write", str(file), "--confirm")[::2] == (EXIT_OK, "")
    assert "1 = [60, 64, 0, 64]" in ctl("board", "mixer", "read")[1]

    assert "current_limit        30 A" in ctl("board", "motor-controllers", "read", "2")[1]
    code, out, _ = ctl(
        "board", "motor-controllers", "write", "2", "--current-limit", "20", "--reverse", "--confirm", "--json"
    )
    found = json.loads(out)
    assert (found["current_limit"], found["reverse"], found["pwm_scaling"]) == (20, True, 255)
    assert json.loads(ctl("board", "motor-controllers", "read", "2", "--json")[1])["current_limit"] == 20
    code, _, err = ctl("board", "motor-controllers", "write", "2", "--current-limit", "21")
    assert code == EXIT_CONFIG
    assert "repeat with --confirm" in err


def test_motors_turn_and_stop(ctl):
    code, _, err = ctl("board", "motors", "test", "1")
    assert code == EXIT_CONFIG
    assert "take the propellers off" in err
    assert ctl("board", "motors", "test", "1", "2", "--seconds", "1", "--propellers-off")[:2] == (
        EXIT_OK,
        "motors stopped\n",
    )
