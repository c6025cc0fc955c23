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
    assert len(await uav.settings.backup_to(folder)) == 5
    assert {slot: one.parameters.raw for slot, one in read_sets(folder).items()} == board.sets
    assert (await uav.settings.compare_with(folder)).differing == ()
    before = dict(board.sets)
    changed = await uav.settings.write({"gyro_p": 7, "external_control": "poti3"}, slot=4, confirm=True)
    assert (changed.written, board.sets[4][30], board.sets[4][98]) == ((4, 2), 7, 253)
    assert (await uav.settings.compare_with(folder)).differing == (4,)
    assert (await uav.settings.restore_from(folder, dry_run=True)).written == ()
    assert (await uav.settings.restore_from(folder, confirm=True)).written == (4, 2)
    assert (board.sets, board.live, board.active) == (before, before[2], 2)
    with pytest.raises(ConfigError, match="already exists"):
        await uav.settings.backup_to(folder)
    with pytest.raises(ConfigError, match="one file holds one set"):
        await uav.settings.backup_to(tmp_path / "two.toml", (1, 2))


async def test_missions_are_stored_read_verified_and_cleared() -> None:
    board = NaviCtrl()
    uav = BoardVehicle(with_version(board))
    stored = await uav.waypoints.upload(ROUTE.points, source="test")
    assert (stored.count, len(board.points)) == (7, 7)
    found = await uav.waypoints.read()
    assert (found.points, found.digest) == (ROUTE.points, stored.digest)
    assert (await uav.waypoints.verify(ROUTE.points)).differences == ()
    assert (await uav.waypoints.clear()).count == 0
    assert (await uav.waypoints.verify(ROUTE.points)).differences[0] == "point 1 is absent"


async def test_an_upload_that_does_not_come_to_its_end_says_what_is_left() -> None:
    board = NaviCtrl()
    asked = []

    def deaf_later(message):
        asked.append(message)
        return with_version(board)(message) if len(asked) < 8 else None

    with pytest.raises(CommandRejectedError, match=r"list_incomplete: .*the board's list may be incomplete"):
        await BoardVehicle(deaf_later).waypoints.upload(ROUTE.points)


async def test_what_writes_hardware_must_be_confirmed() -> None:
    uav = BoardVehicle(FlightCtrl())
    with pytest.raises(CommandRejectedError, match="not_confirmed"):
        await uav.mixer.write("x", [0] * 64)
    with pytest.raises(CommandRejectedError, match="not_confirmed"):
        await uav.motor_controllers.write(1, current_limit=20)
