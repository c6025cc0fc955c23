"""Every command for the boards against a running daemon and a simulated aircraft, over real Zenoh and real codec."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path

import pytest

from lab.rigs.programs import mkdaemon
from lab.rigs.waiting import wait_blocking
from mkdaemon.cli.mkctl.app import app
from mkdaemon.cli.program import EXIT_CONFIG, EXIT_FAILURE, EXIT_OK, run
from mkdaemon.missions import write_mission
from mkdaemon.telemetry.mission import Mission, MissionPoint
from tests.bus.support import free_endpoint

pytestmark = [pytest.mark.flight, pytest.mark.real_time(tolerance=0.1)]
"""A request waits a few tenths of a second for its answer, and the program itself asks again."""

TAKE_OFF = 6.0
"""When the pilot takes off [s]. Behind a NaviCtrl the daemon must know the boards before; that takes two seconds."""

Ctl = Callable[..., tuple[int, str, str]]


@contextmanager
def aircraft(board: str, pilot: str = "nothing", wait: float = 0.0) -> Iterator[list[str]]:
    """A simulator and a daemon on it, its boards known; yields the options that reach them."""
    endpoint, line, vehicle = free_endpoint(), free_endpoint().removeprefix("tcp/"), f"live{board}{pilot}"
    at = ["--vehicle", vehicle, "--connect", endpoint]
    ends = ("--listen", line, "--connect", endpoint)
    with (
        mkdaemon("sim", "--board", board, "--pilot", pilot, "--pilot-wait", f"{wait}", *ends) as simulator,
        mkdaemon(
            "run", "--port", f"tcp:{line}", "--wait", "--listen", endpoint, "--vehicle", vehicle, "--log", "error"
        ) as daemon,
    ):

        def knows_its_boards() -> bool:
            for process in (simulator, daemon):
                assert process.poll() is None, process.communicate()[1]
            health = health_of(at)
            assert not health.get("motors_running"), "the pilot took off before the daemon knew its boards"
            return health.get("read_only", "unknown") is None

        wait_blocking(knows_its_boards)
        yield at


def health_of(at: list[str]) -> dict[str, object]:
    """What the daemon says about its aircraft; nothing while it is not there."""
    with redirect_stdout(io.StringIO()) as said, redirect_stderr(io.StringIO()):
        code = run(app, ["get", "health", *at, "--json"])
    return json.loads(said.getvalue()) if code == EXIT_OK else {}


@pytest.fixture(scope="module")
def navictrl() -> Iterator[list[str]]:
    with aircraft("nc") as at:
        yield at


@pytest.fixture(scope="module")
def flightctrl() -> Iterator[list[str]]:
    with aircraft("fc") as at:
        yield at


@pytest.fixture
def ctl(capsys: pytest.CaptureFixture[str]) -> Ctl:
    def call(at: list[str], *words: str) -> tuple[int, str, str]:
        capsys.readouterr()
        code = run(app, [*words, *at])
        out, err = capsys.readouterr()
        return code, out, err

    return call


def mission(count: int) -> Mission:
    points = (
        MissionPoint(latitude_deg=53.07 + n / 1e4, longitude_deg=8.79, altitude=10 + n, hold=n) for n in range(count)
    )
    return Mission(points=tuple(points))


def test_a_mission_goes_up_is_verified_comes_down_and_is_cleared(navictrl: list[str], ctl: Ctl, tmp_path: Path) -> None:
    file, back = tmp_path / "mission.csv", tmp_path / "back.gpx"
    write_mission(mission(31), file)
    code, out, err = ctl(navictrl, "waypoints", "upload", str(file), "--json")
    assert (code, err) == (EXIT_OK, "")
    up = json.loads(out)
    assert up["count"] == 31
    assert up["rounds"] >= 1  # more where a loaded machine lets an answer come late
    assert ctl(navictrl, "waypoints", "verify", str(file))[::2] == (EXIT_OK, "")
    code, out, _ = ctl(navictrl, "waypoints", "download", str(back), "--json")
    assert (code, json.loads(out)["digest"]) == (EXIT_OK, up["digest"])
    assert ctl(navictrl, "waypoints", "clear")[:2] == (EXIT_OK, "the list is empty\n")
    code, out, _ = ctl(navictrl, "waypoints", "verify", str(back))
    assert (code, out.splitlines()[0]) == (EXIT_FAILURE, "point 1 is absent")
    code, _, err = ctl(navictrl, "waypoints", "download", str(tmp_path / "none.gpx"))
    assert code == EXIT_FAILURE
    assert "holds no points" in err


def test_what_cannot_be_uploaded_is_one_line(navictrl: list[str], ctl: Ctl, tmp_path: Path) -> None:
    file = tmp_path / "long.csv"
    write_mission(mission(32), file)
    code, _, err = ctl(navictrl, "waypoints", "upload", str(file))
    assert (code, err.count("\n")) == (EXIT_FAILURE, 1)
    assert "the mission has 32 points and this board holds 31" in err
    file.write_text("latitude_deg,longitude_deg\n")
    code, _, err = ctl(navictrl, "waypoints", "upload", str(file))
    assert (code, err.count("\n")) == (EXIT_CONFIG, 1)
    assert f"{file}:1: column 'altitude' is missing" in err


def test_without_a_navictrl_an_upload_says_so(flightctrl: list[str], ctl: Ctl, tmp_path: Path) -> None:
    file = tmp_path / "mission.csv"
    write_mission(mission(2), file)
    for words in (("upload", str(file)), ("verify", str(file)), ("clear",), ("download", str(tmp_path / "b.csv"))):
        code, _, err = ctl(flightctrl, "waypoints", *words)
        assert (code, err.count("\n")) == (EXIT_FAILURE, 1)
        assert "board_unreachable: nc cannot be reached from here: the line ends at a FlightCtrl" in err


def test_a_conversion_names_what_is_lost(ctl: Ctl, tmp_path: Path) -> None:
    file, plan = tmp_path / "mission.csv", tmp_path / "mission.plan"
    file.write_text("lat,lon,altitude,climb\n53.1,8.1,10,1\n53.2,8.1,10,3\n")
    code, out, err = ctl([], "waypoints", "convert", str(file), str(plan))
    assert (code, out) == (EXIT_OK, f"2 points written to {plan}\n")
    assert err == f"mkctl: {plan}: this format does not keep climb of point 1\n"


def test_navictrl_parameters_labels_and_display(navictrl: list[str], ctl: Ctl) -> None:
    assert ctl(navictrl, "nc-param", "set", "target-speed", "25")[:2] == (EXIT_OK, "target_speed 25 0.1 m/s\n")
    assert ctl(navictrl, "nc-param", "get", "target_speed")[1] == "target_speed 25 0.1 m/s\n"
    assert ctl(navictrl, "nc-param", "set", "heading_setpoint", "-1")[::2] == (EXIT_OK, "")
    code, _, err = ctl(navictrl, "nc-param", "set", "target_speed", "99999")
    assert (code, "<= 32767" in err) == (EXIT_CONFIG, True)
    code, _, err = ctl(navictrl, "nc-param", "get", "speed")
    assert code == EXIT_CONFIG
    assert "use one of target_speed, heading_setpoint" in err
    first = ctl(navictrl, "labels", "nc")[1].splitlines()
    assert len(first) == 32
    assert ctl(navictrl, "labels", "nc")[1].splitlines() == first  # kept, not asked again
    lines = ctl(navictrl, "display", "nc", "--once")[1].splitlines()
    assert [len(line) for line in lines] == [20] * 4


def test_the_menu_is_that_of_the_board_that_is_there(navictrl: list[str], flightctrl: list[str], ctl: Ctl) -> None:
    assert ctl(navictrl, "display")[1].startswith("NaviCtrl ")
    assert ctl(flightctrl, "display")[1].startswith("FlightCtrl ")


def test_send_prints_the_typed_answer_and_refusals(navictrl: list[str], ctl: Ctl) -> None:
    assert ctl(navictrl, "send", "echo-request", "--pattern", "0x5AA5")[1].split() == ["pattern", "23205"]
    code, _, err = ctl(navictrl, "send", "echo-request", "--pattern", "70000")
    assert (code, err.strip()) == (EXIT_CONFIG, "mkctl: --pattern: '70000' does not fit; it takes: 0..65535.")
    code, out, _ = ctl(navictrl, "send", "waypoint-request", "--index", "9", "--json")
    assert json.loads(out)["reply"] == {"count": 0}
    code, _, err = ctl(navictrl, "send", "redirect", "--port", "fc")
    assert code == EXIT_FAILURE
    assert "not_confirmed" in err


def test_the_flightctrl_behind_a_navictrl_is_reached_and_telemetry_goes_on(
    navictrl: list[str], ctl: Ctl, tmp_path: Path
) -> None:
    """Each request passes the line through for itself, so that the motors stay watched."""
    code, out, err = ctl(navictrl, "settings", "backup", str(tmp_path / "backup"))
    assert (code, err) == (EXIT_OK, "")
    assert "set 3 is live, byte for byte as before" in out
    assert "1 = [64, 64, 0, 64]" in ctl(navictrl, "mixer", "get")[1]
    assert ctl(navictrl, "send", "version-request", "--board", "nc")[::2] == (EXIT_OK, "")
    assert json.loads(ctl(navictrl, "get", "state/flight", "--json")[1])["motors_running"] is False


def test_settings_are_backed_up_changed_and_restored(flightctrl: list[str], ctl: Ctl, tmp_path: Path) -> None:
    folder = tmp_path / "backup"
    code, out, err = ctl(flightctrl, "settings", "backup", str(folder))
    assert (code, err) == (EXIT_OK, "")
    assert "set 3 is live, byte for byte as before" in out
    assert sorted(path.name for path in folder.iterdir()) == [f"set{slot}.toml" for slot in range(1, 6)]
    assert ctl(flightctrl, "settings", "diff", str(folder)) == (EXIT_OK, "no difference\n", "")

    changes = ("gyro_p=85", "throttle_max=5")
    out = ctl(flightctrl, "settings", "edit", *changes, "--slot", "1", "--dry-run")[1]
    assert "set 1: would change gyro_p from 90 to 85" in out
    assert ctl(flightctrl, "settings", "diff", str(folder))[::2] == (EXIT_OK, "")
    out = ctl(flightctrl, "settings", "edit", *changes, "--slot", "1")[1]
    assert "the FC changed throttle_max from 5 to 100" in out
    assert ctl(flightctrl, "settings", "diff", str(folder))[0] == EXIT_FAILURE

    assert ctl(flightctrl, "settings", "restore", str(folder / "set1.toml"))[::2] == (EXIT_OK, "")
    assert ctl(flightctrl, "settings", "diff", str(folder))[::2] == (EXIT_OK, "")
    out = ctl(flightctrl, "settings", "list", "--json")[1]
    assert [row["slot"] for row in json.loads(out) if row["active"]] == [3]
    code, _, err = ctl(flightctrl, "settings", "backup", str(folder))
    assert code == EXIT_CONFIG
    assert "holds something already" in err


def test_a_set_of_another_revision_is_refused_before_writing(flightctrl: list[str], ctl: Ctl, tmp_path: Path) -> None:
    file = tmp_path / "set.toml"
    assert ctl(flightctrl, "settings", "backup", str(file))[::2] == (EXIT_OK, "")
    text = file.read_text()
    raw = next(line for line in text.splitlines() if line.startswith("raw"))
    head = text.partition("[values]")[0]
    file.write_text(head.replace("revision = 106", "revision = 103").replace(raw, f'raw = "67{"00" * 135}"'))
    code, _, err = ctl(flightctrl, "settings", "restore", str(file))
    assert code == EXIT_FAILURE
    assert "the file holds revision 103 and the FlightCtrl speaks revision 106" in err
    file.write_text(head.replace(raw, 'raw = "6a00"'))
    code, _, err = ctl(flightctrl, "settings", "restore", str(file))
    assert code == EXIT_CONFIG
    assert "parameter revision 106 has 144 bytes, these are 2" in err


def test_mixer_and_motor_controllers(flightctrl: list[str], ctl: Ctl, tmp_path: Path) -> None:
    file = tmp_path / "mixer.toml"
    assert ctl(flightctrl, "mixer", "get", str(file))[::2] == (EXIT_OK, "")
    file.write_text(file.read_text().replace("1 = [64, 64, 0, 64]", "1 = [60, 64, 0, 64]"))
    code, _, err = ctl(flightctrl, "mixer", "set", str(file))
    assert code == EXIT_CONFIG
    assert "--confirm" in err
    assert ctl(flightctrl, "mixer", "set", str(file), "--confirm")[::2] == (EXIT_OK, "")
    assert "1 = [60, 64, 0, 64]" in ctl(flightctrl, "mixer", "get")[1]

    assert "current_limit        30 A" in ctl(flightctrl, "bl", "get", "2")[1]
    code, out, _ = ctl(flightctrl, "bl", "set", "2", "--current-limit", "20", "--reverse", "--confirm", "--json")
    found = json.loads(out)
    assert (found["current_limit"], found["reverse"], found["pwm_scaling"]) == (20, True, 255)
    assert json.loads(ctl(flightctrl, "bl", "get", "2", "--json")[1])["current_limit"] == 20
    code, _, err = ctl(flightctrl, "bl", "set", "2", "--current-limit", "21")
    assert code == EXIT_CONFIG
    assert "repeat with --confirm" in err


def test_motors_turn_and_stop(flightctrl: list[str], ctl: Ctl) -> None:
    code, _, err = ctl(flightctrl, "motors", "test", "1")
    assert code == EXIT_CONFIG
    assert "take the propellers off" in err
    assert ctl(flightctrl, "motors", "test", "1", "2", "--seconds", "1", "--propellers-off")[:2] == (
        EXIT_OK,
        "motors stopped\n",
    )


def test_in_flight_an_upload_needs_its_flag(ctl: Ctl, tmp_path: Path) -> None:
    file = tmp_path / "mission.csv"
    write_mission(mission(3), file)
    with aircraft("nc", "hover", TAKE_OFF) as at:
        wait_blocking(lambda: json.loads(ctl(at, "get", "state/flight", "--json")[1] or "{}").get("motors_running"))
        code, _, err = ctl(at, "waypoints", "upload", str(file))
        assert code == EXIT_FAILURE
        assert "in_flight_needed: motors are running, and do/waypoints_upload takes effect at once" in err
        assert "--in-flight" in err
        assert ctl(at, "waypoints", "upload", str(file), "--in-flight")[::2] == (EXIT_OK, "")
        code, _, err = ctl(at, "settings", "list")
        assert code == EXIT_FAILURE
        assert "motors_running" in err
