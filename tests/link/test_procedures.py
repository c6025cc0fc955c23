"""Procedures over a whole link in virtual time, directly, behind a NaviCtrl, interrupted; labels are kept in a file."""

from __future__ import annotations

import asyncio
from pathlib import Path
from types import SimpleNamespace

import pytest

from lab.rigs.boardport import Socket
from lab.rigs.linkrig import Rig, flight_ctrl, navi_ctrl, rig, virtually
from mkdaemon.errors import CommandRejectedError, ProtocolError
from mkdaemon.link import labels
from mkdaemon.link.labels import LABELS, LabelCache, cache_key, read_labels
from mkdaemon.link.procedures import BUSY_WAIT, SilentObserver, run_procedure
from mkdaemon.protocol.dialect import Dialect, Release
from mkdaemon.protocol.messages import SettingsRequest, SettingsWritten
from mkdaemon.protocol.procedures import LiveSet, Patience, Progress
from mkdaemon.protocol.procedures.settings_slots import backup_settings
from mkdaemon.protocol.procedures.steps import Ask
from mkdaemon.protocol.wire import Board

PATIENCE = Patience(6, 0.5)


class Notes(SilentObserver):
    """Keeps what it hears; may refuse a request, or wait for a set to be read."""

    def __init__(self) -> None:
        self.steps: list[str] = []
        self.at_risk: list[LiveSet] = []
        self.refuses_set: int | None = None
        self.reading = asyncio.Event()

    def progress(self, progress: Progress) -> None:
        self.steps.append(progress.what)
        if progress.what == "reading set 2":
            self.reading.set()

    async def live_set_at_risk(self, wanted: LiveSet) -> None:
        self.at_risk.append(wanted)
        self.steps.append("at risk")

    async def live_set_proven(self) -> None:
        self.steps.append("live set proven")

    async def check(self, board, message) -> None:
        if isinstance(message, SettingsRequest) and message.index == self.refuses_set:
            raise CommandRejectedError("motors_running", "motors are running.", "Stop them.")


def make_sets_differ(socket: Socket) -> None:
    """The factory's sets 3 to 5 are equal."""
    eeprom = socket.aircraft.flight.eeprom
    for slot, raw in list(eeprom.sets.items()):
        eeprom.sets[slot] = raw[:50] + bytes((slot,)) + raw[51:]
    socket.aircraft.flight.load(eeprom.active)


async def ready(r: Rig) -> None:
    await r.until_up()
    await r.until(lambda: not r.link.lacks_flightctrl and r.link.dialect.fc_release is not None, 10)
    make_sets_differ(r.socket)


@virtually
async def test_a_refused_request_ends_a_procedure_after_it_has_cleaned_up():
    async with rig(flight_ctrl()) as r:
        await ready(r)
        flight, notes = r.socket.aircraft.flight, Notes()
        notes.refuses_set = 4
        with pytest.raises(CommandRejectedError, match="motors_running"):
            await run_procedure(r.link, backup_settings(PATIENCE), notes)
        assert flight.live.raw == flight.eeprom.sets[3]


@virtually
async def test_a_lost_port_leaves_the_live_set_unproven():
    async with rig(flight_ctrl()) as r:
        await ready(r)
        notes = Notes()
        task = asyncio.create_task(run_procedure(r.link, backup_settings(PATIENCE), notes))
        await notes.reading.wait()
        r.socket.unplug()
        with pytest.raises(CommandRejectedError, match="live_set_unproven"):
            await task
        assert notes.steps[-1] != "live set proven"


@virtually
async def test_who_keeps_no_note_cannot_put_the_live_set_at_risk():
    async with rig(flight_ctrl()) as r:
        await ready(r)
        flight = r.socket.aircraft.flight
        with pytest.raises(ProtocolError, match="no note exists"):
            await run_procedure(r.link, backup_settings(PATIENCE), SilentObserver())
        assert flight.live.raw == flight.eeprom.sets[3]


class Crowded:
    """A link whose line has room again after a while."""

    direct_board = Board.FC

    def __init__(self, *tokens: str) -> None:
        self.refusals = list(tokens)

    async def request(self, message, **how):
        if self.refusals:
            raise CommandRejectedError(self.refusals.pop(0), "the line carries no more.", "Wait.")
        return SettingsWritten(index=3)


def store():
    answer = yield Ask(Board.FC, SettingsRequest(index=3), lambda message: True, 0.4)
    if answer is None:
        answer = yield Ask(Board.FC, SettingsRequest(index=3), lambda message: True, 0.4)
    return answer


@pytest.mark.parametrize("token", ["busy", "board_unproven"])
@virtually
async def test_a_request_that_could_not_be_sent_is_tried_again_and_every_other_refusal_ends_the_procedure(token):
    assert await run_procedure(Crowded(token), store(), SilentObserver()) == SettingsWritten(index=3)
    assert asyncio.get_running_loop().time() == pytest.approx(BUSY_WAIT)
    with pytest.raises(CommandRejectedError, match="flying"):
        await run_procedure(Crowded("flying"), store(), SilentObserver())


@virtually
async def test_a_procedure_without_a_step_is_a_mistake_of_ours():
    with pytest.raises(ProtocolError, match="cancelled before it started"):
        await run_procedure(Crowded(), iter(()), SilentObserver())


NAMES = tuple(f"channel {n}" for n in range(LABELS))


def asked(r: Rig) -> int:
    return sum(s.message is not None and s.message.spec.id == "a" for s in r.log.tx)


@pytest.mark.parametrize(("make", "board"), [(flight_ctrl(), Board.FC), (navi_ctrl(), Board.NC)], ids=["fc", "nc"])
@virtually
async def test_labels_are_read_once_and_kept(make, board, tmp_path):
    path = tmp_path / "state" / "labels.json"
    cache = LabelCache(path)
    async with rig(make) as r:
        await r.until_up()
        first = await read_labels(r.link, board, cache, SilentObserver())
        assert len(first) == LABELS
        assert any("AngleNick" in name or "Angle" in name for name in first)
        assert asked(r) == LABELS
        assert await read_labels(r.link, board, cache, SilentObserver()) == first
        assert asked(r) == LABELS
    cache = LabelCache(path)
    async with rig(make) as r:
        await r.until_up()
        assert await read_labels(r.link, board, cache, SilentObserver()) == first
        assert asked(r) == 0


def test_the_key_is_board_release_and_checksum():
    fc = Dialect(fc_release=Release(2, 12, 0), nc_release=Release(0, 24, 0), label_checksum=0xBA)
    assert cache_key(Board.FC, fc) == "fc 2.12a 0xba"
    assert cache_key(Board.NC, fc) == "nc 0.24a"
    assert cache_key(Board.MAG, fc) is None
    assert cache_key(Board.FC, Dialect(fc_release=Release(2, 8, 0), label_checksum=3)) == "fc 2.08a"


@pytest.mark.parametrize("content", ["", "not json", "[1, 2]", '{"fc 2.12a": ["too", "few"]}'])
def test_a_broken_file_is_an_empty_cache(content: str, tmp_path: Path):
    path = tmp_path / "labels.json"
    path.write_text(content)
    cache = LabelCache(path)
    assert cache.find("fc 2.12a") is None
    cache.keep("fc 2.12a", NAMES)
    assert LabelCache(path).find("fc 2.12a") == NAMES


async def test_labels_of_a_board_whose_firmware_is_unknown_are_not_kept(monkeypatch):
    async def read(*_, **__):
        return NAMES

    monkeypatch.setattr(labels, "run_procedure", read)
    cache = LabelCache(None)
    link = SimpleNamespace(dialect=Dialect())
    assert await read_labels(link, Board.FC, cache, SilentObserver()) == NAMES
    assert cache.find_for(Board.FC, Dialect(fc_release=Release(2, 12, 0))) is None
    assert cache._known == {}
