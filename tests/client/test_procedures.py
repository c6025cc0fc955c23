"""The client's typed methods for procedures, against the daemon's own table."""

from __future__ import annotations

from pathlib import Path

import pytest

from mkdaemon.client.settings_files import read_sets
from mkdaemon.errors import ConfigError
from tests.client.message_boards import BoardVehicle
from tests.protocol.procedures.talk import FlightCtrl


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
