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
from mkdaemon.telemetry.refusals import Token, refuse
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
async def test_a_second_procedure_is_busy_and_names_the_first(rig):
    first = asyncio.create_task(rig.ask("settings_backup", holder="first"))
    await rig.until(lambda: rig.interlock.running)
    second = await rig.ask("mixer_read")
    assert (second.status, second.token) == ("busy", "busy")
    assert "settings_backup for first is under way" in second.reason
    assert (await first).status == "accepted"
    assert (await rig.ask("mixer_read")).status == "accepted"


@on_boards(flight_ctrl())
async def test_who_stops_waiting_does_not_stop_the_procedure(rig):
    asked = asyncio.create_task(rig.ask("settings_backup"))
    await rig.until(lambda: rig.flight.live.raw == rig.flight.eeprom.sets[2])
    asked.cancel()
    await rig.until(lambda: ("settings_backup", "done") in rig.steps())
    assert rig.flight.live.raw == rig.flight.eeprom.sets[3]


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
async def test_parameters_are_written_by_name_and_read_back(rig, tmp_path):
    result = await rig.ask("settings_write", values={"external_control": "poti2"}, slot=1, confirm=True)
    assert result.reply["written"] == (1, 3)
    assert rig.flight.eeprom.sets[1][98] == 254
    assert rig.flight.live.raw == rig.flight.eeprom.sets[3]
    for values in ({"gyro_q": 1}, {"gyro_p": 300}, {"gyro_p": "much"}):
        result = await rig.ask("settings_write", values=values, confirm=True)
        assert (result.token, rig.flight.live.raw) == ("bad_value", rig.flight.eeprom.sets[3])
    assert list(tmp_path.iterdir()) == []


@on_boards(flight_ctrl())
async def test_sets_are_compared_and_restored(rig):
    sets = [{"slot": one.slot, "raw": one.raw} for one in (await rig.ask("settings_backup")).reply["sets"]]
    assert (await rig.ask("settings_compare", sets=sets)).reply["differing"] == ()
    before = rig.flight.eeprom.sets[4]
    rig.flight.eeprom.sets[4] = before[:30] + bytes((before[30] ^ 1,)) + before[31:]
    assert (await rig.ask("settings_compare", sets=sets)).reply["differing"] == (4,)
    assert (await rig.ask("settings_restore", sets=sets, confirm=True)).reply["written"] == (4, 3)
    assert rig.flight.eeprom.sets[4] == before


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


@on_boards(navi_ctrl())
async def test_a_mission_goes_up_and_the_event_says_so(rig):
    points = [{"latitude_deg": 53.0712 + n / 1e4, "longitude_deg": 8.7912, "altitude": 10.0} for n in range(5)]
    up = await rig.ask("waypoints_upload", points=points, source="field.gpx")
    assert (up.status, up.reply["count"]) == ("accepted", 5)
    [event] = rig.bus.values("event/mission")
    assert (event.action, event.count, event.source) == ("uploaded", 5, "field.gpx")
    down = await rig.ask("waypoints_read")
    assert [point.latitude_deg for point in down.reply["points"]] == [point["latitude_deg"] for point in points]
    assert (await rig.ask("waypoints_verify", points=points)).reply["differences"] == ()
    found = (await rig.ask("waypoints_verify", points=points[:4])).reply["differences"]
    assert found == ("point 5 is one too many",)
    assert (await rig.ask("waypoints_clear")).reply["count"] == 0


@on_boards(flight_ctrl())
async def test_mixer_and_motor_controllers_are_written_and_read_back(rig):
    table = (await rig.ask("mixer_read")).reply
    motors = [*table["motors"][:4], *([1, 2, 3, 4] * 15)]
    stored = await rig.ask("mixer_write", name="odd", motors=motors, confirm=True)
    assert (stored.reply["name"], list(stored.reply["motors"])) == ("odd", motors)
    changed = await rig.ask("motor_controllers_write", motor=2, current_limit=20, confirm=True)
    assert [one.current_limit for one in changed.reply["controllers"]] == [20]
    read = await rig.ask("motor_controllers_read", motors=[1, 2])
    assert [(one.motor, one.current_limit) for one in read.reply["controllers"]][1] == (2, 20)


@on_boards(navi_ctrl())
async def test_labels_are_a_procedure_once_and_kept_afterwards(rig):
    first = await rig.ask("labels", board="fc")
    assert len(first.reply["names"]) == 32
    assert ("labels", "done") in rig.steps()
    told = len(rig.bus.values("event/progress"))
    assert (await rig.ask("labels", board="fc")).reply == first.reply
    assert len(rig.bus.values("event/progress")) == told


@on_boards(flight_ctrl())
async def test_a_second_cancellation_changes_nothing_and_the_live_set_is_proven(rig, tmp_path):
    asked = asyncio.create_task(rig.ask("settings_backup"))
    await rig.until(lambda: rig.flight.live.raw == rig.flight.eeprom.sets[2])
    first = asyncio.create_task(rig.ask("cancel"))
    await asyncio.sleep(0.01)
    assert rig.flight.live.raw == rig.flight.eeprom.sets[2], "it is on its way back"
    assert [(await ask).status for ask in (rig.ask("cancel"), first)] == ["accepted", "accepted"]
    assert (await asked).token == "cancelled"
    assert rig.flight.live.raw == rig.flight.eeprom.sets[3]
    assert list(tmp_path.iterdir()) == []


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


@on_boards(navi_ctrl())
async def test_an_upload_on_a_silent_line_says_so(rig):
    rig.socket.port.inject(LineFault.SILENCE)
    await asyncio.sleep(3.0)
    result = await rig.ask("waypoints_upload", points=[{"latitude_deg": 1.0, "longitude_deg": 2.0, "altitude": 3.0}])
    assert result.token == "link_down"


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


@on_boards(navi_ctrl())
async def test_a_mission_goes_up_in_flight_where_the_request_says_so(rig):
    rig.facts.motors_running = lambda now, within=2.0: True
    result = await rig.ask("waypoints_upload", points=POINTS, in_flight=True)
    assert (result.status, result.reply["count"]) == ("accepted", 1)


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


@virtually
async def test_a_folder_that_takes_no_note_of_a_list_is_named_and_the_mission_goes_up(tmp_path):
    (tmp_path / "file").write_text("")
    async with procedure_rig(plug_in(navi_ctrl()), tmp_path / "file") as rig:
        await rig.until_ready()
        assert (await rig.ask("waypoints_upload", points=POINTS)).status == "accepted"
        texts = [text for text in rig.bus.texts() if "waypoint-list.json" in text]
        assert ["cannot be written" in text or "cannot be removed" in text for text in texts] == [True, True]


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
async def test_of_two_uploads_at_once_one_is_refused(rig):
    asked = [rig.ask("waypoints_upload", points=POINTS * 5, holder=holder) for holder in ("alice", "bob")]
    first, second = await asyncio.gather(*asked)
    assert (first.status, second.token) == ("accepted", "busy")
    assert "alice" in second.reason


@on_boards(navi_ctrl())
async def test_points_far_away_are_refused_unless_they_are_meant(rig):
    near = {"latitude_deg": 53.072, "longitude_deg": 8.791, "altitude": 10.0}
    points = [near, {**near, "latitude_deg": -33.0}]
    result = await rig.ask("waypoints_upload", points=points)
    assert result.token == "point_unusual"
    assert "point 2" in result.reason
    assert (await rig.ask("waypoints_upload", points=points, allow_unusual=True)).status == "accepted"


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


@pytest.mark.parametrize(
    ("points", "token"),
    [([{**POINTS[0], "poi": 9}], "bad_value"), (POINTS * 32, "too_many_points"), (POINTS, "motors_running")],
)
@on_boards(navi_ctrl())
async def test_an_upload_that_wrote_nothing_neither_leaves_a_note_of_a_list_nor_takes_one_away(
    rig, tmp_path, points, token
):
    def refuse_writes(message):
        if message.spec.key == "write_waypoint":
            raise refuse(Token.MOTORS_RUNNING, detail="test")

    rig.refusal = refuse_writes
    assert (await rig.ask("waypoints_upload", points=points)).token == token
    assert not any(data[2:3] == b"w" for _, data in rig.socket.wire)
    assert rig.bus.values("event/mission") == []
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "waypoint-list.json").write_text("of an earlier upload")
    await rig.ask("waypoints_upload", points=points)
    assert (tmp_path / "waypoint-list.json").read_text() == "of an earlier upload"


@on_boards(navi_ctrl())
async def test_a_mission_that_contradicts_itself_is_refused_by_its_mistake(rig):
    result = await rig.ask("waypoints_verify", points=[{**POINTS[0], "poi": 9}])
    assert (result.token, bool(result.fix)) == ("bad_value", True)
    assert "point 1 looks at point 9, which is not a point of interest" in result.reason


def test_what_is_no_procedure_of_the_table_of_keys_is_a_mistake_of_ours():
    for verb in ("fly", "lease"):
        with pytest.raises(ValueError, match=f"do/{verb} is not a procedure"):
            request_model(verb)
    assert {verb for verb in PROCEDURES if not issubclass(request_model(verb), ProcedureRequest)} == set()
