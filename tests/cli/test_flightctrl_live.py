"""Every command for a FlightCtrl against a running daemon and a simulated aircraft, over real Zenoh and real codec."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from lab.rigs.background import background_daemon
from lab.rigs.live import VEHICLE
from mkdaemon.cli.program import EXIT_CONFIG, EXIT_FAILURE, EXIT_OK
from mkdaemon.missions import write_mission
from mkdaemon.telemetry.mission import Mission, MissionPoint
from tests.cli.conftest import Ctl

pytestmark = [pytest.mark.flight, pytest.mark.real_time(tolerance=0.1)]
"""A request waits a few tenths of a second for its answer, and the program itself asks again."""


@pytest.fixture(scope="module")
def at() -> Iterator[list[str]]:
    """The options that reach the daemon."""
    with background_daemon(board="fc") as daemon:
        yield ["--vehicle", VEHICLE, "--connect", daemon.endpoint]


def mission(count: int) -> Mission:
    points = (
        MissionPoint(latitude_deg=53.07 + n / 1e4, longitude_deg=8.79, altitude=10 + n, hold=n) for n in range(count)
    )
    return Mission(points=tuple(points))


def test_without_a_navictrl_an_upload_says_so(at: list[str], ctl: Ctl, tmp_path: Path) -> None:
    file = tmp_path / "mission.csv"
    write_mission(mission(2), file)
    for words in (("upload", str(file)), ("verify", str(file)), ("clear",), ("read", str(tmp_path / "b.csv"))):
        code, _, err = ctl(at, "waypoints", *words)
        assert (code, err.count("\n")) == (EXIT_FAILURE, 1)
        assert "board_unreachable: nc cannot be reached from here: the line ends at a FlightCtrl" in err


def test_settings_are_backed_up_changed_and_restored(at: list[str], ctl: Ctl, tmp_path: Path) -> None:
    folder = tmp_path / "backup"
    code, out, err = ctl(at, "settings", "backup", str(folder))
    assert (code, err) == (EXIT_OK, "")
    assert "set 3 is live, byte for byte as before" in out
    assert sorted(path.name for path in folder.iterdir()) == [f"set{slot}.toml" for slot in range(1, 6)]
    assert ctl(at, "settings", "compare", str(folder)) == (EXIT_OK, "no difference\n", "")

    changes = ("gyro_p=85", "throttle_max=5")
    out = ctl(at, "settings", "write", *changes, "--slot", "1", "--dry-run")[1]
    assert "set 1: would change gyro_p from 90 to 85" in out
    assert ctl(at, "settings", "compare", str(folder / "set1.toml"))[::2] == (EXIT_OK, "")
    out = ctl(at, "settings", "write", *changes, "--slot", "1")[1]
    assert "the FC changed throttle_max from 5 to 100" in out
    assert ctl(at, "settings", "compare", str(folder / "set1.toml"))[0] == EXIT_FAILURE

    assert ctl(at, "settings", "restore", str(folder / "set1.toml"))[::2] == (EXIT_OK, "")
    assert ctl(at, "settings", "compare", str(folder / "set1.toml"))[::2] == (EXIT_OK, "")
    out = ctl(at, "settings", "list", "--json")[1]
    assert [row["slot"] for row in json.loads(out) if row["active"]] == [3]
    code, _, err = ctl(at, "settings", "backup", str(folder))
    assert code == EXIT_CONFIG
    assert "already exists" in err


def test_a_set_of_another_revision_is_refused_before_writing(at: list[str], ctl: Ctl, tmp_path: Path) -> None:
    file = tmp_path / "set.toml"
    assert ctl(at, "settings", "backup", str(file))[::2] == (EXIT_OK, "")
    text = file.read_text()
    raw = next(line for line in text.splitlines() if line.startswith("raw"))
    head = text.partition("[values]")[0]
    file.write_text(head.replace("revision = 106", "revision = 103").replace(raw, f'raw = "67{"00" * 135}"'))
    code, _, err = ctl(at, "settings", "restore", str(file))
    assert code == EXIT_FAILURE
    assert "the file has revision 103, the FlightCtrl 106" in err
    file.write_text(head.replace(raw, 'raw = "6a00"'))
    code, _, err = ctl(at, "settings", "restore", str(file))
    assert code == EXIT_CONFIG
    assert "parameter revision 106 has 144 bytes, these are 2" in err


def test_mixer_and_motor_controllers(at: list[str], ctl: Ctl, tmp_path: Path) -> None:
    file = tmp_path / "mixer.toml"
    assert ctl(at, "board", "mixer", "read", str(file))[::2] == (EXIT_OK, "")
    file.write_text(file.read_text().replace("1 = [64, 64, 0, 64]", "1 = [60, 64, 0, 64]"))
    code, _, err = ctl(at, "board", "mixer", "write", str(file))
    assert code == EXIT_CONFIG
    assert "--confirm" in err
    assert ctl(at, "board", "mixer", "write", str(file), "--confirm")[::2] == (EXIT_OK, "")
    assert "1 = [60, 64, 0, 64]" in ctl(at, "board", "mixer", "read")[1]

    assert "current_limit        30 A" in ctl(at, "board", "motor-controllers", "read", "2")[1]
    code, out, _ = ctl(
        at, "board", "motor-controllers", "write", "2", "--current-limit", "20", "--reverse", "--confirm", "--json"
    )
    found = json.loads(out)
    assert (found["current_limit"], found["reverse"], found["pwm_scaling"]) == (20, True, 255)
    assert json.loads(ctl(at, "board", "motor-controllers", "read", "2", "--json")[1])["current_limit"] == 20
    code, _, err = ctl(at, "board", "motor-controllers", "write", "2", "--current-limit", "21")
    assert code == EXIT_CONFIG
    assert "repeat with --confirm" in err


def test_motors_turn_and_stop(at: list[str], ctl: Ctl) -> None:
    code, _, err = ctl(at, "board", "motors", "test", "1")
    assert code == EXIT_CONFIG
    assert "take the propellers off" in err
    assert ctl(at, "board", "motors", "test", "1", "2", "--seconds", "1", "--propellers-off")[:2] == (
        EXIT_OK,
        "motors stopped\n",
    )


def test_the_menu_is_that_of_the_board_that_is_there(at: list[str], ctl: Ctl) -> None:
    assert ctl(at, "board", "display")[1].startswith("FlightCtrl ")
