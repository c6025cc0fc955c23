"""Sources of poses in the daemon: from the key to the flight core, their state, and a flight by them."""

from __future__ import annotations

import asyncio
import math
from dataclasses import dataclass

import pytest

from lab.rigs.linkrig import virtually
from mkdaemon.bus.codec import TooLate, encode
from mkdaemon.config.control import ControlConfig
from mkdaemon.config.positions import PositionSource
from mkdaemon.config.root import Config
from mkdaemon.control.core import FlightCore
from mkdaemon.control.events import EyeStats, PoseSeen, SightRefused
from mkdaemon.daemon.audit import Audit
from mkdaemon.daemon.positions import PositionSources
from mkdaemon.daemon.runnable import mistakes
from mkdaemon.telemetry.position import PositionReport
from mkdaemon.telemetry.setpoint import HoldSetpoint, LandSetpoint, TakeOffSetpoint
from mkdaemon.telemetry.signature import sign, stamped_proof
from mkdaemon.telemetry.vision import EyeState
from mksim.physics.mocap import RATE, MotionCapture
from mksim.physics.world import World
from mksim.programs.rehearsal import simulated_aircraft
from mksim.programs.virtualdaemon import VirtualDaemon, virtual_clock, virtual_config
from mksim.programs.virtualports import Cable, LocalBus
from mksim.simulation import Simulation

SECRET = "0123456789abcdef"
SUFFIX = "positions/mocap/report"


def payload(sequence=1, z=1.0, epoch=1):
    fields = {"epoch": epoch, "sequence": sequence, "age": 0.003}
    return encode(PositionReport(**fields, position=(0.0, 0.0, z), quaternion=(1.0, 0.0, 0.0, 0.0)))


@dataclass
class Desk:
    sources: PositionSources
    bus: LocalBus
    events: list


def desk(tmp_path, *others, **fields):
    clock, bus, events = virtual_clock(), LocalBus(), []
    if fields.pop("is_signed", True):
        file = tmp_path / "secret"
        file.write_text(SECRET)
        fields["secret_file"] = file
    source = PositionSource(**{"name": "mocap", "target": "map"} | fields)
    core = FlightCore(ControlConfig(), first_epoch=1)
    sources = (source, *(PositionSource(name=name, target="map") for name in others))
    made = PositionSources(sources, core, lambda event, now: events.append(event), Audit(bus, clock), bus, clock)
    made.receive_from(bus)
    return Desk(made, bus, events)


def put(bus, data, proof, at=0.0, suffix=SUFFIX):
    arrive, verify = bus.takers[suffix]
    return arrive(at, data, verify(data, proof))


@virtually
async def test_a_signed_report_is_a_pose_for_the_core_and_then_for_the_bus(tmp_path):
    found = desk(tmp_path)
    data = payload()
    assert put(found.bus, data, stamped_proof(SECRET, SUFFIX, data, 5.0)) is None
    (event,) = found.events
    assert isinstance(event, PoseSeen)
    assert found.bus.values["vision/mocap/pose"] is event.pose


@virtually
async def test_what_is_unsigned_late_or_unreadable_is_counted_by_its_name_and_reaches_no_core(tmp_path):
    found = desk(tmp_path)
    data = payload()
    put(found.bus, data, b"")
    put(found.bus, data, stamped_proof("another secret!!", SUFFIX, data, 5.0))
    put(found.bus, data, stamped_proof(SECRET, "positions/other/report", data, 5.0))
    garbage = b"\xc1 no msgpack"
    assert put(found.bus, garbage, sign(SECRET, SUFFIX, garbage)).token == "malformed"
    arrive, _ = found.bus.takers[SUFFIX]
    assert arrive(0.0, TooLate(100, 0.9, 0.3), 1).token == "setpoint_late"
    assert found.events == []
    shown = asyncio.create_task(found.sources.run())
    await asyncio.sleep(0.01)
    shown.cancel()
    stats = found.bus.values["vision/mocap/stats"]
    assert stats.refused == {"unsigned": 3, "malformed": 1, "late": 1}
    assert stats.state is EyeState.REFUSED


@pytest.mark.parametrize(("fields", "flies"), [({"is_signed": False}, True), ({"trusted_for": ()}, False)])
@virtually
async def test_without_a_secret_every_program_may_report_and_what_is_not_trusted_is_only_shown(tmp_path, fields, flies):
    found = desk(tmp_path, **fields)
    data = payload()
    assert put(found.bus, data, b"" if flies else sign(SECRET, SUFFIX, data)) is None
    assert [type(event) for event in found.events] == [PoseSeen] * flies
    assert "vision/mocap/pose" in found.bus.values


@virtually
async def test_a_refused_pose_is_told_to_the_core(tmp_path):
    found = desk(tmp_path)
    for sequence, z in ((1, 1.0), (2, 3.0)):
        await asyncio.sleep(0.05)
        data = payload(sequence, z)
        put(found.bus, data, sign(SECRET, SUFFIX, data), at=asyncio.get_running_loop().time())
    assert [type(event) for event in found.events] == [PoseSeen, SightRefused]
    assert found.bus.values["vision/mocap/refused"].refusal == "off_course"


@virtually
async def test_sources_of_one_target_that_show_different_places_are_refused_and_say_so(tmp_path):
    found = desk(tmp_path, "uwb")
    for k in range(60):
        await asyncio.sleep(0.03)
        for suffix, z in ((SUFFIX, 1.0), ("positions/uwb/report", 1.3)):
            data, at = payload(k + 1, z + 1e-6 * k), asyncio.get_running_loop().time()
            put(found.bus, data, sign(SECRET, suffix, data), at, suffix)
    poses = [k for k, event in enumerate(found.events) if isinstance(event, PoseSeen)]
    refused = [event.refused for event in found.events if isinstance(event, SightRefused)]
    assert max(poses) < 20
    assert {(each.camera, each.refusal) for each in refused} == {("mocap", "disputed"), ("uwb", "disputed")}


@virtually
async def test_the_state_is_published_once_a_second_and_when_it_changes(tmp_path):
    found, published = desk(tmp_path), []
    found.bus.followers.append(lambda suffix, value: published.append((suffix, value)))
    running = asyncio.create_task(found.sources.run())
    await asyncio.sleep(2.05)
    data = payload()
    put(found.bus, data, sign(SECRET, SUFFIX, data), at=asyncio.get_running_loop().time())
    await asyncio.sleep(0.1)
    running.cancel()
    states = [value.state for suffix, value in published if suffix == "vision/mocap/stats"]
    assert states == [EyeState.MISSING] * 3 + [EyeState.OK]
    assert [event.stats.state for event in found.events if isinstance(event, EyeStats)] == states
    texts = [value.text for suffix, value in published if suffix == "event/log"]
    assert texts[0].startswith("source mocap: no report arrives: no report yet: start its sender")
    assert texts[1] == "source mocap: works"


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"positions": ({"name": "a"}, {"name": "a"})}, "two sources or cameras are called 'a'"),
        ({"positions": ({"name": "a", "secret_file": "/nowhere"},)}, "secret_file /nowhere"),
    ],
)
def test_a_configuration_that_cannot_work_is_refused(fields, words):
    found = [str(error) for error in mistakes(Config.model_validate(fields), needs_port=False)]
    assert any(words in error for error in found)


HEIGHT = 1.5


class Flight:
    """A daemon, its aircraft, and a system that reports it."""

    def __init__(self, folder):
        (folder / "secret").write_text(SECRET)
        source = PositionSource(name="mocap", target="room", secret_file=folder / "secret")
        config = simulated_aircraft(2, "indoor", 15.0)
        self.world = World(config.flight, seed=2)
        self.bus = LocalBus()
        line = Cable(Simulation(config, self.world), lambda now: None).open
        whole = virtual_config().model_copy(update={"positions": (source,)})
        self.daemon = VirtualDaemon(self.bus, line, config=whole)
        self.capture = MotionCapture(2)

    async def report(self):
        loop, sequence = asyncio.get_running_loop(), 0
        while True:
            measured = self.capture.measure(loop.time(), self.world.truth)
            sequence += 1
            if measured is not None:
                loop.call_later(measured.latency, self.put, measured.report(1, sequence))
            await asyncio.sleep(4.0 / RATE)  # a quarter of what the system measures is enough to fly by

    def put(self, report):
        take, verify = self.bus.takers[SUFFIX]
        payload = encode(report)
        now = asyncio.get_running_loop().time()
        take(now, payload, verify(payload, stamped_proof(SECRET, SUFFIX, payload, now)))

    async def until(self, claim, within):
        loop = asyncio.get_running_loop()
        end = loop.time() + within
        while not claim():
            assert loop.time() < end, self.bus.values.get("control/status")
            await asyncio.sleep(0.02)

    async def stream(self, kind, seconds, fields, is_over=lambda status: False):
        loop = asyncio.get_running_loop()
        end = loop.time() + seconds
        while loop.time() < end and not is_over(self.bus.values["control/status"]):
            self.bus.deliver(kind, loop.time(), *self.bus.sign_next(kind, fields))
            await asyncio.sleep(0.02)


@virtually
async def test_the_daemon_flies_by_motion_capture_from_take_off_to_landing(tmp_path):
    flight = Flight(tmp_path)
    flight.daemon.start()
    reporting = asyncio.create_task(flight.report())
    now, facts, link = asyncio.get_running_loop().time, flight.daemon.wiring.facts, flight.daemon.wiring.link
    try:
        await flight.until(lambda: link.is_up and link.dialect.extern_control and facts.motors_running(now()), 30.0)
        assert flight.bus.values["vision/mocap/stats"].state is EyeState.OK
        await flight.bus.take_lease("pilot")
        await flight.stream(TakeOffSetpoint, 20.0, {"height": HEIGHT, "target": "room"}, lambda status: status.is_done)
        assert flight.world.truth.position_enu[2] > HEIGHT - 0.2
        await flight.stream(HoldSetpoint, 3.0, {"target": "room"})
        x, y, z = flight.world.truth.position_enu
        assert math.hypot(x, y) < 0.1
        assert abs(z - HEIGHT) < 0.1
        await flight.stream(LandSetpoint, 30.0, {"target": "room"}, lambda status: status.lease is None)
    finally:
        reporting.cancel()
        await flight.daemon.stop()
    truth = flight.world.truth
    assert truth.on_ground
    assert not truth.crashed
    assert math.hypot(*truth.position_enu[:2]) < 0.1
    assert flight.bus.values["vision/mocap/stats"].refused == {}
