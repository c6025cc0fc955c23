"""Procedures that take many requests: the daemon runs them, a client asks for one and follows its progress."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Mapping
from typing import Any, Final

from mkdaemon.client.samples import Sample
from mkdaemon.client.transport import Transport

PROGRESS: Final = "event/progress"
"""Key of the progress of every procedure."""
PATIENCE: Final = 600.0
"""Longest wait for the end of a procedure [s]; 128 waypoints or five parameter sets take some minutes on a bad line."""

OnProgress = Callable[[Sample], None]
"""Hears of every step of any procedure that runs."""


class Procedures(Transport):
    """Asks the daemon for procedures."""

    async def run_procedure(
        self,
        verb: str,
        fields: Mapping[str, Any] | None = None,
        *,
        on_progress: OnProgress | None = None,
        patience: float = PATIENCE,
    ) -> dict[str, Any]:
        """Ask the daemon for a procedure, `do/<verb>`, and wait for its end.

        Leaving early (cancellation) ends the waiting, not the procedure.

        Args:
            verb: name of the procedure.
            fields: its arguments.
            on_progress: called with every sample of `event/progress` meanwhile.
            patience: longest wait [s].

        Returns:
            The daemon's reply.

        Raises:
            CommandRejectedError: it was refused, or failed; says token, reason and fix.
            MkError: no daemon speaks for this vehicle.
        """
        async with self._watch_unchecked(PROGRESS) as samples:
            following = asyncio.create_task(_follow(samples, on_progress), name=f"progress of {verb}")
            try:
                return (await self.command("do", verb, fields, patience=patience)).require()
            finally:
                following.cancel()
                await asyncio.gather(following, return_exceptions=True)


async def _follow(samples: AsyncIterator[Sample], on_progress: OnProgress | None) -> None:
    async for sample in samples:
        if on_progress is not None:
            on_progress(sample)
