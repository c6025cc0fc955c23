"""Who is on the wire: proof, and a port that comes back is the same aircraft or is told and not written to."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest

from lab.rigs.boardport import LineFault
from lab.rigs.grounded import FIX
from lab.rigs.linkrig import Rig, flight_ctrl, navi_ctrl, rig, virtually
from lab.rigs.sticks import build_sticks
from mkdaemon.errors import CommandRejectedError
from mkdaemon.link.session.knownaircraft import ASK_TIME, IdentityCheck, KnownAircraft
from mkdaemon.link.session.peers import PROOF_AGE, Peers, Proof
from mkdaemon.link.session.release import QUIET_TIME
from mkdaemon.protocol.decoder import Unknown
from mkdaemon.protocol.framing import Frame, FrameDecoder
from mkdaemon.protocol.generations import DeadMan
from mkdaemon.protocol.messages import ESCAPE, Settings, SettingsWritten, VersionFc210, VersionRequest
from mkdaemon.protocol.messages.parameters import SettingsRequest
from mkdaemon.protocol.messages.version import NaviVersionClassic
from mkdaemon.protocol.wire import Board, WireMessage
from mksim.simulation import Simulation

QUESTIONS = {"v", "o", "q"}
FC = VersionFc210(
    major=2, minor=12, protocol_major=11, label_checksum=7, patch=0, fault_0=0, fault_1=0, hardware=22,
    motor_controller=100, flags=0,
)  # fmt: skip
NC = NaviVersionClassic(
    major=0, minor=24, protocol_major=11, protocol_minor=0, patch=0, fault_0=0, fault_rest=(0, 0, 0, 0)
)


def elsewhere(make: Callable[[], Simulation], latitude_deg: float) -> Callable[[], Simulation]:
    """The same aircraft at another place."""

    def made() -> Simulation:
        simulation = make()
        simulation.world.sensors.gps = replace(FIX, latitude_1e7=round(latitude_deg * 1e7))
        return simulation

    return made


class Socket:
    """The device file of a rig, which tells one device from the next."""

    def __init__(self, r: Rig, file: Path) -> None:
        self.rig, self.file = r, file
        self._ours = (r.socket.aircraft, r.socket._started)

    async def pull(self, seconds: float = 0.4) -> None:
        """Unplug what is there."""
        self.rig.socket.unplug()
        self.file.unlink()
        await asyncio.sleep(seconds)

    def plug(self, make: Callable[[], Simulation] | None = None) -> int:
        """Plug another aircraft in, or the first one again; returns how much had been written before."""
        self.rig.socket.aircraft, self.rig.socket._started = self._ours
        if make is not None:
            self.rig.socket.replace(make)
        self.file.touch()
        self.rig.socket.is_present = True
        return len(self.rig.socket.wire)

    def letters(self, since: int) -> set[str]:
        """What was written since."""
        items = FrameDecoder().feed(b"".join(raw for _, raw in self.rig.socket.wire[since:]))
        return {item.id for item in items if isinstance(item, Frame)}


@pytest.fixture
def device(tmp_path):
    file = tmp_path / "ttyUSB0"
    file.touch()
    return file


OTHERS = {
    "another place": (navi_ctrl(), elsewhere(navi_ctrl(), -17.0), r"it is 7,798 km from the last position"),
    "another NaviCtrl": (navi_ctrl("0.24"), navi_ctrl("2.14", "2.14"), "nc has release 2.14a, before 0.24b"),
    "a FlightCtrl alone": (navi_ctrl(), flight_ctrl(), "fc answers where nc did"),
    "another FlightCtrl": (flight_ctrl("2.12a"), flight_ctrl("2.08"), "fc has release 2.08a, before 2.12a"),
}


@pytest.mark.parametrize("name", OTHERS)
@virtually
async def test_another_aircraft_at_the_port_is_told_and_not_written_to(name, device):
    ours, other, reason = OTHERS[name]
    async with rig(ours, port=str(device)) as r:
        socket = Socket(r, device)
        await r.until_up()
        await asyncio.sleep(3.0)
        await socket.pull()
        received, written = len(r.log.rx), socket.plug(other)
        await r.until(lambda: r.link.doubt is not None and r.link.doubt.token == "other_aircraft", 8)
        await asyncio.sleep(5.0)
        assert socket.letters(written) <= QUESTIONS, "neither a release nor a request"
        assert len(r.log.rx) == received, "nothing it said was taken for ours"
        assert r.condition == "down"
        with pytest.raises(CommandRejectedError, match=reason):
            await r.link.request(VersionRequest())
        r.link.accept_aircraft()
        await r.until_up(8)
        assert "b" in socket.letters(written), "the release comes first after the confirmation"


@virtually
async def test_ours_is_served_again_after_another_one_was_at_the_port(device):
    async with rig(navi_ctrl(), port=str(device)) as r:
        socket = Socket(r, device)
        await r.until_up()
        await asyncio.sleep(3.0)
        await socket.pull()
        socket.plug(elsewhere(navi_ctrl(), -17.0))
        await r.until(lambda: r.link.doubt is not None, 8)
        await socket.pull(1.2)
        socket.plug()
        await r.until_up(5)
        assert r.link.doubt is None
        with pytest.raises(CommandRejectedError, match="no_other_aircraft"):
            r.link.accept_aircraft()


@virtually
async def test_another_flightctrl_behind_the_same_navictrl_is_told_when_it_names_itself(device):
    async with rig(navi_ctrl("0.24", "2.12a"), port=str(device)) as r:
        socket = Socket(r, device)
        await r.until(lambda: r.link.dialect.fc_release is not None, 8)
        await socket.pull()
        socket.plug(navi_ctrl("0.24", "2.08"))
        await r.until(lambda: r.link.doubt is not None and "fc has release 2.08a" in r.link.doubt.reason, 8)
        r.link.accept_aircraft()
        await r.until(lambda: r.link.is_up and r.link.dialect.fc_release is not None, 8)


@pytest.mark.parametrize("word", ["2.08", "2.12a", "2.14"])
@pytest.mark.parametrize("between", [None, elsewhere(navi_ctrl(), -17.0)])
@virtually
async def test_a_flight_is_released_on_the_same_aircraft_as_soon_as_it_comes_back(word, between, device):
    loop = asyncio.get_running_loop()
    async with rig(flight_ctrl(word, gate_parameter=200), port=str(device)) as r:
        socket = Socket(r, device)
        await r.until_up()
        await asyncio.sleep(1.0)
        ours, layout = r.socket.aircraft, r.link.dialect.extern_control
        for _ in range(50):
            r.link.send_setpoint(build_sticks(layout, throttle=60, pitch=20), deadline=loop.time() + 0.1)
            await asyncio.sleep(0.02)
        assert ours.flight.core.controlled
        await socket.pull(0.3)
        if between is not None:
            written = socket.plug(between)
            await r.until(lambda: r.link.doubt is not None and r.link.doubt.token == "other_aircraft", 8)
            assert socket.letters(written) <= QUESTIONS
            await socket.pull(0.6)
        ours.flight.core.controlled = True  # what it obeyed last, were it held for ever
        written, opened = socket.plug(), r.socket.openings
        await r.until(lambda: r.socket.openings > opened, 3)
        back = loop.time()
        await r.until(lambda: "b" in socket.letters(written), 1)
        assert loop.time() - back <= 0.05, "one question and its answer before the release"
        await r.until(lambda: not ours.flight.core.controlled, 0.2)


@virtually
async def test_a_board_that_does_not_answer_gets_nothing_but_questions_until_it_is_confirmed(device):
    async with rig(navi_ctrl(), port=str(device)) as r:
        socket = Socket(r, device)
        await r.until_up()
        await socket.pull()
        written = socket.plug()
        await r.until(lambda: r.socket.port is not None and not r.socket.port.is_closed, 3)
        r.socket.port.inject(LineFault.SILENCE)
        await r.until(lambda: r.link.doubt is not None and r.link.doubt.token == "aircraft_unproven", 3)
        await asyncio.sleep(5.0)
        assert socket.letters(written) == {"v"}
        r.link.accept_aircraft()
        await r.until(lambda: "b" in socket.letters(written), 8)


# -- pure ------------------------------------------------------------------------------------------------------------


def knows(*messages: tuple[Board, WireMessage]) -> KnownAircraft:
    known = KnownAircraft()
    for board, message in messages:
        known.note(board, message, 0.0)
    return known


@pytest.mark.parametrize(
    ("board", "message", "difference"),
    [
        (Board.FC, FC, None),
        (Board.FC, FC.model_copy(update={"fault_0": 1, "motor_controller": 90}), None),
        (Board.FC, FC.model_copy(update={"hardware": 25}), "fc has hardware 25, before 22"),
        (Board.FC, FC.model_copy(update={"label_checksum": 8}), "fc has label checksum 8, before 7"),
        (Board.NC, NC, None),
        (Board.FC, Settings(index=3, parameters=bytes(144)), None),
        (Board.FC, Settings(index=2, parameters=bytes(144)), None),
        (Board.FC, Settings(index=3, parameters=b"\1" + bytes(143)), "parameter set 3 has other values"),
        (Board.FC, Unknown(Board.FC, "V", b"", "no layout"), "fc is not MikroKopter firmware"),
        (Board.FC, Unknown(Board.FC, "X", b"", "no such command"), None),
    ],
)
def test_what_tells_one_aircraft_from_another(board, message, difference):
    known = knows((Board.FC, FC), (Board.FC, Settings(index=3, parameters=bytes(144))))
    assert known.find_difference(board, message, 1.0) == difference


@pytest.mark.parametrize(
    ("before", "board", "difference"),
    [
        ([(Board.FC, FC)], Board.NC, "nc answers where fc did"),
        ([(Board.NC, NC), (Board.FC, FC)], Board.FC, "fc answers where nc did"),
        ([(Board.NC, NC), (Board.FC, FC)], Board.NC, None),
    ],
)
def test_another_board_at_the_end_of_the_wire_is_another_aircraft(before, board, difference):
    assert knows(*before).find_misplaced(board) == difference


def test_a_set_that_was_written_is_not_compared_with_the_one_before():
    known = knows(
        (Board.FC, FC), (Board.FC, Settings(index=3, parameters=bytes(144))), (Board.FC, SettingsWritten(index=3))
    )
    assert known.find_difference(Board.FC, Settings(index=3, parameters=b"\1" + bytes(143)), 1.0) is None


def test_another_release_at_the_same_address_is_another_aircraft():
    known = knows((Board.NC, NC), (Board.FC, FC), (Board.FC, FC.model_copy(update={"minor": 8})))
    assert known.versions.keys() == {Board.FC}


def asked(check: IdentityCheck, until: float) -> list[tuple[float, bytes]]:
    """Every question, without an answer."""
    times = [0.01 * tick for tick in range(round(until / 0.01))]
    return [(now, question[0]) for now in times if (question := check.due(now)) is not None]


def test_questions_do_not_keep_an_old_stick_command_alive():
    known = knows((Board.FC, FC))
    at = [now for now, _ in asked(IdentityCheck(known, DeadMan.ANY_COMMAND_0S5, 0.0, may_read_set=True), 9.0)]
    assert max(later - now for now, later in pairwise(at)) >= QUIET_TIME
    assert at[0] == 0.0
    assert [now for now in at if ASK_TIME + 0.1 < now < QUIET_TIME] == []
    steady = asked(IdentityCheck(known, DeadMan.CONTROL_2S, 0.0, may_read_set=True), 9.0)
    assert len([now for now, _ in steady if ASK_TIME < now < QUIET_TIME]) >= 8


def test_a_passage_that_was_open_when_the_port_was_lost_is_ended():
    known = knows((Board.NC, NC))
    known.was_redirected = True
    sent = [raw for _, raw in asked(IdentityCheck(known, DeadMan.CONTROL_2S, 0.0, may_read_set=False), 4.0)]
    assert ESCAPE in sent
    check = IdentityCheck(known, DeadMan.CONTROL_2S, 0.0, may_read_set=False)
    check.received(Board.FC, FC, 0.1)
    assert check.is_same, "its NaviCtrl passes the line through to it"


@pytest.mark.parametrize("may_read_set", [False, True])
def test_the_active_set_is_read_where_the_motors_stood_still(may_read_set):
    known = knows((Board.FC, FC), (Board.FC, Settings(index=3, parameters=bytes(144))))
    check = IdentityCheck(known, DeadMan.CONTROL_2S, 0.0, may_read_set=may_read_set)
    check.due(0.0)
    check.received(Board.FC, FC, 0.02)
    assert check.is_same is not may_read_set
    if may_read_set:
        raw, _ = check.due(0.02)
        assert SettingsRequest(index=255).to_frame() in raw
        check.received(Board.FC, Settings(index=3, parameters=b"\1" + bytes(143)), 0.06)
        assert check.difference
        assert not check.is_same


def test_a_board_that_never_sends_its_set_is_known_by_its_version():
    known = knows((Board.FC, FC), (Board.FC, Settings(index=3, parameters=bytes(144))))
    check = IdentityCheck(known, DeadMan.CONTROL_2S, 0.0, may_read_set=True)
    check.received(Board.FC, FC, 0.0)
    asked(check, 2.0)
    assert check.is_same


VERSION = VersionFc210.decode(bytes([2, 12, 11, 0xBA, 0, 0, 0, 22, 103, 1]))


@pytest.fixture
def peers():
    return Peers()


def test_a_version_reply_proves_its_sender_until_it_is_old(peers):
    assert peers.proof is None
    assert not peers.is_proven(Board.FC, 0.0)
    peers.version_received(Board.FC, VERSION, 10.0)
    assert peers.proof == Proof(Board.FC, 10.0)
    assert peers.is_proven(Board.FC, 10.0 + PROOF_AGE)
    assert not peers.is_proven(Board.FC, 10.0 + PROOF_AGE + 0.01)
    assert not peers.is_proven(Board.NC, 10.0)


def test_a_redirection_voids_the_proof_but_not_what_is_known_of_the_firmware(peers):
    peers.version_received(Board.FC, VERSION, 10.0)
    peers.redirect(Board.FC, 10.0)
    assert not peers.is_proven(Board.FC, 10.0)
    assert peers.firmware == {Board.FC: str(VERSION.release)}
    peers.version_received(Board.FC, VERSION, 11.0)
    peers.redirect(None, 11.5)
    assert not peers.is_proven(Board.FC, 11.0)


def test_another_opening_of_the_port_voids_everything_that_was_heard(peers):
    peers.note_sender(Board.FC)
    peers.version_received(Board.FC, VERSION, 10.0)
    peers.restart()
    assert (peers.direct, peers.boards, peers.firmware, peers.proof) == (Board.ANY, set(), {}, None)


@pytest.mark.parametrize("board", [Board.BL, Board.MAG])
def test_a_board_that_is_no_pilot_is_not_where_the_wire_ends(peers, board):
    assert not peers.note_sender(board)
    assert (peers.direct, peers.boards) == (Board.ANY, set())


def test_a_silence_while_the_wire_was_passed_through_tells_nothing_about_the_boards(peers):
    peers.redirect(None, 0.5)  # it had not begun
    assert not peers.caused_silence(0.1, 2.0)
    peers.redirect(Board.FC, 10.0)
    peers.redirect(None, 15.0)
    assert peers.caused_silence(10.4, 15.5)
    assert not peers.caused_silence(9.0, 15.5)
    assert not peers.caused_silence(16.0, 17.5)


def test_what_boards_said_of_themselves_can_be_forgotten_behind_an_open_port(peers):
    peers.note_sender(Board.FC)
    peers.version_received(Board.FC, VERSION, 10.0)
    assert peers.learn(Board.FC, VERSION)
    assert peers.dialect.extern_control is not None
    peers.forget()
    assert peers.dialect.extern_control is None
    assert (peers.direct, peers.firmware, peers.proof) == (Board.FC, {}, None)


def test_a_flightctrl_that_speaks_after_its_navictrl_is_behind_it(peers):
    assert peers.note_sender(Board.NC)
    assert not peers.note_sender(Board.FC)
    assert (peers.direct, peers.boards) == (Board.NC, {Board.FC, Board.NC})


def test_looks_behind_a_navictrl_are_counted_on_for_a_flightctrl_that_never_named_itself(peers):
    peers.looks = 3
    peers.forget_flightctrl()
    assert peers.looks == 3
    peers.version_received(Board.FC, VERSION, 0.0)
    peers.forget_flightctrl()
    assert peers.looks == 0
