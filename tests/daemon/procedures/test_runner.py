"""Procedures as verbs of the daemon: one at a time, not beside flying, and the board left as promised."""

from __future__ import annotations

import asyncio

import pytest

from lab.rigs.boardport import LineFault
from lab.rigs.linkrig import flight_ctrl, navi_ctrl, virtually
from mkdaemon.control.admission.beginnings import BoardRequest
from mkdaemon.daemon.procedures.runner import MOTORS_WAIT
from mkdaemon.daemon.procedures.table import PROCEDURES, request_model
from mkdaemon.errors import CommandRejectedError, RequestTimeoutError
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.procedure import ProcedureRequest
from tests.control.events import flight
from tests.daemon.procedures.procedure_rig import on_boards, plug_in, procedure_rig

POINTS = [{"latitude_deg": 53.0712, "longitude_deg": 8.7912, "altitude": 10.0}]


@pytest.mark.parametrize("make", [flight_ctrl(), navi_ctrl()], ids=["fc", "nc"])
@virtually
async def test_a_backup_answers_with_the_sets_and_publishes_its_progress(make, tmp_path):
    async with procedure_rig(plug_in(make), tmp_path) as rig:
        await rig.until_ready()
        live = rig.flight.live.raw
        result = await rig.ask("settings_backup", holder="tester")
        assert (result.status, result.reply_type) == ("accepted", "SettingsBackup.v1")
        assert {one.slot: one.raw[: len(live)] for one in result.reply["sets"]} == rig.flight.eeprom.sets
        assert rig.flight.live.raw == live
        assert rig.steps() == [("settings_backup", "running"), ("settings_backup", "done")]
        progress = rig.bus.values("event/progress")
        assert {value.holder for value in progress} == {"tester"}
        assert len({value.id for value in progress}) == 1
        assert list(tmp_path.iterdir()) == []


@on_boards(flight_ctrl())
async def test_a_cancelled_procedure_leaves_the_live_set(rig, tmp_path):
    assert (await rig.ask("cancel")).token == "no_procedure"
    asked = asyncio.create_task(rig.ask("settings_backup"))
    await rig.until(lambda: rig.flight.live.raw == rig.flight.eeprom.sets[2])
    assert (await rig.ask("cancel", id="another")).token == "no_procedure"
    assert (await rig.ask("cancel")).reply["verb"] == "settings_backup"
    assert (await asked).token == "cancelled"
    assert rig.flight.live.raw == rig.flight.eeprom.sets[3]
    assert list(tmp_path.iterdir()) == []


@on_boards(flight_ctrl())
async def test_procedures_and_flying_exclude_each_other(rig):
    rig.phase = Phase.LEASED
    result = await rig.ask("settings_backup")
    assert (result.token, "control is leased" in result.reason) == ("flying", True)
    rig.phase = Phase.FREE
    with rig.interlock.taking_lease():
        assert (await rig.ask("settings_backup")).token == "flying"
    asked = asyncio.create_task(rig.ask("settings_backup"))
    await rig.until(lambda: rig.interlock.running)
    with pytest.raises(CommandRejectedError, match="settings_backup is under way"), rig.interlock.taking_lease():
        pass
    with pytest.raises(CommandRejectedError, match="settings_backup is under way"):
        rig.interlock.require(BoardRequest(board="fc", name="beep", is_slow=True))
    await asked
    rig.interlock.require(BoardRequest(board="fc", name="beep", is_slow=True))


@on_boards(flight_ctrl())
async def test_what_writes_must_be_confirmed_and_what_only_looks_need_not(rig):
    for verb, fields in (
        ("settings_restore", {"sets": [{"slot": 1, "raw": b"j"}]}),
        ("settings_write", {"values": {"gyro_p": 7}}),
        ("mixer_write", {"name": "x", "motors": [0] * 64}),
        ("motor_controllers_write", {"motor": 1}),
        ("settings_recover", {"action": "discard"}),
    ):
        assert (await rig.ask(verb, **fields)).token == "not_confirmed"
    result = await rig.ask("settings_write", values={"gyro_p": 7}, dry_run=True)
    assert (result.status, result.reply["written"]) == ("accepted", ())
    assert result.reply["stored"] != result.reply["before"]


@on_boards(flight_ctrl())
async def test_motors_that_start_between_two_requests_end_a_procedure_and_the_live_set_is_owed(rig):
    asked = asyncio.create_task(rig.ask("settings_backup"))
    await rig.until(lambda: rig.flight.live.raw == rig.flight.eeprom.sets[2])
    known = rig.facts.motors_running
    rig.facts.motors_running = lambda now, within=2.0: True
    result = await asked
    assert (result.token, "motors" in result.reason) == ("live_set_unproven", True)
    assert rig.interlock.owed is not None
    assert (await rig.ask("settings_backup")).token == "live_set_owed"
    with pytest.raises(CommandRejectedError, match="live_set_owed"), rig.interlock.taking_lease():
        pass
    rig.facts.motors_running = known
    await rig.until(lambda: rig.interlock.owed is None)
    assert rig.flight.live.raw == rig.flight.eeprom.sets[3]
    assert any("is live, byte for byte as before" in text for text in rig.bus.texts())


@virtually
async def test_without_a_place_for_the_note_nothing_is_put_at_risk(tmp_path):
    (tmp_path / "file").write_text("")
    async with procedure_rig(plug_in(flight_ctrl()), tmp_path / "file") as rig:
        await rig.until_ready()
        result = await rig.ask("settings_backup")
        assert (result.token, rig.flight.live.raw) == ("journal_unwritable", rig.flight.eeprom.sets[3])


@on_boards(flight_ctrl())
async def test_a_procedure_that_has_no_time_to_leave_the_board_says_so_and_the_live_set_is_owed(rig, tmp_path):
    asked = asyncio.create_task(rig.ask("settings_backup"))
    await rig.until(lambda: rig.flight.live.raw == rig.flight.eeprom.sets[2])
    rig.socket.port.inject(LineFault.SILENCE)
    asyncio.get_running_loop().call_later(0.3, rig.tasks[0].cancel)
    assert (await rig.ask("cancel")).status == "accepted"
    assert (await asked).token == "cancelled"
    assert rig.steps()[-1] == ("settings_backup", "failed")
    assert rig.interlock.owed.active == 3
    assert len(list(tmp_path.iterdir())) == 1
    assert any("do not fly before it is proven" in text for text in rig.bus.texts())


@on_boards(flight_ctrl())
async def test_a_note_that_cannot_be_removed_keeps_everybody_on_the_ground(rig, tmp_path, monkeypatch):
    def discard(note_id):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(rig.journal, "discard", discard)
    result = await rig.ask("settings_backup")
    assert (result.token, str(tmp_path) in result.reason) == ("journal_unwritable", True)
    await rig.until(lambda: ("recovery", "refused") in rig.steps())
    with pytest.raises(CommandRejectedError, match="Permission denied"), rig.interlock.taking_lease():
        pass
    assert (await rig.ask("settings_recover", action="discard", confirm=True)).token == "journal_unwritable"
    monkeypatch.undo()
    await rig.until(lambda: rig.interlock.owed is None)
    assert rig.flight.live.raw == rig.flight.eeprom.sets[3]
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("verb", "running", "token"),
    [
        ("settings_backup", True, "motors_running"),
        ("settings_backup", None, "motors_unknown"),
        ("waypoints_upload", True, "in_flight_needed"),
        ("waypoints_upload", None, "in_flight_needed"),
    ],
)
@on_boards(navi_ctrl())
async def test_what_must_not_meet_running_motors_is_refused_before_it_begins(rig, verb, running, token):
    rig.facts.motors_running = lambda now, within=2.0: running
    before, began = len(rig.socket.wire), asyncio.get_running_loop().time()
    points = {"points": POINTS} if verb == "waypoints_upload" else {}
    result = await rig.ask(verb, **points)
    assert (result.token, bool(result.fix)) == (token, True)
    assert f"do/{verb}" in result.reason + result.fix
    waited = asyncio.get_running_loop().time() - began
    assert waited == pytest.approx(MOTORS_WAIT if running is None else 0.0, abs=0.1)
    assert rig.bus.values("event/progress") == []
    asked = {data[2:3] for _, data in rig.socket.wire[before:]}
    assert not asked & {b"q", b"s", b"w"}, "neither a set nor a point"


@on_boards(flight_ctrl())
async def test_a_defect_in_a_procedure_is_answered_and_the_next_one_runs(rig):
    def fail(message):
        raise RuntimeError("wires crossed")

    rig.refusal = fail
    result = await rig.ask("mixer_read")
    assert (result.token, "RuntimeError: wires crossed" in result.reason) == ("internal", True)
    assert rig.steps() == [("mixer_read", "running"), ("mixer_read", "failed")]
    rig.refusal = lambda message: None
    assert (await rig.ask("mixer_read")).status == "accepted"


@on_boards(flight_ctrl())
async def test_a_line_that_is_lost_and_a_board_that_is_silent_are_told_apart(rig):
    asked = asyncio.create_task(rig.ask("mixer_read"))
    rig.socket.port.inject(LineFault.SILENCE)
    silent = await asked
    assert (silent.token, "no answer from the FC" in silent.reason) == ("procedure_failed", True)
    rig.socket.port.inject(LineFault.NONE)
    await rig.until(lambda: rig.link.is_up and not rig.link.is_discovering)
    asked = asyncio.create_task(rig.ask("mixer_read"))
    await asyncio.sleep(0.003)
    rig.socket.unplug()
    lost = await asked
    assert (lost.token, "unplugged" in lost.reason) == ("link_down", True)


@pytest.mark.parametrize("verb", ["waypoints_upload", "waypoints_clear"])
@on_boards(navi_ctrl())
async def test_a_list_that_is_cut_off_is_said_to_be_incomplete(rig, tmp_path, verb):
    def fall_silent(message):
        if any(data[2:3] == b"w" for _, data in rig.socket.wire):
            raise RequestTimeoutError("the board fell silent")

    rig.refusal = fall_silent
    upload = {"points": POINTS * 20, "source": "field.gpx"}
    result = await rig.ask(verb, **(upload if verb == "waypoints_upload" else {}))
    assert result.token == "list_incomplete"
    assert "the board fell silent; the board's list may be incomplete" in result.reason
    [event] = rig.bus.values("event/mission")
    assert (event.action, event.source) == ("incomplete", "field.gpx" if verb == "waypoints_upload" else "")
    [note] = [path.name for path in tmp_path.iterdir()]
    assert note == "waypoint-list.json"


@on_boards(navi_ctrl())
async def test_a_route_is_made_ready_in_flight_and_ended(rig):
    assert (await rig.ask("waypoints_upload", points=POINTS * 3)).status == "accepted"
    boards = rig.socket.aircraft
    assert (await rig.ask("route_start", confirm=True)).token == "route_on_ground"
    boards.world.pilot.gas = 60
    boards.flight.core.start()
    await asyncio.sleep(2.0)
    rig.facts.state_received(flight(is_flying=True), asyncio.get_running_loop().time())
    assert (await rig.ask("route_start")).token == "not_confirmed"
    started = await rig.ask("route_start", confirm=True)
    assert (started.status, started.reply["count"]) == ("accepted", 3)
    assert "turned to coming home" in started.reply["switch"]
    assert boards.navigation.navigator.points.index == 1
    active = flight(is_flying=True).model_copy(update={"waypoint_index": 1, "waypoint_count": 3})
    rig.facts.state_received(active, asyncio.get_running_loop().time())
    assert (await rig.ask("route_start", confirm=True)).token == "route_active"
    ended = await rig.ask("route_end", confirm=True)
    assert ended.reply["count"] == 0
    assert [event.action for event in rig.bus.values("event/mission")] == ["uploaded", "started", "cleared"]
    rig.facts.state_received(flight(is_flying=True), asyncio.get_running_loop().time())
    assert (await rig.ask("route_start", confirm=True)).token == "no_route"


@on_boards(navi_ctrl("2.14", "2.14"))
async def test_a_newer_navictrl_is_ready_without_its_first_point_written_again(rig):
    assert (await rig.ask("waypoints_upload", points=POINTS * 3)).status == "accepted"
    boards = rig.socket.aircraft
    boards.world.pilot.gas = 60
    boards.flight.core.start()
    await asyncio.sleep(2.0)
    rig.facts.state_received(flight(is_flying=True), asyncio.get_running_loop().time())
    before = len(rig.socket.wire)
    started = await rig.ask("route_start", confirm=True)
    assert (started.status, started.reply["count"]) == ("accepted", 3)
    assert not any(data[2:3] == b"w" for _, data in rig.socket.wire[before:])


def test_what_is_no_procedure_of_the_table_of_keys_is_a_mistake_of_ours():
    for verb in ("fly", "lease"):
        with pytest.raises(ValueError, match=f"do/{verb} is not a procedure"):
            request_model(verb)
    assert {verb for verb in PROCEDURES if not issubclass(request_model(verb), ProcedureRequest)} == set()
