"""A daemon that dies during a procedure leaves a note on the disk; the next one makes the live set live again."""

from __future__ import annotations

import asyncio
import json
import random
from contextlib import asynccontextmanager
from types import SimpleNamespace

import pytest

from lab.rigs.linkrig import flight_ctrl, navi_ctrl, virtually
from mkdaemon.clock import Clock
from mkdaemon.config.vehicle import VehicleConfig
from mkdaemon.control.vehicle import VehicleMemory
from mkdaemon.daemon.audit import Audit
from mkdaemon.daemon.procedures import Interlock, Journal, state_folder
from mkdaemon.daemon.procedures.journal import Note
from mkdaemon.daemon.procedures.recovery import RETRIES, Recovery
from mkdaemon.errors import CommandRejectedError
from mkdaemon.protocol.procedures.live_set import Recovered
from mkdaemon.stamp import Stamp
from tests.control.admission.situations import GOOD
from tests.control.events import link_state
from tests.daemon.procedures.procedure_rig import Bus, plug_in, procedure_rig


async def kill_during(socket, folder, verb, after, **fields):
    """Begin a procedure and kill the daemon so long afterwards [s]."""
    async with procedure_rig(socket, folder) as rig:
        await rig.until_ready()
        asked = asyncio.create_task(rig.ask(verb, **fields))
        await rig.until(lambda: rig.interlock.running)
        await asyncio.sleep(after)
        await rig.die()
        asked.cancel()
        await asyncio.gather(asked, return_exceptions=True)
    socket.is_present = True


async def restart(socket, folder):
    """Start the next daemon, and wait until it owes nothing."""
    async with procedure_rig(socket, folder) as rig:
        await rig.until_ready()
        await rig.until(lambda: not rig.runner._recovery.notes)
        return rig.bus.texts()


@asynccontextmanager
async def interrupted(folder):
    """A daemon that finds what another one left that was killed during a backup."""
    socket = plug_in(flight_ctrl())
    await kill_during(socket, folder, "settings_backup", 0.5)
    async with procedure_rig(socket, folder) as rig:
        yield rig


def changed_sets(socket, slots, rng):
    sets = socket.aircraft.flight.eeprom.sets
    return [{"slot": slot, "raw": sets[slot][:20] + rng.randbytes(6) + sets[slot][26:]} for slot in slots]


@virtually
async def test_a_kill_while_the_active_set_is_written_brings_the_old_one_back(tmp_path):
    socket = plug_in(flight_ctrl())
    flight = socket.aircraft.flight
    live = flight.live.raw
    wanted = changed_sets(socket, (3,), random.Random(1))
    async with procedure_rig(socket, tmp_path) as rig:
        await rig.until_ready()
        asked = asyncio.create_task(rig.ask("settings_restore", sets=wanted, confirm=True))
        await rig.until(lambda: flight.live.raw != live)
        await rig.die()
        asked.cancel()
    socket.is_present = True
    texts = await restart(socket, tmp_path)
    assert flight.live.raw == flight.eeprom.sets[3] == live
    assert any("it has been written again and is live, byte for byte as before" in text for text in texts)


@virtually
async def test_while_a_live_set_is_owed_nobody_flies_and_the_refusal_says_why(tmp_path):
    async with interrupted(tmp_path) as rig:
        with pytest.raises(CommandRejectedError, match="settings_backup was interrupted"), rig.interlock.taking_lease():
            pass
        shown = (await rig.ask("settings_recover")).reply["notes"]
        assert [(note.verb, note.active, note.is_owed) for note in shown] == [("settings_backup", 3, True)]
        await rig.until(lambda: rig.interlock.owed is None)
        with rig.interlock.taking_lease():
            pass
        assert (await rig.ask("settings_recover")).reply["notes"] == ()


@pytest.mark.parametrize("other", ["2.08", "2.12a"])
@virtually
async def test_a_note_of_another_aircraft_is_kept_and_not_applied(other, tmp_path):
    """Another release tells it at once; the same release with other sets is found out by reading the active one."""
    socket = plug_in(flight_ctrl())
    await kill_during(socket, tmp_path, "settings_backup", 0.5)
    stranger = plug_in(flight_ctrl(other), seed=2)
    flight = stranger.aircraft.flight
    flight.eeprom.sets[3] = flight.eeprom.sets[3][:60] + bytes(9) + flight.eeprom.sets[3][69:]
    flight.load(3)
    sets = dict(flight.eeprom.sets)
    async with procedure_rig(stranger, tmp_path) as rig:
        await rig.until_ready()
        await rig.until(lambda: rig.interlock.owed is None)
        assert any("this is another aircraft" in text for text in rig.bus.texts())
        assert (flight.eeprom.sets, flight.live.raw) == (sets, sets[3])
        assert len(list(tmp_path.iterdir())) == 1
        assert (await rig.ask("settings_backup")).status == "accepted"
        assert [note.is_owed for note in (await rig.ask("settings_recover")).reply["notes"]] == [False]
    await restart(socket, tmp_path)
    assert socket.aircraft.flight.live.raw == socket.aircraft.flight.eeprom.sets[3]


@pytest.mark.parametrize("is_acted_on", [False, True])
@virtually
async def test_a_note_can_be_discarded_by_who_knows_even_while_it_is_acted_on(tmp_path, is_acted_on):
    async with interrupted(tmp_path) as rig:
        if is_acted_on:
            await rig.until(lambda: rig.interlock.running)
        assert (await rig.ask("settings_recover", action="discard", confirm=True)).reply["notes"] == ()
        await rig.until(lambda: rig.interlock.running is None)
        assert rig.steps() == [("recovery", "running"), ("recovery", "done")] * is_acted_on
        assert rig.interlock.owed is None
        assert list(tmp_path.iterdir()) == []


@virtually
async def test_a_file_that_is_no_note_is_named_and_kept(tmp_path):
    (tmp_path / "live-set-0000.json").write_text(json.dumps({"version": 1}))
    async with procedure_rig(plug_in(flight_ctrl()), tmp_path) as rig:
        assert any("live-set-0000.json: no note of a live set" in text for text in rig.bus.texts())
        assert rig.interlock.owed is None
        assert len(list(tmp_path.iterdir())) == 1


@virtually
async def test_an_upload_that_was_cut_off_is_told_at_the_next_start(tmp_path):
    socket = plug_in(navi_ctrl())
    points = [{"latitude_deg": 53.0712 + n / 1e4, "longitude_deg": 8.7912, "altitude": 10.0} for n in range(20)]
    async with procedure_rig(socket, tmp_path) as rig:
        await rig.until_ready()
        asked = asyncio.create_task(rig.ask("waypoints_upload", points=points, source="field.gpx"))
        await rig.until(lambda: any(data[2:3] == b"w" for _, data in socket.wire))
        await rig.die()
        asked.cancel()
        await asyncio.gather(asked, return_exceptions=True)
    socket.is_present = True
    async with procedure_rig(socket, tmp_path) as rig:
        await rig.until_ready()
        said = "waypoints_upload of field.gpx was cut off and the NaviCtrl's list may be incomplete"
        assert any(said in text and "do not fly the list" in text for text in rig.bus.texts())
        assert [event.action for event in rig.bus.values("event/mission")] == ["incomplete"]
        assert (await rig.ask("waypoints_clear")).status == "accepted"
        assert list(tmp_path.iterdir()) == []


@virtually
async def test_a_client_can_ask_for_an_attempt_at_once(tmp_path):
    async with interrupted(tmp_path) as rig:

        def refuse(message):
            raise CommandRejectedError("read_only", "the release is not known.", "Wait.")

        rig.refusal = refuse
        await rig.until(lambda: ("recovery", "refused") in rig.steps())
        rig.refusal = lambda message: None
        asked = asyncio.get_running_loop().time()
        [note] = (await rig.ask("settings_recover", action="retry")).reply["notes"]
        assert (note.is_owed, note.detail) == (True, "the release is not known.")
        await rig.until(lambda: rig.interlock.owed is None)
        assert asyncio.get_running_loop().time() - asked < RETRIES[0] / 2


@pytest.mark.parametrize("when", ["before", "during"])
@virtually
async def test_an_aircraft_that_is_unplugged_is_looked_at_again_when_it_is_back(tmp_path, when):
    async with interrupted(tmp_path) as rig:
        await rig.until((lambda: rig.link.is_up) if when == "before" else (lambda: rig.interlock.running))
        rig.socket.unplug()
        await asyncio.sleep(5.0)
        assert rig.interlock.owed is not None
        assert rig.interlock.running is None
        rig.socket.is_present = True
        await rig.until(lambda: rig.interlock.owed is None)
        assert rig.flight.live.raw == rig.flight.eeprom.sets[3]
        assert list(tmp_path.iterdir()) == []


NOTE = Note(
    id="0a",
    verb="settings_backup",
    holder="tester",
    stamp=Stamp(monotonic=1.0, wall=2.0),
    firmware="2.12a",
    active=3,
    live=b"\x6a\x01",
    writing={},
)


def test_the_folder_of_what_survives_a_restart(monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    vehicle = VehicleConfig(name="mk1")
    assert state_folder(vehicle) == tmp_path / ".local/state/mkdaemon/mk1"
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "own"))
    assert state_folder(vehicle) == tmp_path / "own/mkdaemon/mk1"
    monkeypatch.setenv("STATE_DIRECTORY", f"{tmp_path}/service:/other")
    assert state_folder(vehicle) == tmp_path / "service/mk1"
    assert state_folder(VehicleConfig(state_folder=tmp_path / "given")) == tmp_path / "given"


class Ground:
    """A recovery with an aircraft that stands still before it."""

    def __init__(self, folder):
        self.bus, self.facts = Bus(), VehicleMemory()
        self.facts.link_changed(link_state())
        self.link = SimpleNamespace(
            is_up=True, lacks_flightctrl=False, dialect=SimpleNamespace(fc_release=NOTE.firmware)
        )  # fmt: skip
        self.interlock = Interlock(lambda: GOOD)
        clock = Clock(monotonic=lambda: 0.0)
        self.recovery = Recovery(Journal(folder), self.link, self.facts, Audit(self.bus, clock), self.interlock)

    def next_note(self, now):
        self.facts.motors_reported(False, now)
        return self.recovery.next_note(now)


@pytest.fixture
def ground(tmp_path):
    ground = Ground(tmp_path)
    ground.recovery.add(NOTE)
    return ground


def test_attempts_that_fail_come_ever_more_seldom_and_the_same_reason_is_told_once(ground):
    now = 100.0
    for pause in (*RETRIES, RETRIES[-1], RETRIES[-1]):
        assert ground.next_note(now) is NOTE
        ground.recovery.attempt_failed(NOTE, "the board fell silent", now)
        assert ground.next_note(now + pause - 0.01) is None
        now += pause
    assert [text for text in ground.bus.texts() if "the board fell silent" in text] == [
        "parameter set 3 was live when settings_backup of tester was cut off: the board fell silent"
    ]


def test_a_verdict_about_an_aircraft_that_has_gone_meanwhile_sets_no_note_aside(ground):
    ground.next_note(100.0)
    ground.link.is_up = False
    ground.next_note(100.1)
    ground.recovery.attempt_ended(NOTE, Recovered.OTHER_AIRCRAFT)
    assert ground.interlock.owed is NOTE
