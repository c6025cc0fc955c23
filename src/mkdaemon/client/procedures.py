"""Procedures that take many requests: the daemon runs them, a client asks for one and follows its progress."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Mapping
from typing import TYPE_CHECKING, Any, Final, TypeVar

from mkdaemon.client.identity import client_name
from mkdaemon.client.samples import Sample
from mkdaemon.client.transport import Transport

if TYPE_CHECKING:
    from mkdaemon.telemetry.base import Telemetry
    from mkdaemon.telemetry.procedure import ProcedureProgress

PROGRESS: Final = "event/progress"
"""Key of the progress of every procedure."""
PATIENCE: Final = 600.0
"""Longest wait for the end of a procedure [s]; 128 waypoints or five parameter sets take some minutes on a bad line."""

OnProgress = Callable[["ProcedureProgress"], None]
"""Hears of every step of the procedure that was asked for."""
_Reply = TypeVar("_Reply", bound="Telemetry")


class Procedures(Transport):
    """Asks the daemon for procedures."""

    @property
    def holder(self) -> str:
        """Name under which others see this program's procedures."""
        return client_name()

    async def run_procedure(
        self,
        verb: str,
        reply: type[_Reply],
        fields: Mapping[str, Any] | None = None,
        *,
        on_progress: OnProgress | None = None,
        patience: float = PATIENCE,
    ) -> _Reply:
        """Ask the daemon for a procedure, `do/<verb>`, and wait for its end.

        Leaving early (cancellation) ends the waiting, not the procedure; see `cancel_procedure`.

        Args:
            verb: name of the procedure.
            reply: what the daemon answers.
            fields: its arguments.
            on_progress: called with every step of it.
            patience: longest wait [s].

        Raises:
            CommandRejectedError: it was refused, or failed; says token, reason and fix.
            MkError: no daemon speaks for this vehicle.
        """
        asked = {"holder": self.holder, **(fields or {})}
        if on_progress is None:
            return reply.model_validate((await self.command("do", verb, asked, patience=patience)).require())
        async with self.watch(PROGRESS) as samples:
            following = asyncio.create_task(self._follow(samples, verb, on_progress), name=f"progress of {verb}")
            try:
                answer = await self.command("do", verb, asked, patience=patience)
            finally:
                following.cancel()
                await asyncio.gather(following, return_exceptions=True)
        return reply.model_validate(answer.require())

    async def cancel_procedure(self, procedure_id: str | None = None) -> None:
        """End the procedure that runs, whoever asked for it; it leaves the board as it promises to.

        Args:
            procedure_id: which one, from its progress; whichever runs without.

        Raises:
            CommandRejectedError: no such procedure runs.
            MkError: no daemon speaks for this vehicle.
        """
        (await self.command("do", "cancel", {"id": procedure_id}, patience=60.0)).require()

    async def _follow(self, samples: AsyncIterator[Sample], verb: str, on_progress: OnProgress) -> None:
        from mkdaemon.telemetry.procedure import ProcedureProgress

        async for sample in samples:
            progress = ProcedureProgress.model_validate(sample.fields)
            if (progress.verb, progress.holder) == (verb, self.holder):
                on_progress(progress)
