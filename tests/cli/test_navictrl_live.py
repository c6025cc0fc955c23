"""Every command for a NaviCtrl against a whole daemon and a simulated aircraft, in virtual time."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from lab.rigs.desk import desk
from mkdaemon.cli.program import EXIT_CONFIG, EXIT_FAILURE, EXIT_OK
from mkdaemon.missions import write_mission
from tests.cli.conftest import Ctl, mission


@pytest.fixture(scope="module")
def at(tmp_path_factory: pytest.TempPathFactory) -> Iterator[list[str]]:
    """Options of every command, while `mkctl` is at the desk of an aircraft."""
    with desk(tmp_path_factory.mktemp("aircraft"), board="nc"):
        yield []


def test_a_mission_goes_up_is_verified_comes_down_and_is_cleared(at: list[str], ctl: Ctl, tmp_path: Path) -> None:
    file, back = tmp_path / "mission.csv", tmp_path / "back.gpx"
    write_mission(mission(6), file)
    code, out, err = ctl(at, "waypoints", "upload", str(file), "--json")
    assert (code, err) == (EXIT_OK, "")
    up = json.loads(out)
    assert up["count"] == 6
    assert up["rounds"] >= 1  # more where a loaded machine lets an answer come late
    assert ctl(at, "waypoints", "verify", str(file))[::2] == (EXIT_OK, "")
    code, out, _ = ctl(at, "waypoints", "read", str(back), "--json")
    assert (code, json.loads(out)["digest"]) == (EXIT_OK, up["digest"])
    assert ctl(at, "waypoints", "clear")[:2] == (EXIT_OK, "the list is empty\n")
    code, out, _ = ctl(at, "waypoints", "verify", str(back))
    assert (code, out.splitlines()[0]) == (EXIT_FAILURE, "point 1 is absent")
    code, _, err = ctl(at, "waypoints", "read", str(tmp_path / "none.gpx"))
    assert code == EXIT_FAILURE
    assert "holds no points" in err


def test_a_conversion_names_what_is_lost(ctl: Ctl, tmp_path: Path) -> None:
    file, plan = tmp_path / "mission.csv", tmp_path / "mission.plan"
    file.write_text("lat,lon,altitude,event\n53.1,8.1,10,1\n53.2,8.1,10,3\n")
    code, out, err = ctl([], "waypoints", "convert", str(file), str(plan))
    assert (code, out) == (EXIT_OK, f"2 points written to {plan}\n")
    assert err == f"mkctl: {plan}: this format does not keep event of points 1 and 2\n"


def test_navictrl_parameters_labels_and_display(at: list[str], ctl: Ctl) -> None:
    assert ctl(at, "board", "parameters", "set", "target-speed", "25")[:2] == (EXIT_OK, "target_speed 25 0.1 m/s\n")
    assert ctl(at, "board", "parameters", "get", "target_speed")[1] == "target_speed 25 0.1 m/s\n"
    assert ctl(at, "board", "parameters", "set", "heading_setpoint", "-1")[::2] == (EXIT_OK, "")
    code, _, err = ctl(at, "board", "parameters", "set", "target_speed", "99999")
    assert (code, "<= 32767" in err) == (EXIT_CONFIG, True)
    code, _, err = ctl(at, "board", "parameters", "get", "speed")
    assert code == EXIT_CONFIG
    assert "target-speed" in err
    first = ctl(at, "board", "labels", "nc")[1].splitlines()
    assert len(first) == 32
    assert ctl(at, "board", "labels", "nc")[1].splitlines() == first  # kept, not asked again
    lines = ctl(at, "board", "display", "nc", "--once")[1].splitlines()
    assert [len(line) for line in lines] == [20] * 4


def test_send_prints_the_typed_answer_and_refusals(at: list[str], ctl: Ctl) -> None:
    assert ctl(at, "board", "send", "echo-request", "--pattern", "0x5AA5")[1].split() == ["pattern", "23205"]
    code, _, err = ctl(at, "board", "send", "echo-request", "--pattern", "70000")
    assert (code, err.strip()) == (EXIT_CONFIG, "mkctl: --pattern: '70000' does not fit; it takes: 0..65535.")
    code, out, _ = ctl(at, "board", "send", "waypoint-request", "--index", "9", "--json")
    assert json.loads(out)["reply"] == {"count": 0}
    code, _, err = ctl(at, "board", "send", "redirect", "--port", "fc")
    assert code == EXIT_FAILURE
    assert "not_confirmed" in err


def test_while_motors_run_an_upload_needs_its_flag(at: list[str], ctl: Ctl, tmp_path: Path) -> None:
    file = tmp_path / "mission.csv"
    write_mission(mission(3), file)
    ctl(at, "sim", "start")
    shown = ctl(at, "watch", "state/flight", "--seconds", "8", "--json")[1].splitlines()
    assert json.loads(shown[-1])["motors_running"] is True
    code, _, err = ctl(at, "waypoints", "upload", str(file))
    assert code == EXIT_FAILURE
    assert "in_flight_needed: motors are running, and do/waypoints_upload takes effect at once" in err
    assert "--in-flight" in err
    assert ctl(at, "waypoints", "upload", str(file), "--in-flight")[::2] == (EXIT_OK, "")
    code, _, err = ctl(at, "settings", "list")
    assert code == EXIT_FAILURE
    assert "motors_running" in err
