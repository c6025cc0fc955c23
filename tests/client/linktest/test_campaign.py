"""A measurement of the line: refused while motors run, its loads asked for, and everything put back."""

from __future__ import annotations

import asyncio
import json
from contextlib import asynccontextmanager

import pytest

from mkdaemon.cli.mkctl.app import app
from mkdaemon.cli.program import run
from mkdaemon.client import connect
from mkdaemon.client.linktest.campaign import CHOSEN, LinkTestPlan, run_link_test
from mkdaemon.client.linktest.probefile import read_csv
from mkdaemon.client.linktest.probes import ProbeKind
from mkdaemon.errors import MkError
from mkdaemon.protocol.messages import Echo, EchoRequest
from mkdaemon.telemetry.link import LinkState
from mkdaemon.telemetry.vehicle import VehicleHealth
from tests.client.fake import CLOCK, VEHICLE, fake_daemon, in_background
from tests.client.linktest.test_probes import frame
from tests.values import made

BEFORE = {"osd": 0.05, "display": 1.0}
TRIP = 0.02


class Board:
    """A NaviCtrl behind a fake daemon: every fourth link test is lost, the others take `TRIP`."""

    def __init__(self, daemon):
        self.daemon = daemon
        self.motors_running = False
        daemon.intervals = dict(BEFORE)

    @property
    def intervals(self):
        return {name: every for name, every in self.daemon.intervals.items() if every}

    def say(self):
        state = made(LinkState, CLOCK.stamp(), baud=57600, hears_board=True, board_hears_us=True, boards=("nc", "fc"))
        health = made(VehicleHealth, CLOCK.stamp(), is_alive=True, motors_running=self.motors_running)
        self.daemon.bus.publish("link/state", state)
        self.daemon.bus.publish("health", health)

    async def live(self):
        """Put frames: their own stamps are a tenth of a second apart, however fast they are put."""
        number = 0
        while True:
            number += 1
            at = 100.0 + 0.1 * number
            self.daemon.bus.publish(
                "tx/nc/echo_request", frame(EchoRequest(pattern=number), at, "echo"), schema=EchoRequest
            )
            if number % 4:
                self.daemon.bus.publish("rx/nc/echo", frame(Echo(pattern=number), at + TRIP), schema=Echo)
            self.say()
            await asyncio.sleep(0.01)


@asynccontextmanager
async def measured():
    async with fake_daemon() as daemon:
        board = Board(daemon)
        board.say()
        living = asyncio.create_task(board.live())
        try:
            yield board
        finally:
            living.cancel()
            await asyncio.gather(living, return_exceptions=True)


@pytest.fixture(autouse=True)
def prompt(monkeypatch):
    monkeypatch.setattr("mkdaemon.client.linktest.campaign.SETTLING", 0.05)


async def test_loads_are_asked_for_measured_and_put_back():
    told = []
    async with measured() as board, connect(VEHICLE, board.daemon.endpoint) as uav:
        found = await run_link_test(uav, LinkTestPlan("fake", seconds=0.6), on_progress=told.append)
        asked = [fields for suffix, fields in board.daemon.asked if suffix == "do/rates" and fields.get("stream")]
        assert board.intervals == BEFORE
    assert [run.load for run in found.runs] == ["light", "full"]
    assert {"stream": "display", "interval": 0.0} in asked
    assert {"stream": "attitude", "interval": 0.05} in asked
    for run_ in found.runs:
        probes = run_.of(ProbeKind.ECHO)
        assert len(probes) > 8
        assert {round(probe.trip, 6) for probe in probes if probe.trip is not None} == {TRIP}
        assert sum(probe.trip is None for probe in probes) == pytest.approx(len(probes) / 4, abs=1)
    assert (told[0].load, told[-1].load, told[-1].of) == ("light", "full", 2)


async def test_motors_that_run_or_may_run_refuse_it_and_motors_that_start_end_it():
    async with measured() as board, connect(VEHICLE, board.daemon.endpoint) as uav:
        for running, words in ((True, "motors run"), (None, "no stream shows")):
            board.motors_running = running
            await uav.health.until(lambda value, running=running: value.motors_running is running, patience=5)
            with pytest.raises(MkError, match=words):
                await run_link_test(uav, LinkTestPlan("fake", seconds=0.1))
        assert board.intervals == BEFORE
        plan = LinkTestPlan("fake", (CHOSEN,), {"attitude": 0.1}, seconds=60.0, motors_off=True)

        def start(progress):
            assert board.intervals == {"attitude": 0.1, "osd": 0.5}  # OSD says whether motors run
            board.motors_running = True

        with pytest.raises(MkError, match="motors run: the measurement has ended"):
            await run_link_test(uav, plan, on_progress=start)
        assert board.intervals == BEFORE


async def test_whoever_has_seen_enough_gets_what_was_measured():
    stop = asyncio.Event()
    async with measured() as board, connect(VEHICLE, board.daemon.endpoint) as uav:

        def enough(progress):
            if progress.sent > 4:
                stop.set()

        found = await run_link_test(uav, LinkTestPlan("fake", seconds=60.0), on_progress=enough, stop=stop)
        assert board.intervals == BEFORE
    assert found.ended_by == "asked to"
    assert len(found.runs) == 1
    assert len(found.runs[0].probes) > 4


def test_the_command_prints_a_verdict_and_writes_what_it_found(tmp_path, capsys):
    csv, picture = tmp_path / "fake.csv", tmp_path / "fake.svg"
    with in_background(measured()) as board:
        endpoint = board.daemon.endpoint
        at = ["--vehicle", VEHICLE, "--connect", endpoint, "--seconds", "0.5", "--load", "light"]
        words = ["linktest", *at, "--csv", str(csv), "--picture", str(picture), "--label", "radio A"]
        assert run(app, words) == 1  # a quarter lost is poor
        out = capsys.readouterr().out
        assert "POOR: light load" in out
        assert "link test" in out
        (found,) = read_csv(csv)
        assert (found.label, found.load) == ("radio A", "light")
        assert "radio A, light load" in picture.read_text()
        words = ["linktest", *at, "--json", "--compare", str(csv), "--picture", str(picture)]
        assert run(app, words) == 2  # the picture is there already
        assert "already exists" in capsys.readouterr().err
        assert run(app, [*words, "--force"]) == 1
        answer = json.loads(capsys.readouterr().out)
        assert answer["verdict"]["grade"] == "poor"
        assert answer["runs"][0]["echo"]["p50_ms"] == pytest.approx(1000 * TRIP)
        assert picture.read_text().count("light load") >= 2
        assert run(app, ["linktest", *at, "--stream", "osd"]) == 2
        assert "write a stream and its interval" in capsys.readouterr().err
