"""The ground recorder: what arrives is in the file, what does not is counted."""

from __future__ import annotations

import asyncio
import json
import os
import signal

import msgpack
import pytest
import zenoh

from lab.rigs.waiting import wait_until
from mkdaemon.bus.gateway import Bus
from mkdaemon.cli.mkctl.connection import Connection
from mkdaemon.cli.mkctl.record import record
from mkdaemon.client.groundrecorder import GroundPlan, GroundTap, record_ground
from mkdaemon.clock import Clock
from mkdaemon.record.entry import Congestion, EntryKind, Qos, TimeBase
from mkdaemon.record.folder import RoomLimits
from mkdaemon.record.queue import EntryQueue
from mkdaemon.record.reader import Recording
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.record import BusCounts
from tests.bus.support import bus_config, client, free_endpoint
from tests.bus.test_gateway import BATTERY

LIMITS = RoomLimits(10**9, 3600.0, 10**9, 1, may_delete=False)


def entries_in(folder):
    return [entry for path in sorted(folder.glob("*.mcap")) for entry in Recording(path).entries()]


def counts(**numbers):
    stamp = {"monotonic": 1.0, "wall": 2.0}
    return msgpack.packb({"stamp": stamp, "counts": {f"state/{key}": number for key, number in numbers.items()}})


@pytest.fixture
def tap():
    clock = Clock()
    return GroundTap(EntryQueue(10**6), clock, TimeBase.of(clock.stamp()))


def test_loss_is_what_the_daemon_counted_and_did_not_arrive(tap):
    def arrive(**numbers):
        for key, number in numbers.items():
            for _ in range(number):
                tap.take(f"mk/a/state/{key}", b"\x80", "application/msgpack")

    arrive(gps=3)
    tap.take("mk/a/bus/counts", counts(gps=100), "")
    assert tap.vehicles["a"].lost.total() == 0  # it joined later
    arrive(gps=7, flight=2)
    tap.take("mk/a/bus/counts", counts(gps=110, flight=2), "")
    assert tap.vehicles["a"].lost == {"state/gps": 3}
    arrive(gps=5)
    tap.take("mk/a/bus/counts", counts(gps=4), "")  # restarted
    tap.take("mk/a/bus/counts", counts(gps=5), "")
    assert tap.vehicles["a"].lost == {"state/gps": 4}
    tap.take("mk/a/bus/counts", b"\xc1", "")
    assert tap.vehicles["a"].received == 22
    tap.take("replay/b/state/gps", b"\x80", "application/msgpack")
    assert tap.vehicles["b"].received == 1, "a recording that plays is recorded under its vehicle"


async def test_everything_of_all_vehicles_is_recorded_from_the_moment_they_are_there(tmp_path):
    endpoints = [free_endpoint(), free_endpoint()]
    plan = GroundPlan(endpoints, tmp_path, LIMITS, sync_period=0.0)
    async with record_ground(plan) as recording:
        assert recording.connected == []
        async with Bus.open(bus_config(endpoints[0]), "t1") as one, Bus.open(bus_config(endpoints[1]), "t2") as two:
            await wait_until(lambda: len(recording.connected) == 2)
            await wait_until(lambda: publish(one, two) and len(recording.tap.vehicles) == 2)
            with client(endpoints[0]) as session:
                urgent = {"congestion_control": zenoh.CongestionControl.BLOCK, "priority": zenoh.Priority.REAL_TIME}
                session.put("mk/t1/setpoint/stick", b"\x80", attachment=b"s" * 32, express=True, **urgent)
                session.delete("mk/t1/setpoint/stick")
                await wait_until(lambda: any("setpoint" in key for _, key in recording.tap._sequences))
        received = recording.received

    entries = entries_in(tmp_path)
    assert len(entries) == received
    assert {entry.key for entry in entries} == {"mk/t1/state/battery", "mk/t2/state/battery", "mk/t1/setpoint/stick"}
    battery = next(entry for entry in entries if entry.suffix == "state/battery")
    assert (battery.published, battery.encoding) == (2.0, "application/msgpack;mk.Battery.v1")
    assert msgpack.unpackb(battery.payload) == BATTERY.model_dump()
    stick = next(entry for entry in entries if entry.kind is EntryKind.SETPOINT)
    assert (stick.attachment, stick.qos) == (b"s" * 32, Qos(Congestion.BLOCK, 1, express=True))
    (path,) = tmp_path.glob("ground-*.mcap")
    recorded = Recording(path)
    assert len(list(recorded.entries())) == received
    assert recorded.report.is_whole and recorded.report.views > 0


@pytest.mark.parametrize(
    ("expressions", "images"), [(["mk/**"], 0), (["mk/t1/**"], 0), (["mk/**", "mk/*/sim/camera/*"], 1)]
)
async def test_images_of_a_simulated_camera_are_recorded_where_they_are_named(tmp_path, expressions, images):
    endpoint = free_endpoint()
    async with (
        Bus.open(bus_config(endpoint), "t1"),
        record_ground(GroundPlan([endpoint], tmp_path, LIMITS, expressions=expressions)) as recording,
    ):
        await wait_until(lambda: bool(recording.connected))
        with client(endpoint) as session:

            def put():
                session.put("mk/t1/sim/camera/down", b"\x80")
                session.put("mk/t1/sim/truth", b"\x80")
                return recording.received

            await wait_until(put)
    found = {entry.key for entry in entries_in(tmp_path)}
    assert ("mk/t1/sim/camera/down" in found) is bool(images)
    assert found <= {"mk/t1/sim/camera/down", "mk/t1/sim/truth"}


def publish(*buses):
    for bus in buses:
        bus.publish("state/battery", BATTERY)
    return True


async def test_the_command_ends_in_order_by_a_signal_and_says_what_came(tmp_path, capsys):
    endpoint = free_endpoint()
    async with Bus.open(bus_config(endpoint), "t4") as bus:

        async def speak():
            while True:
                bus.publish("state/battery", BATTERY)
                bus.publish("bus/counts", BusCounts(stamp=Stamp(monotonic=1.0, wall=2.0), counts=bus.counts()))
                await asyncio.sleep(0.02)

        speaking = asyncio.create_task(speak())
        for as_json, number in ((True, signal.SIGTERM), (False, signal.SIGINT)):
            folder = tmp_path / number.name
            where = Connection(connect=endpoint, json=as_json)
            recording = asyncio.create_task(record(folder=folder, connection=where))
            await wait_until(lambda folder=folder: any(folder.glob("*.mcap")))
            os.kill(os.getpid(), number)
            assert await recording == 0
        assert await record(folder=tmp_path, seconds=0.01, connection=where) == 0
        speaking.cancel()
    line, *words = capsys.readouterr().out.splitlines()
    fields = json.loads(line)
    assert fields["received"] == fields["written"] > 0
    assert fields["lost_on_the_way"] == 0
    assert "ground-" in words[0]
    assert "t4: " in words[1]
