"""The NaviCtrl's own modes, flown by the simulated NaviCtrl; client library, procedures and link in virtual time."""

from __future__ import annotations

import asyncio
from contextlib import asynccontextmanager

import msgpack
import pytest

from lab.rigs.linkrig import virtually
from mkdaemon.bus.codec import encode_map, encoding_of
from mkdaemon.client import Answer, Vehicle
from mkdaemon.client.navi import NAVI
from mkdaemon.client.samples import Sample
from mkdaemon.errors import CommandRejectedError, ManoeuvreError
from mkdaemon.frames import geodetic_from_enu
from mkdaemon.telemetry.mission import MissionPoint
from mkdaemon.telemetry.navi import ControlNavi, NaviStage
from mksim.config import FlightConfig, PilotPlan, SensorConfig, SimConfig, WindClass
from mksim.simulation import Simulation
from tests.daemon.procedures.procedure_rig import plug_in, procedure_rig

AIRBORNE = 13.0
"""A flight by hand to 2 m, the motors started on the way [s]."""


class RigVehicle(Vehicle):
    """The client library on a rig, without a bus between."""

    def __init__(self, rig):
        super().__init__(None, "rig", "none")
        self.rig, self.queue = rig, asyncio.Queue()
        rig.bus.follower = self._published

    def _published(self, suffix, value):
        if suffix == NAVI:
            self.queue.put_nowait(Sample(suffix, value.model_dump(mode="json"), encoding_of(ControlNavi)))

    async def command(self, root, name, fields=None, *, patience=0.0):
        asked = msgpack.unpackb(encode_map(fields))
        result = await self.rig.ask(name, **{key: value for key, value in asked.items() if key != "holder"})
        return Answer(result.status, result.reply or {}, result.token, result.reason, result.fix)

    @asynccontextmanager
    async def _watching(self):
        async def samples():
            while True:
                yield await self.queue.get()

        self.queue = asyncio.Queue()
        yield samples()

    def watch(self, *keys, **_):
        return self._watching()


class Flown:
    """A NaviCtrl in flight, its pilot, and a client.

    Attributes:
        stages: every stage that was reported, without repetitions.
    """

    def __init__(self, rig):
        self.rig, self.uav = rig, RigVehicle(rig)
        self.boards = rig.socket.aircraft
        self.stages = []

    @property
    def truth(self):
        return self.boards.world.truth

    @property
    def pilot(self):
        return self.boards.world.pilot

    async def newest(self, seconds):
        """The stage after some time."""
        await asyncio.sleep(seconds)
        return self.rig.bus.values(NAVI)[-1].stage

    def turn_switch(self, to):
        """The pilot's GPS switch."""
        self.boards.world.faults.start("gps_switch", to=to)

    def seen(self, report):
        """The operator tells the pilot what the program says."""
        if not self.stages or self.stages[-1] is not report.stage:
            self.stages.append(report.stage)
        if report.stage is NaviStage.READY:
            self.turn_switch("home")

    def place(self, east, north):
        """A mission point so far from the start."""
        origin = self.boards.world._config
        here = (origin.origin_latitude_deg, origin.origin_longitude_deg)
        latitude, longitude, _ = geodetic_from_enu(east, north, 0.0, (*(x * DEG for x in here), 0.0))
        return MissionPoint(latitude_deg=latitude / DEG, longitude_deg=longitude / DEG, altitude=2.0, radius=2, hold=1)


DEG = 0.017453292519943295


@asynccontextmanager
async def in_flight(tmp_path, nc="0.24", seconds=AIRBORNE):
    sensors = SensorConfig(gps_wander=0.0, gps_noise=0.1)
    flight = FlightConfig(wind=WindClass.INDOOR, sensors=sensors)
    config = SimConfig(board="nc", nc=nc, pilot_plan=PilotPlan.HOVER, pilot_wait=1.0, calibrated=True, flight=flight)
    async with procedure_rig(plug_in(lambda: Simulation(config)), tmp_path) as rig:
        rig.tasks.append(asyncio.create_task(rig.control.run()))
        await asyncio.sleep(seconds)
        yield Flown(rig)


@virtually
async def test_the_navictrl_flies_to_places_at_home_and_the_pilots_sticks_and_switch_rule(tmp_path):
    async with in_flight(tmp_path) as flown:
        assert not flown.truth.on_ground
        report = await flown.uav.navi.goto(5.0, -3.0, 2.0, radius=2, on_stage=flown.seen)
        assert flown.stages == [NaviStage.READY, NaviStage.ROUTE, NaviStage.AT_POINT]
        assert report.is_route_done
        assert report.target_distance <= 2.5
        assert "throttle holds the height" in report.hands
        told = flown.rig.bus.values("state/pilot")[-1]
        assert told.throttle_in_use == pytest.approx(flown.pilot.gas, abs=12.0), "the FlightCtrl flies with the pilot's"
        assert flown.truth.position_enu[2] > 1.0, "and the pilot's does"
        flown.turn_switch("hold")
        await asyncio.sleep(0.5)
        again = await flown.uav.navi.goto(0.0, -3.0, 2.0, radius=2, on_stage=flown.seen)
        assert again.is_route_done
        assert flown.truth.position_enu[:2] == pytest.approx([0.0, -3.0], abs=2.5)
        assert flown.stages[-2:] == [NaviStage.ROUTE, NaviStage.AT_POINT], "the place before says nothing of this one"
        flown.turn_switch("hold")
        await asyncio.sleep(0.5)
        with pytest.raises(ManoeuvreError, match=r"not there within 1 s: ready; the pilot turns the GPS switch to"):
            await flown.uav.navi.goto(50.0, 0.0, 2.0, patience=1.0)
        flown.turn_switch("home")
        await asyncio.sleep(0.5)
        with pytest.raises(CommandRejectedError) as refusal:
            await flown.uav.navi.goto(10.0, 0.0, 2.0)
        assert refusal.value.token == "switch_at_home"
        flown.pilot.program, flown.pilot.pitch = None, 20
        assert await flown.newest(0.5) is NaviStage.OVERRIDDEN
        flown.pilot.pitch = 0
        flown.turn_switch("hold")
        assert await flown.newest(0.5) is NaviStage.READY, "the list is paused"
        flown.boards.world.faults.start("gps_lost")
        assert await flown.newest(0.8) is NaviStage.NO_POSITION
        unfit = await flown.rig.ask("navi_goto", position=(1.0, 0.0, 2.0), confirm=True)
        assert (unfit.token, bool(unfit.fix)) == ("position_poor", True)
