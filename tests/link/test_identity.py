"""A board or a program that starts anew in flight: the old command goes, and what is known again; in virtual time."""

from __future__ import annotations

import asyncio
from contextlib import asynccontextmanager

import pytest

from lab.rigs.boardport import LineFault
from lab.rigs.linkrig import Rig, flight_ctrl, navi_ctrl, rig, virtually
from lab.rigs.sticks import build_sticks
from mkdaemon.errors import CommandRejectedError
from mkdaemon.link.session.identity import is_of_boot, is_printed
from mkdaemon.protocol.messages import ExternControlV1, ExternControlV2, ExternControlV3
from mkdaemon.telemetry.refusals import Token
from mksim.simulation import Simulation

LAYOUTS = {"early": ExternControlV1, "2.08": ExternControlV1, "2.12a": ExternControlV2, "2.14": ExternControlV3}
SIM = {"gate_parameter": 200}


def is_held(boards: Simulation) -> bool:
    """Whether the FlightCtrl holds a valid command."""
    return boards.flight.external.is_valid


async def stream(r: Rig, seconds: float) -> None:
    """Stream a tilt whenever the link takes it."""
    for _ in range(int(seconds / 0.02)):
        layout = r.link.dialect.extern_control
        if layout is not None:
            deadline = asyncio.get_running_loop().time() + 0.1
            r.link.send_setpoint(build_sticks(layout, throttle=60, pitch=40), deadline=deadline)
        await asyncio.sleep(0.02)


def valid_frames(r: Rig, since: float) -> list[float]:
    """When frames with the valid bit went out since a time [s]."""
    frames = [s for s in r.log.tx if s.at >= since and s.message is not None and s.message.spec.id == "b"]
    return [s.at for s in frames if int(s.message.config) & 1]


@pytest.mark.parametrize(("word", "seed"), [("early", 1), ("2.12a", 3)])
@virtually
async def test_an_old_tilt_that_comes_back_with_a_rebooted_board_is_taken_away(word, seed):
    loop = asyncio.get_running_loop()
    async with rig(flight_ctrl(word, seed=seed, **SIM), seed=seed, probe_baud=True) as r:
        await r.until_up()
        await asyncio.sleep(0.3)
        await stream(r, 1.0)
        boards = r.socket.aircraft
        assert is_held(boards)
        began, silent = loop.time(), r.log.rx[-1].at
        boards.world.faults.start("fc_reboot")
        flying = asyncio.create_task(stream(r, 4.0))
        await r.until(lambda: not boards.world.faults.is_active("fc_reboot"), 1.0)
        await r.until(lambda: r.log.rx[-1].at > began + 3, 8.0)
        await flying
        answered = next(frame.at for frame in r.log.rx if frame.at > began + 3)
        while loop.time() < answered + 3:
            await asyncio.sleep(0.01)
            assert not is_held(boards) or loop.time() < answered + 1.1
        assert silent - began < 0.2
        assert max(valid_frames(r, began), default=began) - began <= 0.35
        assert r.socket.openings == 1
        assert not any(state.condition == "garbage" for state in r.log.states)
        assert any("boots" in state.reason for state in r.log.states)


@pytest.mark.parametrize(("front", "word"), [(None, "2.08"), (None, "2.14"), ("0.24", "2.12a")])
@virtually
async def test_the_first_frames_of_a_program_that_restarts_in_flight_clear_the_control(word, front):
    make = flight_ctrl(word, **SIM) if front is None else navi_ctrl(front, word, **SIM)
    async with rig(make) as r:
        boards = r.socket.aircraft
        await r.until(lambda: r.link.dialect.extern_control is LAYOUTS[word], 5)
        await asyncio.sleep(1.0)
        await stream(r, 1.0)
        await asyncio.sleep(0.1)
        boards.world.pilot.gate = 255
        assert is_held(boards)
        r.socket.port.lose("the program was killed")
        before = r.socket.openings
        await r.until(lambda: r.socket.openings > before, 5)
        await r.until(lambda: not is_held(boards), 0.35)
        assert r.link.dialect.extern_control is None or front is None
        for _ in range(100):
            await asyncio.sleep(0.01)
            assert not is_held(boards)


@pytest.mark.parametrize(
    ("raw", "is_text", "is_boot"),
    [
        (b"\n\nFlight-Ctrl HW:2.2 SW:2.12a", True, True),
        (b"\n UART1 init...ok", True, True),
        (b"\n Looking for FlightControl. FC V0.84a HW:2.0", True, True),
        (b"\nMotor 1: found, version 2", True, True),
        (b"\nACC neutral: 510 512 700", True, True),
        (b"\n Timer2 deinit...ok", True, False),
        (b"\n Timer2 init...ok=@y|mM=|LzZ=G@|======a=oR", None, False),
        (b"\n I2C deinit...ok", True, False),
        (b"\n FAT16 init...No Card in Slot.SD-Card could not be initialized.", True, False),
        (b"\nOpening kml-file:log0001.kml", True, False),
        (b"\n===================================", False, False),
        (b"bC?li=S]A>====NX?li=S]A>===", False, False),
        (b"ok 12", False, False),
        (bytes(range(128, 190)), False, False),
    ],
)
def test_text_a_board_prints_is_told_from_a_broken_frame_and_text_of_a_boot_from_what_is_printed_at_work(
    raw, is_text, is_boot
):
    assert is_text is None or is_printed(raw) is is_text
    assert is_of_boot(raw) is is_boot


@virtually
async def test_what_a_navictrl_prints_of_its_camera_servos_ends_no_flight():
    loop = asyncio.get_running_loop()
    async with rig(navi_ctrl("0.24", "early", **SIM)) as r:
        boards = r.socket.aircraft
        await r.until(lambda: r.link.dialect.extern_control is ExternControlV1, 5)
        await asyncio.sleep(1.0)
        await stream(r, 0.5)
        began = loop.time()
        for _ in range(2):  # a silent SPI bus stops the servos, and 50 exchanges start them again
            boards.world.faults.start("spi_lost", duration=0.1)
            await stream(r, 1.37)
            assert is_held(boards)
            assert r.link.dialect.extern_control is ExternControlV1
        printed = b"".join(loss.raw for loss in r.log.lost if loss.at > began)
        assert printed.count(b"Timer2 deinit...ok") == printed.count(b"Timer2 init...ok") == 2
        sent = [s.message for s in r.log.tx if s.at > began and s.message is not None and s.message.spec.id == "b"]
        assert len(sent) > 80
        assert all(int(message.config) & 1 for message in sent), "no release among them"
        assert r.condition == "up"


LAYOUTS_BEHIND = {"2.12a": ExternControlV2, "2.08": ExternControlV1}


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


def valid_sticks(r):
    frames = [sent.message for sent in r.log.tx if sent.message is not None and sent.message.spec.id == "b"]
    return [message for message in frames if int(message.config) & 1]


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


@pytest.mark.parametrize(("nc", "word"), [("0.24", "2.08"), ("2.14", "2.14")])
@virtually
async def test_after_a_radio_gap_in_flight_the_flightctrl_is_known_again_without_asking(nc, word):
    async with flying(word, nc) as r:
        layout = r.link.dialect.extern_control
        before = len(r.log.states)
        await silence(r, 1.5)
        await r.until(lambda: any("read only" in state.firmware for state in r.log.states[before:]), 2)
        await r.until(lambda: r.link.dialect.extern_control is layout, 2)
        assert "u" not in letters(r)
        await stream(r, 1.5)
        assert {type(message) for message in valid_sticks(r)} == {layout}


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
        await stream(r, 5.0)
        assert {type(message) for message in valid_sticks(r)} <= {ExternControlV1}
        assert (r.link.dialect.extern_control is None) is is_flying
        assert r.link.flight_memory is None


@virtually
async def test_after_another_opening_in_flight_a_client_must_confirm():
    async with flying() as r:
        await reopen(r)
        await stream(r, 3.0)
        assert r.link.dialect.extern_control is None
        assert valid_sticks(r) == []
        assert r.link.confirm_memory().firmware == "2.12a"
        await stream(r, 2.0)
        assert {type(message) for message in valid_sticks(r)} == {ExternControlV2}
        assert r.link.offered_memory() is None


@virtually
async def test_what_an_earlier_process_knew_of_another_flight_is_not_offered():
    async with flying() as r:
        memory = r.link.flight_memory
        assert memory is not None
    async with rig(navi_ctrl("0.24", "2.12a", **SIM), probe_flightctrl=False) as r:
        take_off(r)
        r.link.recall_flight(memory)
        await r.until_up()
        await stream(r, 5.0)
        assert r.link.offered_memory() is None
        assert valid_sticks(r) == []
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
        await stream(r, 1.0)
        r.log.tx.clear()
        began = asyncio.get_running_loop().time()
        r.socket.aircraft.world.faults.start("fc_reboot")
        await stream(r, 14.0)
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
