"""The port, the bus and the cameras of a replay: what came in comes again, what is written goes nowhere."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace as Namespace

import msgpack
import pytest

from mkdaemon.errors import ConfigError, LinkError, LinkLostError, MkError
from mkdaemon.record.entry import STRANGER, Entry, Kind, TimeBase
from mkdaemon.record.looks import Look
from mkdaemon.replay.port import LINE, Refusal, ReplayedLine
from mkdaemon.replay.recorded import Recorded, value_of
from mkdaemon.replay.script import Moment, Script
from mkdaemon.replay.station import ReplayStation
from mkdaemon.telemetry.command import CommandResult
from mkdaemon.telemetry.refusals import Status

BASE = TimeBase("", 0)


def entry(kind, suffix="port", payload=b"", **more):
    return Entry(kind, f"mk/t/{suffix}", payload, "", 1.0, 0.0, BASE, 1, **more)


def line(looks=(), inputs=(), refusals=()):
    script = Script([Look(*look) for look in looks], [Moment(1.0, entry(kind), place) for kind, place in inputs])
    found = ReplayedLine(script, refusals, lambda: found.lose("unplugged"))
    return script, found


async def test_bytes_arrive_and_those_written_go_nowhere():
    _, found = line(inputs=[(Kind.PORT_OPENED, 0)])
    found.bring(b"before")
    found.lose("before")
    opening = asyncio.create_task(found.open("/dev/x", baud=57600))
    await asyncio.sleep(0)
    found.bring_port("/dev/x")
    port = await opening
    assert (port.name, port.backlog, port.descriptor, port.is_recording) == ("/dev/x", 0, None, False)
    reading = asyncio.create_task(port.read())
    await asyncio.sleep(0)
    found.bring(b"#a")
    found.bring(b"b\r")
    assert [await reading, await port.read()] == [b"#a", b"b\r"]
    port.write(b"x")
    port.discard()
    await port.drain()
    found.lose("unplugged")
    with pytest.raises(LinkLostError, match="unplugged"):
        await port.read()
    for use in (port.discard, lambda: port.write(b"x")):
        with pytest.raises(LinkLostError, match="unplugged"):
            use()
    await port.close()


async def test_a_port_that_was_lost_by_a_write_is_lost_by_it_again():
    script, found = line([("control", 1.0)], [(Kind.PORT_LOST, 1)])
    found.bring_port("/dev/x")
    port = await found.open("/dev/x", baud=57600)
    port.write(b"before")
    script.take_look("control")
    with pytest.raises(LinkLostError, match="unplugged"):
        port.write(b"x")


@pytest.mark.parametrize(
    ("refusals", "error", "words"),
    [
        ([], LinkLostError, "no port"),
        ([Refusal(0.9, "absent", True), Refusal(5.0, "later", True)], LinkLostError, "absent"),
        ([Refusal(1.01, "in use", False)], LinkError, "in use"),
    ],
)
async def test_an_opening_that_failed_fails_for_the_same_reason(refusals, error, words):
    _, found = line([(LINE, 1.0)], [(Kind.PORT_OPENED, 1)], refusals)
    with pytest.raises(error, match=words):
        await found.open("/dev/x", baud=57600)


async def test_what_nobody_takes_is_left_out():
    station = ReplayStation({})
    station.bring_setpoint(entry(Kind.SETPOINT, "setpoint/stick"))
    station.bring_query(entry(Kind.QUERY, "do/lease"))
    assert station.outputs == []


@pytest.mark.parametrize("payload", [b"\xc1", msgpack.packb({"epoch": "x"}), msgpack.packb({"epoch": 5})])
async def test_a_setpoint_without_a_known_lease_has_no_signature_that_counts(payload):
    station, taken = ReplayStation({}), []
    station.receive("setpoint/stick", lambda at, data, proof: taken.append((data, proof)), lambda data, proof: True)
    station.bring_setpoint(entry(Kind.SETPOINT, "setpoint/stick", payload, issuer=STRANGER))
    assert taken == [(payload, bytes(32))]


async def test_a_request_that_is_no_map_is_asked_as_it_was():
    asked, station = [], ReplayStation({})

    async def answer(suffix, payload):
        asked.append(payload)
        return CommandResult(status=Status.ACCEPTED, reply={"epoch": 7, "secret": "new"})

    station.serve("do", answer)
    station.bring_query(entry(Kind.QUERY, "do/lease", b"\xc1", exchange=3))
    await asyncio.sleep(0)
    assert asked == [b"\xc1"]
    assert [(output.kind, output.exchange) for output in station.outputs] == [(Kind.REPLY, 3)]


async def test_what_is_still_worked_on_at_the_end_is_ended():
    station = ReplayStation({})

    async def answer(suffix, payload):
        await asyncio.Event().wait()

    station.serve("do", answer)
    station.bring_query(entry(Kind.QUERY, "do/mark", b"\x80"))
    await asyncio.sleep(0)
    await station.close()
    assert station.outputs == []


@pytest.mark.parametrize("config", ["[" * 100_000, '{"link": ' + "9" * 5000 + "}", "{}}"])
def test_a_configuration_that_a_stranger_wrote_is_refused_in_a_line(config):
    with pytest.raises(ConfigError, match="is not understood here"):
        _ = Recorded(Namespace(config=config, name="flight"), [], [], []).config


def test_a_value_of_another_version_is_refused_with_the_place():
    with pytest.raises(MkError, match=r"mk/t/event/record, value 1: not as CommandResult is today \(status"):
        value_of(entry(Kind.SAMPLE, "event/record", msgpack.packb({"state": 1})), CommandResult)
