"""`mkctl` manoeuvres, and routes that the NaviCtrl flies, against a daemon without boards."""

from __future__ import annotations

import io
import math
import sys
from contextlib import asynccontextmanager
from functools import partial
from types import SimpleNamespace

import pytest

from lab.rigs.waiting import wait_until
from mkdaemon.bus.session import session_config
from mkdaemon.cli.mkctl import flightshow, manoeuvres, motors, navi, preflight, script
from mkdaemon.cli.mkctl.app import app
from mkdaemon.cli.mkctl.connection import Connection
from mkdaemon.cli.program import EXIT_FAILURE, run
from mkdaemon.errors import CommandRejectedError, ManoeuvreError, MkError
from mkdaemon.telemetry.control import ControlEstimate, Outcome, Phase
from mkdaemon.telemetry.navi import ControlNavi, NaviStage
from mkdaemon.telemetry.refusals import Token, refuse
from tests.client.fake import CLOCK, VEHICLE, fake_daemon
from tests.values import made

NOWHERE = ["--connect", "tcp/127.0.0.1:1"]


@pytest.mark.parametrize(
    "arguments",
    [
        ["goto", "-1", "-0.5", "2", "--yaw", "-90"],
        ["goto", "1", "-.5", "2e0", "--seconds", "3"],
        ["velocity", "-0.2", "0", "-0.1", "--frame", "body"],
        ["hold", "--height", "1.5"],
        ["land", "--yaw", "-10"],
        ["goto", "-1", "0", "0", "--frame", "body"],
        ["attitude", "--pitch", "-3"],
        ["take-off", "2"],
        ["abort"],
        ["board", "motors", "stop"],
    ],
)
def test_negative_numbers_are_arguments(arguments, capsys, monkeypatch):
    monkeypatch.setattr("mkdaemon.client.connection.session_config", partial(session_config, patience=0.1))
    assert run(app, [*arguments, *NOWHERE]) == EXIT_FAILURE
    assert "tcp/127.0.0.1:1" in capsys.readouterr().err, "it got as far as looking for a daemon"


def publish_estimate(daemon, position, image_age=0.05):
    value = made(ControlEstimate, CLOCK.stamp(), target="pad", position=position, image_age=image_age)
    daemon.bus.publish("control/estimate", value)


@asynccontextmanager
async def flying(place, image_age=0.05, **more):
    """A daemon that publishes an estimate with every setpoint, as the flight core does, and where it listens."""
    async with fake_daemon(**more) as daemon:
        daemon.follow = lambda: publish_estimate(daemon, place, image_age)
        yield daemon, Connection(vehicle=VEHICLE, connect=daemon.endpoint)


@pytest.mark.parametrize(("place", "code"), [((-1.0, 0.0, 1.9), 0), ((0.0, 0.0, 2.0), 1)])
async def test_goto_reports_the_error_at_the_end(place, code, capsys, monkeypatch):
    monkeypatch.setattr(flightshow, "LOG_PERIOD", 0.1)
    async with flying(place) as (daemon, here):
        assert await manoeuvres.goto(-1.0, 0.0, 2.0, yaw=180.0, seconds=0.5, connection=here) == code
        await wait_until(lambda: daemon.holder is None)
        assert daemon.setpoints[-1]["yaw"] == pytest.approx(math.pi)
    shown = capsys.readouterr()
    assert "cm from the goal" in shown.out
    assert "cm from the goal" in shown.err


async def test_a_place_that_no_image_has_shown_for_long_is_not_shown(capsys):
    async with flying((5.0, 287.0, -60.0), image_age=2.0) as (_, here):
        assert await manoeuvres.goto(0.0, 0.0, 2.0, seconds=0.3, connection=here) == 1
    shown = capsys.readouterr()
    assert shown.out == "no image showed where it ended\n"
    assert "287" not in shown.err


FINDINGS = [
    {"name": "gate", "state": "passed", "blocks": "lease", "token": None, "reason": "a switch", "fix": ""},
    {"name": "battery", "state": "stands", "blocks": "autonomy", "token": "x", "reason": "11 V.", "fix": "Charge it."},
]


async def test_checks_before_a_flight_are_shown_with_what_to_do(capsys):
    async with fake_daemon() as daemon:
        here = Connection(vehicle=VEHICLE, connect=daemon.endpoint)
        assert await preflight.preflight(connection=here) == 0
        assert capsys.readouterr().out.endswith("nothing prevents an autonomous flight\n")
        daemon.preflight = {"is_ready": True, "findings": [FINDINGS[0] | {"state": "unknown"}]}
        assert await preflight.preflight(connection=here) == 0
        assert "unknown from here, look yourself: 1" in capsys.readouterr().out
        daemon.preflight = {"is_ready": False, "findings": FINDINGS}
        assert await preflight.preflight(connection=here) == EXIT_FAILURE
        shown = capsys.readouterr().out
        assert "NO AUTONOMY" in shown
        assert "Charge it." in shown
        assert shown.index("battery") < shown.index("gate"), "what stands in the way comes first"
        await preflight.preflight(connection=Connection(vehicle=VEHICLE, connect=daemon.endpoint, json=True))
        assert '"is_ready": false' in capsys.readouterr().out


async def test_gains_are_shown_with_their_margins(capsys):
    async with fake_daemon() as daemon:
        await preflight.preflight(gains=True, connection=Connection(vehicle=VEHICLE, connect=daemon.endpoint))
        shown = capsys.readouterr().out
        assert "stable with a stick gain" in shown
        assert "0.67 to 1.33, or more" in shown
        assert shown.endswith("safe: the loop bears all that it has to bear\n")
        await preflight.preflight(
            gains=True, connection=Connection(vehicle=VEHICLE, connect=daemon.endpoint, json=True)
        )
        assert '"gain_margin"' in capsys.readouterr().out


async def test_motors_that_may_carry_an_aircraft_are_not_stopped():
    async with flying((0.0, 0.0, 2.0)) as (_, here):
        with pytest.raises(CommandRejectedError) as refusal:
            await motors.stop(connection=here)
    assert refusal.value.token == Token.FLYING_STOP


def release_by_itself(daemon):
    if len(daemon.setpoints) == 20:
        daemon.holder = None
        daemon.say(Phase.RELEASING, "no image of pad for 3.0 s", hands="flies: throttle back to hover at once")


@pytest.mark.parametrize("verb", ["velocity", "attitude", "stick"])
async def test_what_the_pilot_does_when_the_machine_lets_go_is_the_last_word(verb, capsys):
    async with flying((0.0, 0.0, 2.0)) as (daemon, here):
        daemon.follow = lambda: release_by_itself(daemon)
        verbs = {
            "velocity": lambda: manoeuvres.velocity(0.0, 0.0, 0.0, seconds=3.0, connection=here),
            "attitude": lambda: manoeuvres.attitude(seconds=3.0, connection=here),
            "stick": lambda: manoeuvres.stick(throttle=0.0, seconds=3.0, connection=here),
        }
        with pytest.raises(MkError, match="no image of pad"):
            await verbs[verb]()
    assert capsys.readouterr().err.splitlines()[-1] == "the pilot flies: throttle back to hover at once"


async def test_what_the_daemon_waits_for_is_shown(capsys, monkeypatch):
    monkeypatch.setattr(flightshow, "LOG_PERIOD", 0.05)
    async with flying((0.0, 0.0, 2.0), engages=20) as (daemon, here):
        await manoeuvres.velocity(0.0, 0.0, 0.0, seconds=0.1, connection=here)
        assert daemon.setpoints[-1]["velocity"] == [0.0, 0.0, 0.0]
    assert "waiting for a live, neutral stream" in capsys.readouterr().err


@pytest.mark.parametrize(("image_age", "words"), [(0.1, "100 cm from the goal"), (0.9, "no image for 0.9 s")])
def test_there_is_no_error_to_a_goal_without_images(image_age, words):
    lease = SimpleNamespace(is_engaged=True, reason="", status=SimpleNamespace(phase=Phase.FLYING, stage=""))
    shown = flightshow.Shown()
    shown.position, shown.image_age = (0.0, 0.0, 2.0), image_age
    assert flightshow._line(lease, shown, (0.0, 0.0, 1.0)) == f"at x +0.00 y +0.00 z 2.00 m, {words}"


SCRIPT = """
[[step]]
do = "wait"
key = "control/status"
field = "refused"
below = 1

[[step]]
do = "hold"
seconds = 0.2

[[step]]
do = "wait"
key = "control/status"
field = "refused"
below = 1

[[step]]
do = "velocity"
velocity = [0.1, 0, 0]
seconds = 0.2

[[step]]
do = "land"
"""


def end_after(daemon, count):
    if len(daemon.setpoints) == count:
        daemon.lose("landed on pad", outcome=Outcome.LANDED)


PATHS = """
[[step]]
do = "path"
target = "pad"

[[step.points]]
position = [0, 0, 2]

[[step.points]]
position = [1, 0, 2]
time = 4
yaw_deg = 0

[[step]]
do = "land"
"""
STORED = {"id": "p1", "pieces": 1, "duration": 4.0, "length": 1.0, "speed": 0.47, "acceleration": 0.36, "climb": 0.0}


async def test_the_paths_of_a_script_are_uploaded_before_anything_flies(tmp_path, capsys):
    path = tmp_path / "flight.toml"
    path.write_text(PATHS.replace("yaw_deg = 0\n", ""))
    async with flying((0.0, 0.0, 2.0)) as (daemon, here):
        before = []

        def follow():
            if "path" in daemon.setpoints[-1]:
                daemon.say(Phase.FLYING, "flies", manoeuvre="path", is_done=True)
            else:
                daemon.lose("landed on pad", outcome=Outcome.LANDED)

        def store():
            before.append(len(daemon.setpoints))
            return STORED

        daemon.follow, daemon.replies = follow, {"do/path_upload": store}
        await script.fly(path, connection=here)
        uploads = [fields for suffix, fields in daemon.asked if suffix == "do/path_upload"]
        first, second = uploads[0]["points"]
        assert before == [0] and len(uploads) == 1
        assert (first["position"], second["position"], second["time"]) == ([0.0, 0.0, 2.0], [1.0, 0.0, 2.0], 4.0)
        flown = [setpoint for setpoint in daemon.setpoints if "path" in setpoint]
        assert {(each["path"], each["target"], each["paused"]) for each in flown} == {("p1", "pad", False)}
    assert "step 1 of 2: path: 1.0 m in 4.0 s, up to 0.47 m/s and 0.36 m/s2" in capsys.readouterr().out


class OneTerminal(io.StringIO):
    """A terminal that shows standard output and standard error."""

    def isatty(self):
        return True


async def test_a_script_is_flown_step_by_step_and_steps_share_no_line_with_the_progress(tmp_path, monkeypatch):
    monkeypatch.setattr(flightshow, "PROGRESS_PERIOD", 0.02)
    path, screen = tmp_path / "flight.toml", OneTerminal()
    path.write_text(SCRIPT)
    async with flying((0.0, 0.0, 2.0)) as (daemon, here):
        daemon.follow = lambda: end_after(daemon, 60)
        monkeypatch.setattr(sys, "stdout", screen)
        monkeypatch.setattr(sys, "stderr", screen)
        await script.fly(path, connection=here)
        monkeypatch.undo()
        assert any("velocity" in setpoint for setpoint in daemon.setpoints)
    shown = [line.rpartition(flightshow.CLEAR)[2] for line in screen.getvalue().split("\n")]
    assert [line for line in shown if "step" in line] == [
        f"step {number} of 5: {what}" for number, what in enumerate(("wait", "hold", "wait", "velocity", "land"), 1)
    ]
    assert any("done" in line for line in shown)


async def test_a_condition_that_is_not_met_ends_the_flight(tmp_path, monkeypatch):
    monkeypatch.setattr(script, "LOOK", 0.1)
    path = tmp_path / "flight.toml"
    path.write_text('[[step]]\ndo = "wait"\nkey = "control/status"\nfield = "refused"\nabove = 9\npatience = 0.2\n')
    async with flying((0.0, 0.0, 2.0)) as (daemon, here):
        with pytest.raises(ManoeuvreError, match="control/status refused was not as wanted"):
            await script.fly(path, connection=here)
        await wait_until(lambda: daemon.holder is None)


UPLOADED = {"count": 1, "digest": "00", "rounds": 1, "writes": 1}
POINTS = "latitude_deg,longitude_deg,altitude\n53.0,8.0,10\n53.0001,8.0,10\n"


def report(stage, **fields):
    known = {"waypoint": 1, "waypoints": 1, "target_distance": 12.0, "home_distance": 20.0}
    return made(ControlNavi, CLOCK.stamp(), stage=stage, hands=f"does what {stage.value} needs", **known | fields)


@asynccontextmanager
async def navictrl(*reports, is_active=False):
    """A daemon that answers the verbs of the NaviCtrl, and then reports these."""
    async with fake_daemon() as daemon:

        def answer(**fields):
            for one in reports:
                daemon.bus.publish("control/navi", one)
            return UPLOADED | fields

        def start():
            answer()
            if is_active:
                raise refuse(Token.ROUTE_ACTIVE, index=1, count=1)
            return {"count": 1, "switch": "x"}

        daemon.replies |= {
            "do/navi_goto": lambda: answer(switch="x"),
            "do/waypoints_upload": lambda: UPLOADED,
            "do/route_start": start,
            "do/route_end": answer,
        }
        yield daemon, Connection(vehicle=VEHICLE, connect=daemon.endpoint)


READY, ROUTE = report(NaviStage.READY), report(NaviStage.ROUTE)
REACHED = report(NaviStage.AT_POINT, target_distance=1.0, is_route_done=True)


async def test_goto_at_home_asks_the_navictrl_and_shows_what_the_pilot_does(capsys):
    async with navictrl(READY, ROUTE, ROUTE, REACHED) as (daemon, here):
        assert await manoeuvres.goto(10.0, -4.0, 3.0, yaw=0.0, frame="home", confirm=True, connection=here) == 0
        wanted = next(fields for suffix, fields in daemon.asked if suffix == "do/navi_goto")
    assert tuple(wanted["position"]) == (10.0, -4.0, 3.0)
    assert (wanted["heading_deg"], wanted["hold"], wanted["confirm"]) == (90, 255, True)
    shown = capsys.readouterr()
    assert shown.err.splitlines()[:2] == [
        "ready, waypoint 1 of 1, 12 m to go, 20 m from home: the pilot does what ready needs",
        "route, waypoint 1 of 1, 12 m to go, 20 m from home: the pilot does what route needs",
    ]
    assert shown.out == "reached; the pilot does what at_point needs\n"


async def test_a_route_is_uploaded_made_ready_and_followed(capsys, tmp_path):
    (tmp_path / "field.csv").write_text(POINTS)
    async with navictrl(READY, is_active=True) as (daemon, here):
        with pytest.raises(ManoeuvreError, match=r"not there within 0.3 s: ready; the pilot does what ready needs"):
            await navi.fly(tmp_path / "field.csv", confirm=True, patience=0.3, connection=here)
        verbs = [suffix for suffix, _ in daemon.asked]
    assert verbs[-2:] == ["do/waypoints_upload", "do/route_start"], "a list that is active already needs no start"
    async with navictrl(READY, REACHED) as (_, here):
        await navi.fly(confirm=True, connection=here)
    assert "the last of 1 points is reached" in capsys.readouterr().out


async def test_the_way_home_is_followed_and_an_aircraft_that_lands_first_ends_it(capsys):
    home = {"waypoint": 0, "waypoints": 0}
    async with navictrl(report(NaviStage.HOME, **home), report(NaviStage.HOME, is_home=True, **home)) as (_, here):
        await navi.home(confirm=True, connection=here)
        await navi.status(connection=here)
    assert "home; the pilot does" in capsys.readouterr().out
    async with navictrl(report(NaviStage.GROUND)) as (_, here):
        with pytest.raises(ManoeuvreError, match="stands on the ground"):
            await navi.home(confirm=True, connection=here)


async def test_a_list_that_is_gone_on_the_way_ends_the_waiting():
    async with navictrl(ROUTE, report(NaviStage.HOME, waypoint=0, waypoints=0)) as (_, here):
        with pytest.raises(ManoeuvreError, match="list is gone"):
            await manoeuvres.goto(1.0, 0.0, 2.0, frame="home", confirm=True, connection=here)


async def test_a_script_is_checked_without_a_daemon(tmp_path, capsys):
    path = tmp_path / "flight.toml"
    path.write_text(SCRIPT)
    await script.fly(path, check=True)
    assert "5 steps, nothing wrong" in capsys.readouterr().out
