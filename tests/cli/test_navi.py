"""`mkctl waypoints fly`, `home`, `status`, and `goto --frame home`, against a daemon without boards."""

from __future__ import annotations

from contextlib import asynccontextmanager

import pytest

from mkdaemon.cli.mkctl import manoeuvres, navi
from mkdaemon.cli.mkctl.connection import Connection
from mkdaemon.errors import ManoeuvreError
from mkdaemon.telemetry.navi import ControlNavi, NaviStage
from mkdaemon.telemetry.refusals import Token, refuse
from tests.client.fake import CLOCK, VEHICLE, fake_daemon
from tests.values import made

STORED = {"count": 1, "digest": "00", "rounds": 1, "writes": 1}
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
            return STORED | fields

        def start():
            answer()
            if is_active:
                raise refuse(Token.ROUTE_ACTIVE, index=1, count=1)
            return {"count": 1, "switch": "x"}

        daemon.replies |= {
            "do/navi_goto": lambda: answer(switch="x"),
            "do/waypoints_upload": lambda: STORED,
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
