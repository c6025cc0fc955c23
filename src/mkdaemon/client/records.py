"""Recordings: marks in all of them, a recording made by this client, and reading."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Final

from mkdaemon.client.verbcalls import RecordsVerbs

if TYPE_CHECKING:
    from mkdaemon.client.groundrecorder import GroundRecording

MEGA: Final = 1_000_000
FIRST_VALUE: Final = 5.0
"""Longest wait of a recording for its first value [s]."""


class Records(RecordsVerbs):
    """Marks, and recordings that this program makes; `uav.record.status` reports the daemon's own recorder."""

    @asynccontextmanager
    async def record(self, folder: Path, *, total_mb: int = 20_000) -> AsyncIterator[GroundRecording]:
        """Record everything that this vehicle puts on the bus while the context lasts; then the file is whole.

        It begins when the first value has arrived, or after five seconds without one.

        `mkdaemon.client.export.values.read_values` reads it back; `mkctl log play` shows it to other programs.

        Args:
            folder: of the files.
            total_mb: all recordings in it together [MB]; recording stops there.

        Raises:
            MkError: what was left could not be written at the end.
        """
        from mkdaemon.client.groundrecorder import GroundPlan, record_ground
        from mkdaemon.record.folder import RoomLimits

        limits = RoomLimits(500 * MEGA, 3600.0, total_mb * MEGA, 1000 * MEGA, may_delete=False)
        expressions = (f"mk/{self._transport.vehicle}/**",)
        plan = GroundPlan([self._transport.endpoint], folder, limits, expressions)
        async with record_ground(plan) as recording:
            with suppress(TimeoutError):
                async with asyncio.timeout(FIRST_VALUE):
                    # What is put before the first value has come is not recorded; Zenoh's threads count.
                    while not recording.tap.vehicles:  # noqa: ASYNC110
                        await asyncio.sleep(0.02)
            yield recording
