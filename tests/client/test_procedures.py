"""The client's typed methods for procedures, against the daemon's own table."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from mkdaemon.client.settings_files import read_sets
from mkdaemon.errors import CommandRejectedError, ConfigError
from mkdaemon.protocol.messages import NaviVersionClassic, VersionRequest
from mkdaemon.protocol.wire import WireMessage
from mkdaemon.telemetry.mission import Mission, MissionPoint
from tests.client.message_boards import BoardVehicle
from tests.protocol.procedures.talk import FlightCtrl, NaviCtrl, Reply

ROUTE = Mission(
    points=tuple(MissionPoint(latitude_deg=53 + n / 1e4, longitude_deg=8, altitude=10, hold=n) for n in range(7))
)


NAVICTRL_024 = NaviVersionClassic(
    major=0, minor=24, protocol_major=11, protocol_minor=0, patch=0, fault_0=0, fault_rest=(0,) * 4
)


def with_version(board: NaviCtrl) -> Callable[[WireMessage], Reply]:
    return lambda message: NAVICTRL_024 if isinstance(message, VersionRequest) else board(message)


async def test_settings_are_saved_compared_changed_and_restored(tmp_path: Path) -> None:
    board = FlightCtrl(active=2)
    uav, folder = BoardVehicle(board), tmp_path / "before"
    assert len(await uav.backup_settings(folder)) == 5
    assert {slot: one.parameters.raw for slot, one in read_sets(folder).items()} == board.sets
    assert (await uav.compare_settings(folder)).differing == ()
    before = dict(board.sets)
    changed = await uav.write_settings({"gyro_p": 7, "external_control": "poti3"}, slot=4)
    assert (changed.written, board.sets[4][30], board.sets[4][98]) == ((4, 2), 7, 253)
    assert (await uav.compare_settings(folder)).differing == (4,)
    assert (await uav.restore_settings(folder, dry_run=True)).written == ()
    assert (await uav.restore_settings(folder)).written == (4, 2)
    assert (board.sets, board.live, board.active) == (before, before[2], 2)
    with pytest.raises(ConfigError, match="holds something already"):
        await uav.backup_settings(folder)
    with pytest.raises(ConfigError, match="one file holds one set"):
        await uav.backup_settings(tmp_path / "two.toml", (1, 2))


async def test_a_value_that_does_not_fit_changes_nothing() -> None:
    board = FlightCtrl()
    before = dict(board.sets)
    with pytest.raises(CommandRejectedError, match=r"bad_value: .*the nearest name is 'gyro_p'"):
        await BoardVehicle(board).write_settings({"gyro_q": 1}, slot=1)
    assert (board.sets, board.live) == (before, before[3])


async def test_missions_are_stored_read_verified_and_cleared() -> None:
    board = NaviCtrl()
    uav = BoardVehicle(with_version(board))
    stored = await uav.upload_waypoints(ROUTE, source="test")
    assert (stored.count, len(board.points)) == (7, 7)
    found = await uav.waypoints()
    assert (found.points, found.digest) == (ROUTE.points, stored.digest)
    assert (await uav.verify_waypoints(ROUTE)).differences == ()
    assert (await uav.clear_waypoints()).count == 0
    assert (await uav.verify_waypoints(ROUTE)).differences[0] == "point 1 is absent"


async def test_an_upload_that_does_not_come_to_its_end_says_what_is_left() -> None:
    board = NaviCtrl()
    asked = []

    def deaf_later(message):
        asked.append(message)
        return with_version(board)(message) if len(asked) < 8 else None

    with pytest.raises(CommandRejectedError, match=r"list_incomplete: .*the board's list may be incomplete"):
        await BoardVehicle(deaf_later).upload_waypoints(ROUTE)


async def test_what_writes_hardware_must_be_confirmed() -> None:
    uav = BoardVehicle(FlightCtrl())
    with pytest.raises(CommandRejectedError, match="not_confirmed"):
        await uav.write_mixer("x", [0] * 64)
    with pytest.raises(CommandRejectedError, match="not_confirmed"):
        await uav.change_motor_controller(1, current_limit=20)
