"""The daemon's clients, as a user types them, against a whole daemon; and a release where the bus does not answer."""

from __future__ import annotations

import asyncio
import json
import re

import pytest

from lab.rigs.desk import desk
from mkdaemon.bus.localsocket import socket_folders, socket_name
from mkdaemon.cli.mkctl import release
from mkdaemon.cli.mkctl.connection import Connection
from mkdaemon.cli.mkctl.streams import read_interval
from mkdaemon.cli.program import EXIT_CONFIG, EXIT_FAILURE, EXIT_OK
from mkdaemon.daemon.localsocket import LocalSocket
from mkdaemon.errors import CommandRejectedError, ConfigError, MkError
from mkdaemon.missions import write_mission
from mkdaemon.telemetry.command import CommandResult
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.status import Status
from tests.cli.conftest import mission


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """The desk of an aircraft behind a NaviCtrl, in virtual time."""
    with desk(tmp_path_factory.mktemp("aircraft"), board="nc", fc="2.12a") as made:
        yield made


@pytest.fixture
def mkctl(ctl, monkeypatch):
    """Run `mkctl`: exit code, output, errors."""
    monkeypatch.setenv("COLUMNS", "200")
    return ctl


def test_a_first_look_around(flown, mkctl):
    code, out, _ = mkctl("status")
    assert code == 0
    for words in ("alive", "motors off", "nc 0.24", "free", "battery", "satellites"):
        assert words in out
    assert "up: " in out
    code, out, _ = mkctl("status", "--json")
    assert '"is_alive": true' in out
    code, out, _ = mkctl("get", "rx/nc/osd", "state/battery")
    assert code == 0
    assert "rx/nc/osd" in out
    assert re.search(r"voltage +[\d.]+ V", out)
    assert "s ago" in out
    code, out, _ = mkctl("get", "state/*", "--json")
    assert {json.loads(line)["key"] for line in out.splitlines()} >= {"state/battery", "state/attitude"}
    code, out, _ = mkctl("watch", "state/attitude", "--count", "3", "--json")
    assert [json.loads(line)["key"] for line in out.splitlines()] == ["state/attitude"] * 3
    code, out, _ = mkctl("health")
    assert "link test" in out
    code, out, err = mkctl("board", "rates", "osd", "250ms")
    assert (code, "osd             250 ms" in out) == (0, True), out + err
    code, _, err = mkctl("board", "rates", "osd", "10ms")
    assert code == 1
    assert "line_budget" in err
    assert "% of the line" in err


def test_mistakes_are_one_line(flown, mkctl):
    for arguments, words in (
        (("get", "state/nothing"), "no value for state/nothing"),
        (("get", "a//b"), "'a//b' is not a key: empty chunks are forbidden"),
        (("get", "--vehicle", "other"), "there is mk1: use --vehicle"),
        (("watch", ""), "'' is not a key"),
        (
            ("watch", "state/atitude"),
            "no key matches 'state/atitude'; did you mean state/attitude or state/altitude?",
        ),
        (("status", "--vehicle", "other"), "there is mk1: use --vehicle"),
        (("board", "rates", "osd"), "which interval"),
        (("board", "rates", "osd", "soon"), "'soon' is not an interval"),
        (("board", "rates", "sod", "100ms"), "no stream"),
    ):
        code, _, err = mkctl(*arguments)
        assert code in {1, 2}
        assert words in err
        assert len(err.strip().splitlines()) == 1


def test_what_is_not_there_is_said_beside_what_is(flown, mkctl):
    code, out, err = mkctl("get", "state/battery", "state/positon")
    hint = "did you mean state/position?"
    assert (code, err) == (0, f"mkctl: no value for state/positon of vehicle mk1 (yet); {hint}\n")
    assert re.match(r"state/battery  [\d.]+ s ago\n  voltage +[\d.]+ V\n", out)
    code, out, _ = mkctl("get", "mk/mk1/state/battery")  # a whole key, as another program shows it
    assert (code, out.startswith("state/battery")) == (0, True)
    code, out, _ = mkctl("get", "**", "--json")
    keys = {json.loads(line)["key"] for line in out.splitlines()}
    assert {"link/state", "rx/nc/osd", "state/battery"} <= keys
    assert not any(key.startswith("schema/") for key in keys)
    code, out, _ = mkctl("get", "schema/Battery.v1", "--json")
    assert json.loads(out)["properties"]["voltage"]["type"] == "number"
    code, out, err = mkctl("watch", "--vehicle", "other", "--seconds", "0.1")
    assert (code, out) == (0, "")
    assert err.endswith("there is mk1: use --vehicle; waiting for it\n")


def test_intervals_in_the_units_people_write():
    found = [read_interval(text) for text in ("100ms", "100", "0.1s", "10Hz", "off", "0")]
    assert found == pytest.approx([0.1, 0.1, 0.1, 0.1, 0.0, 0.0])
    for wrong in ("", "fast", "-5ms", "1 m"):
        with pytest.raises(ConfigError, match="not an interval"):
            read_interval(wrong)


HERE = Connection(vehicle="alone", connect="tcp/127.0.0.1:7999")
DONE = {"status": "confirmed", "sent": 5, "confirmed": 5, "reason": "enough"}


@pytest.fixture
async def asked():
    """What the daemon's socket was asked."""
    asked = []

    async def answer(suffix, payload):
        asked.append(suffix)
        return CommandResult(status=Status.ACCEPTED, reply=DONE)

    async with LocalSocket(answer).serve(socket_folders()[0] / socket_name(HERE.vehicle, HERE.connect)):
        yield asked


def bus_that(monkeypatch, outcome):
    """A bus that never answers (None), fails or answers."""

    async def over_bus(connection, reason):
        if outcome is None:
            await asyncio.Event().wait()
        if isinstance(outcome, Exception):
            raise outcome
        return outcome

    monkeypatch.setattr(release, "_release_over_bus", over_bus)


@pytest.mark.parametrize(
    "outcome", [None, MkError("nobody answers"), refuse(Token.BUSY, detail="too many queries wait for an answer")]
)
async def test_a_bus_that_does_not_answer_leaves_the_socket(monkeypatch, asked, capsys, outcome):
    monkeypatch.setattr(release, "BUS_TIME", 0.05)
    bus_that(monkeypatch, outcome)
    assert await release.release(connection=HERE) == 0
    assert asked == ["do/release"]
    assert "FlightCtrl confirmed it" in capsys.readouterr().out


async def test_a_refusal_of_the_bus_counts(monkeypatch, asked):
    bus_that(monkeypatch, CommandRejectedError("timeout", "no end in 5 s.", "Look."))
    with pytest.raises(CommandRejectedError):
        await release.release(connection=HERE)
    assert asked == []


def test_a_mission_goes_up_is_verified_comes_down_and_is_cleared(flown, mkctl, tmp_path):
    file, back = tmp_path / "mission.csv", tmp_path / "back.gpx"
    write_mission(mission(6), file)
    code, out, err = mkctl("waypoints", "upload", str(file), "--json")
    assert (code, err) == (EXIT_OK, "")
    up = json.loads(out)
    assert up["count"] == 6
    assert up["rounds"] >= 1  # more where a loaded machine lets an answer come late
    assert mkctl("waypoints", "verify", str(file))[::2] == (EXIT_OK, "")
    code, out, _ = mkctl("waypoints", "read", str(back), "--json")
    assert (code, json.loads(out)["digest"]) == (EXIT_OK, up["digest"])
    assert mkctl("waypoints", "clear")[:2] == (EXIT_OK, "the list is empty\n")
    code, out, _ = mkctl("waypoints", "verify", str(back))
    assert (code, out.splitlines()[0]) == (EXIT_FAILURE, "point 1 is absent")
    code, _, err = mkctl("waypoints", "read", str(tmp_path / "none.gpx"))
    assert code == EXIT_FAILURE
    assert "holds no points" in err


def test_a_conversion_names_what_is_lost(mkctl, tmp_path):
    file, plan = tmp_path / "mission.csv", tmp_path / "mission.plan"
    file.write_text("lat,lon,altitude,event\n53.1,8.1,10,1\n53.2,8.1,10,3\n")
    code, out, err = mkctl("waypoints", "convert", str(file), str(plan))
    assert (code, out) == (EXIT_OK, f"2 points written to {plan}\n")
    assert err == f"mkctl: {plan}: this format does not keep event of points 1 and 2\n"


def test_navictrl_parameters_labels_and_display(flown, mkctl):
    assert mkctl("board", "parameters", "set", "target-speed", "25")[:2] == (EXIT_OK, "target_speed 25 0.1 m/s\n")
    assert mkctl("board", "parameters", "get", "target_speed")[1] == "target_speed 25 0.1 m/s\n"
    assert mkctl("board", "parameters", "set", "heading_setpoint", "-1")[::2] == (EXIT_OK, "")
    code, _, err = mkctl("board", "parameters", "set", "target_speed", "99999")
    assert (code, "<= 32767" in err) == (EXIT_CONFIG, True)
    code, _, err = mkctl("board", "parameters", "get", "speed")
    assert code == EXIT_CONFIG
    assert "target-speed" in err
    first = mkctl("board", "labels", "nc")[1].splitlines()
    assert len(first) == 32
    assert mkctl("board", "labels", "nc")[1].splitlines() == first  # kept, not asked again
    lines = mkctl("board", "display", "nc", "--once")[1].splitlines()
    assert [len(line) for line in lines] == [20] * 4


def test_send_prints_the_typed_answer_and_refusals(flown, mkctl):
    assert mkctl("board", "send", "echo-request", "--pattern", "0x5AA5")[1].split() == ["pattern", "23205"]
    code, _, err = mkctl("board", "send", "echo-request", "--pattern", "70000")
    assert (code, err.strip()) == (EXIT_CONFIG, "mkctl: --pattern: '70000' does not fit; it takes: 0..65535.")
    code, out, _ = mkctl("board", "send", "waypoint-request", "--index", "9", "--json")
    assert json.loads(out)["reply"] == {"count": 0}
    code, _, err = mkctl("board", "send", "redirect", "--port", "fc")
    assert code == EXIT_FAILURE
    assert "not_confirmed" in err


def test_flying_by_hand_from_the_command_line(flown, mkctl):
    code, out, _ = mkctl("lease", "show")
    assert (code, out.strip()) == (0, "no client holds the lease")
    code, out, _ = mkctl("lease", "take", "--holder", "tester", "--json")
    assert (code, json.loads(out)["holder"]) == (0, "tester")
    code, _, err = mkctl("lease", "take", "--holder", "other")
    assert (code, err.startswith("mkctl: lease_held: tester holds the lease")) == (1, True)
    assert "--force" in err
    assert mkctl("release")[0] == 0
    fly = ("stick", "--throttle", "5", "--pitch", "-12", "--seconds", "0.5", "--json")
    code, out, err = mkctl(*fly)
    assert '"pitch": -12' in out, err
    code, out, _ = mkctl("release")
    assert code == 0
    assert out == "released; a confirmation cannot come this way (NaviCtrl between us and the FlightCtrl)\n"
