"""A FlightCtrl behind a NaviCtrl cannot be asked in flight: what is known of it again, and what is not."""

from __future__ import annotations

import asyncio
from contextlib import asynccontextmanager

import pytest

from lab.rigs.boardport import LineFault
from lab.rigs.linkrig import navi_ctrl, rig, virtually
from lab.rigs.sticks import build_sticks
from mkdaemon.errors import CommandRejectedError
from mkdaemon.protocol.messages import ExternControlV1, ExternControlV2
from mkdaemon.telemetry.refusals import Token

SIM = {"gate_parameter": 200}
LAYOUTS = {"2.12a": ExternControlV2, "2.08": ExternControlV1}


def take_off(r):
    """Start the motors and give throttle."""
    r.socket.aircraft.world.pilot.gas = 60
    r.socket.aircraft.flight.core.start()


@asynccontextmanager
async def flying(flight="2.12a", nc="0.24", **cfg):
    """A link to an aircraft that has been in the air for six seconds, its boards known."""
    async with rig(navi_ctrl(nc, flight, **SIM), rates={"osd": 200}, **cfg) as r:
        await r.until(lambda: r.link.dialect.fc_release is not None, 5)
        await asyncio.sleep(1.0)
        take_off(r)
        await asyncio.sleep(6.0)
        r.log.tx.clear()
        yield r


def letters(r):
    return [sent.message.spec.id for sent in r.log.tx if sent.message is not None]


def valid_frames(r):
    frames = [sent.message for sent in r.log.tx if sent.message is not None and sent.message.spec.id == "b"]
    return [message for message in frames if int(message.config) & 1]


async def steer(r, seconds):
    """Stream sticks in whatever layout the link takes."""
    for _ in range(int(seconds / 0.025)):
        layout = r.link.dialect.extern_control
        if layout is not None:
            deadline = asyncio.get_running_loop().time() + 0.1
            r.link.send_setpoint(build_sticks(layout, throttle=60, pitch=20), deadline=deadline)
        await asyncio.sleep(0.025)


async def silence(r, seconds):
    r.socket.port.inject(LineFault.SILENCE)
    await asyncio.sleep(seconds)
    r.socket.port.inject(LineFault.NONE)


async def reopen(r):
    """Close the port and open it again, as another process does."""
    before = r.socket.openings
    r.socket.port.lose("the program was killed")
    await r.until(lambda: r.socket.openings > before, 5)
    await r.until(lambda: r.link.offered_memory() is not None, 5)


@pytest.mark.parametrize(("nc", "word"), [("0.24", "2.12a"), ("0.24", "2.08"), ("2.14", "2.14")])
@virtually
async def test_after_a_radio_gap_in_flight_the_flightctrl_is_known_again_without_asking(nc, word):
    async with flying(word, nc) as r:
        layout = r.link.dialect.extern_control
        before = len(r.log.states)
        await silence(r, 1.5)
        await r.until(lambda: any("read only" in state.firmware for state in r.log.states[before:]), 2)
        await r.until(lambda: r.link.dialect.extern_control is layout, 2)
        assert "u" not in letters(r)
        await steer(r, 1.5)
        assert {type(message) for message in valid_frames(r)} == {layout}


@pytest.mark.parametrize("is_flying", [True, False])
@virtually
async def test_another_aircraft_after_a_gap_is_not_taken_for_the_one_before(is_flying):
    async with flying("2.12a") as r:
        r.socket.port.inject(LineFault.SILENCE)
        await asyncio.sleep(1.5)
        r.socket.replace(navi_ctrl("0.24", "2.08", **SIM))
        await asyncio.sleep(0.1)
        if is_flying:
            take_off(r)
        r.socket.port.inject(LineFault.NONE)
        await r.until(lambda: r.link.dialect.fc_release is None, 2)
        r.log.tx.clear()
        await steer(r, 5.0)
        assert {type(message) for message in valid_frames(r)} <= {ExternControlV1}
        assert (r.link.dialect.extern_control is None) is is_flying
        assert r.link.flight_memory is None


@virtually
async def test_what_an_earlier_process_knew_of_another_flight_is_not_offered():
    async with flying() as r:
        memory = r.link.flight_memory
        assert memory is not None
    async with rig(navi_ctrl("0.24", "2.12a", **SIM), probe_flightctrl=False) as r:
        take_off(r)
        r.link.recall_flight(memory)
        await r.until_up()
        await steer(r, 5.0)
        assert r.link.offered_memory() is None
        assert valid_frames(r) == []
        with pytest.raises(CommandRejectedError) as refused:
            r.link.confirm_memory()
        assert refused.value.token == Token.NOTHING_REMEMBERED


@virtually
async def test_an_offer_ends_with_the_flight():
    async with flying() as r:
        await reopen(r)
        r.socket.aircraft.flight.core.stop()
        await asyncio.sleep(0.5)
        assert r.link.offered_memory() is None
        assert r.link.flight_memory is None


@virtually
async def test_a_flightctrl_that_boots_behind_its_navictrl_is_asked_before_the_next_stick_frame():
    async with flying("2.08") as r:
        await steer(r, 1.0)
        r.log.tx.clear()
        began = asyncio.get_running_loop().time()
        r.socket.aircraft.world.faults.start("fc_reboot")
        await steer(r, 14.0)
        sent = [frame for frame in r.log.tx if frame.message is not None]
        asked = next(frame.at for frame in sent if frame.message.spec.id == "u")
        steered = [frame.at for frame in sent if frame.message.spec.id == "b" and int(frame.message.config)]
        assert asked > began + 4.0
        assert [at for at in steered if began + 0.7 < at < asked] == [], "the NaviCtrl tells of it after 0.5 s"
        assert max(steered) > asked


@virtually
async def test_a_short_loss_of_the_bus_between_the_boards_in_flight_is_no_boot():
    async with flying() as r:
        r.socket.aircraft.world.faults.start("spi_lost")
        await r.until(lambda: r.link.dialect.extern_control is None, 1)
        await asyncio.sleep(1.0)
        r.socket.aircraft.world.faults.stop("spi_lost")
        await r.until(lambda: r.link.dialect.extern_control is ExternControlV2, 1)
        assert "u" not in letters(r)
