"""Procedures the daemon runs with the boards: common fields of requests, and progress.

Every request may name its `holder`, which others read in the progress and in refusals. The requests themselves are in
`settings` and `mission`.
"""

from enum import StrEnum

from pydantic import Field

from mkdaemon.telemetry.base import Command, Stamped, Telemetry


class ProcedureState(StrEnum):
    """State of a procedure."""

    RUNNING = "running"
    """It is under way."""
    DONE = "done"
    """It came to its end, and what it promises is proven."""
    REFUSED = "refused"
    """The daemon or a board refused it."""
    FAILED = "failed"
    """It could not come to its end; the text says what is left."""


class ProcedureProgress(Stamped):
    """Progress of a procedure: `event/progress`, at every step."""

    id: str
    """Of this run; `do/cancel` takes it."""
    verb: str
    """The request, for example `settings_backup`; `recovery` if the daemon started it."""
    holder: str
    """The client that asked."""
    state: ProcedureState
    """Where it stands."""
    step: int
    """Finished parts."""
    of: int
    """All parts; 0 before they are known."""
    text: str
    """The present part, or how it ended, in words."""
    token: str | None = None
    """Stable word of a refusal or failure."""


class ProcedureRequest(Command):
    """Fields of every request of a procedure."""

    holder: str = Field(default="", max_length=64, pattern=r"^[A-Za-z0-9._-]*$")
    """Name of the client."""

    @property
    def is_confirmed(self) -> bool:
        """Whether nothing is left to be confirmed."""
        return True

    @property
    def allows_flight(self) -> bool:
        """Whether it may be done in flight."""
        return False


class ConfirmedRequest(ProcedureRequest):
    """Fields of every request that writes to a board."""

    confirm: bool = False
    """Must be true: the values change how the aircraft flies."""

    @property
    def is_confirmed(self) -> bool:
        """Whether nothing is left to be confirmed."""
        return self.confirm


class InFlightRequest(ProcedureRequest):
    """Fields of every request that is possible in flight."""

    in_flight: bool = False
    """Allow it with running motors, or while their state is unknown: it takes effect at once."""

    @property
    def allows_flight(self) -> bool:
        """Whether it may be done in flight."""
        return self.in_flight


class CancelRequest(Command):
    """End the procedure that runs: `do/cancel`. The procedure leaves the board in its documented state."""

    id: str | None = None
    """Which one; null for whichever runs."""


class Cancelled(Telemetry):
    """The cancelled procedure: the answer to `do/cancel`."""

    id: str
    """Of the run."""
    verb: str
    """What it was."""
