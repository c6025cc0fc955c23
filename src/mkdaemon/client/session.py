"""One flight session: the lease and what is streamed under it, as a state machine without I/O and without a clock.

::

    FREE --take--> ASKED --granted--> HELD --lost--> LOST --resume--> ASKED
                     |--refused-> LOST               any state --end--> FREE

`LeaseKeeper` and `Lease` carry out what it decides. The library, `mkctl teleop`, `mkctl fly` and the gateways all fly
through it: they say who may fly and what is wanted.

* A setpoint of a stream (`stream`) leaves once. A manoeuvre (`fly`) is repeated by `step`, until a stream begins.
* Nothing leaves without a lease, and a lease that was lost is asked for again by `resume` only.
* A loss has a reason, which every later call raises.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum, auto
from functools import cache
from typing import TYPE_CHECKING, Any, Final

from mkdaemon.client.answers import Answer
from mkdaemon.errors import CommandRejectedError, LeaseLostError, ManoeuvreError, MkError, NotEngagedError
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.status import Status

if TYPE_CHECKING:
    from mkdaemon.telemetry.control import ControlStatus, HolderGrant, Outcome
    from mkdaemon.telemetry.event import CommandEvent
    from mkdaemon.telemetry.setpoint import Setpoint

RATE: Final = 50.0
"""Setpoints a second [Hz]."""
TTL: Final = 0.3
"""Time each setpoint holds [s]; the daemon's own limit, `control.limiter.setpoint_ttl`, is the same."""
SIGHTING: Final = 12.0
"""Longest wait until the daemon engages with a setpoint that needs a target [s]; the target must be in sight and agree
with the aircraft's model for 2 s."""
ENGAGING: Final = 5.0
"""Longest wait until the daemon engages with sticks or an attitude [s]; it wants a live stream of 1 s."""
GRACE: Final = 1.5
"""Refusals of setpoints before this time are ignored [s]: with a new lease the estimate restarts."""
LATEST_NEWS: Final = 0.5
"""Status that arrives sooner after the first setpoint of a manoeuvre may be about the one before [s]."""
SILENCE: Final = 3.0
"""A daemon that was not heard for this long is gone [s]; it publishes `control/status` once a second."""
SETTLING: Final = 1.0
"""Longest time after the grant in which a status from before the lease may still arrive [s]."""
TRIES: Final = 20
"""How often a lease is asked for again after a refusal of the moment."""
EARLY: Final = 1e-6
"""A timer of an event loop may fire this much before its time [s], by its resolution and by rounding."""
PAUSE: Final = 0.1
"""Between two of these [s]."""
_OF_THE_MOMENT: Final = frozenset({Token.BUSY, Token.LINK_DOWN, Token.DISCOVERING})
"""Refusals of a lease that may pass within `TRIES`: a release takes up to 1.5 s, and a radio that loses packets in a
row is silent for up to 0.8 s, after which link tests must be answered again, and the board asked for its release."""
_OF_STRANGERS: Final = frozenset({Token.NOT_HOLDER, Token.BAD_FIELD, Token.MALFORMED})
"""Refusals that no setpoint from here can meet: signed and checked as they are, others send those under our epoch."""
_OF_THE_WAY: Final = frozenset({Token.SETPOINT_LATE})
"""Refusals of a network or machine that stood still: the stream goes on, and ends with the lease where it is no use."""
_OF_THE_END: Final = frozenset({Token.WRONG_EPOCH, Token.NOT_LEASED})
"""Refusals of a lease that has ended; `control/status`, which follows them, says why."""


class SessionState(Enum):
    """Where a session stands."""

    FREE = auto()
    """No lease is wanted."""
    ASKED = auto()
    """A lease is asked for; nothing leaves yet."""
    HELD = auto()
    """The lease is held."""
    LOST = auto()
    """The lease was refused or has ended, which the holder has not acknowledged yet."""


@dataclass(frozen=True, slots=True)
class RepeatedSetpoint:
    """A setpoint that the session repeats until it is reached, its time is over, or another one takes its place.

    Attributes:
        kind: last word of a key `setpoint/<kind>`.
        fields: of the setpoint, without epoch and sequence.
        patience: longest wait until the daemon engages [s].
        seconds: duration, from the engagement on [s].
        rate: setpoints a second [Hz].
        lead: fields that are streamed until the daemon engages; the same where None.
        is_until_done: ends when the daemon reports that it is done; not done within `seconds` is an error.
    """

    kind: str
    fields: Mapping[str, Any]
    patience: float
    seconds: float = math.inf
    rate: float = RATE
    lead: Mapping[str, Any] | None = None
    is_until_done: bool = False


@cache
def setpoint_models() -> dict[str, type[Setpoint]]:
    """Every kind of setpoint, by the last word of its key."""
    from mkdaemon.telemetry.setpoint import SETPOINTS

    return {model.suffix.removeprefix("setpoint/"): model for model in SETPOINTS}


class FlightSession:
    """The lease of one holder and what is flown under it.

    Attributes:
        state: where it stands.
        grant: the newest lease; None before the first.
        status: what the daemon last reported of this lease; None before it reported anything.
        outcome: how the manoeuvre ended by itself; None while it has not.
        sequence: number of the last setpoint of this lease; counts up over all kinds.
        repeated: what `step` repeats; None for nothing.
        finished: what was repeated last until its time was over or it was done.
        due: when `step` is due again [s].
    """

    def __init__(self, *, silence: float = SILENCE) -> None:
        """Begin without a lease.

        Args:
            silence: longest silence of the daemon [s]; infinite for a client that does not listen to it.
        """
        self.state = SessionState.FREE
        self.grant: HolderGrant | None = None
        self.status: ControlStatus | None = None
        self.outcome: Outcome | None = None
        self.sequence = 0
        self.repeated: RepeatedSetpoint | None = None
        self.finished: RepeatedSetpoint | None = None
        self.due = 0.0
        self._silence = silence
        self._failure: MkError | None = None
        self._reason = ""
        self._refusal: CommandRejectedError | None = None
        self._tries = self._after_abort = 0
        self._granted_at = self._received_at = 0.0
        self._owes_release = False
        self._kind, self._patience, self._since = "", math.inf, 0.0
        self._engaged_at: float | None = None

    # -- the lease --------------------------------------------------------------------------------------------------

    @property
    def is_wanted(self) -> bool:
        """Whether a lease is asked for or held."""
        return self.state in {SessionState.ASKED, SessionState.HELD}

    @property
    def is_engaged(self) -> bool:
        """Whether the daemon sends what leaves here to the aircraft."""
        return self.state is SessionState.HELD and self.status is not None and self.status.phase.is_in_flight

    @property
    def reason(self) -> str:
        """Why the session stands where it stands, one sentence; empty while no lease is wanted."""
        match self.state:
            case SessionState.FREE:
                return ""
            case SessionState.ASKED:
                return "the lease is requested"
            case SessionState.LOST:
                return self._reason
        if self._refusal is not None:
            return str(self._refusal)
        return "the daemon has not shown the lease yet" if self.status is None else self.status.reason

    def take(self) -> None:
        """Want the lease; nothing changes where it is asked for or held already.

        Raises:
            MkError: the lease was refused or lost; only `resume` asks for it again.
        """
        if self._failure is not None:
            raise self._failure
        if self.state is SessionState.FREE:
            self._ask()

    def resume(self) -> None:
        """Go on after a loss, by asking for the lease again, or after a reported abort, which the next setpoints end.

        Call it for an explicit decision of the pilot or program that flies, never for a stream that goes on.
        """
        if self.state is SessionState.LOST:
            self._ask()
        elif self._is_aborted:
            assert self.status is not None
            self._after_abort = self.status.aborts

    def _ask(self) -> None:
        self.state, self._failure, self._tries = SessionState.ASKED, None, 0
        self.status = self.outcome = None
        self.repeated = self._refusal = None

    def granted(self, grant: HolderGrant, now: float) -> None:
        """Take the lease that was granted; where it is not wanted any more, it only has to be released."""
        self.grant, self._owes_release = grant, True
        self.sequence = self._after_abort = 0
        self._granted_at = self._received_at = now
        self._since = max(self._since, now)
        if self.state is SessionState.ASKED:
            self.state = SessionState.HELD

    def refused(self, error: MkError) -> bool:
        """Take note that no lease was granted.

        Returns:
            Whether to ask again, after `PAUSE`: the reason may have passed then.
        """
        if self.state is not SessionState.ASKED:
            return False
        if isinstance(error, CommandRejectedError) and error.token in _OF_THE_MOMENT and self._tries < TRIES:
            self._tries += 1
            return True
        self._lose(str(error), error)
        return False

    def renew(self, now: float) -> dict[str, Any]:
        """Fields of the command that keeps the lease without a setpoint.

        Raises:
            MkError: the lease was lost, or none is held.
        """
        self.require_held(now)
        if self.state is not SessionState.HELD:
            raise LeaseLostError("the lease is requested, but not held yet")
        return self._signed("renew")

    def release(self) -> dict[str, Any] | None:
        """Fields of the command that gives the lease back, once; None where the daemon has ended it already."""
        if not self._owes_release:
            return None
        self._owes_release = False
        return self._signed("release")

    def _signed(self, action: str) -> dict[str, Any]:
        assert self.grant is not None
        return {"action": action, "epoch": self.grant.epoch, "secret": self.grant.secret}

    def end(self) -> None:
        """Want no lease any more; one that is held is to be released. Acknowledges a loss."""
        self.state, self.repeated, self._failure = SessionState.FREE, None, None

    def lost(self, reason: str) -> None:
        """Take note that the lease has ended.

        Args:
            reason: why, one sentence.
        """
        from mkdaemon.telemetry.control import Outcome

        if self.state is not SessionState.HELD:
            return
        if self.outcome is Outcome.LANDED:
            words = f"the lease ended with the landing ({reason}): take a new lease for the next flight"
        else:
            words = f"the lease was lost: {reason}; see `mkctl get control/status event/failsafe`"
        self._lose(reason, LeaseLostError(words))

    def _lose(self, reason: str, failure: MkError) -> None:
        self.state, self.repeated = SessionState.LOST, None
        self._reason, self._failure = reason, failure

    def require_held(self, now: float) -> None:
        """Refuse where no lease is held or asked for. A daemon that is silent for too long has lost it.

        Raises:
            MkError: says why.
        """
        silence = now - self._received_at
        if self.state is SessionState.HELD and silence > self._silence:
            self.lost(f"the daemon has been silent for {silence:.1f} s")
        if self._failure is not None:
            raise self._failure
        if self.state is SessionState.FREE:
            raise LeaseLostError("no lease is held: take one first")

    # -- what the daemon reports ------------------------------------------------------------------------------------

    def sign_of_life(self, now: float) -> None:
        """Take note that the daemon lives."""
        self._received_at = now

    def status_arrived(self, status: ControlStatus, now: float) -> None:
        """Take `control/status`: it says whether the lease is still held, and what is flown."""
        self.sign_of_life(now)
        if self.state is not SessionState.HELD or self.grant is None:
            return
        if status.lease is not None and status.lease.epoch == self.grant.epoch:
            self.status, self.outcome = status, status.outcome
        elif self.status is not None or now - self._granted_at > SETTLING:
            self.outcome, self._owes_release = status.outcome, False
            self.lost(status.reason)

    def event_arrived(self, event: CommandEvent, now: float) -> None:
        """Take `event/command`: it says which setpoints are refused."""
        self.sign_of_life(now)
        grant, token = self.grant, event.token
        is_ours = grant is not None and event.key.startswith("setpoint/") and event.fields.get("epoch") == grant.epoch
        if is_ours and token is not None and token not in _OF_STRANGERS | _OF_THE_END | _OF_THE_WAY:
            self._refusal = Answer(Status.DENIED, {}, token, event.reason, event.fix).refusal

    def take_refusal(self) -> CommandRejectedError | None:
        """Return the newest refusal of a setpoint of this lease, once; None where none was refused since."""
        refusal, self._refusal = self._refusal, None
        return refusal

    @property
    def _is_aborted(self) -> bool:
        """Whether an abort is reported that no setpoint of this holder ends."""
        from mkdaemon.telemetry.control import Phase

        status = self.status
        if self.state is not SessionState.HELD or status is None or status.phase is not Phase.ABORTED:
            return False
        return status.aborts != self._after_abort

    # -- what is flown ----------------------------------------------------------------------------------------------

    def stream(self, kind: str, fields: Mapping[str, Any], now: float, ttl: float = TTL) -> Setpoint | None:
        """Make the next setpoint of a stream of the holder's own; it leaves once.

        Args:
            kind: last word of a key `setpoint/<kind>`.
            fields: of the setpoint, without epoch and sequence.
            now: the time [s].
            ttl: age from which it is refused [s].

        Returns:
            The setpoint; None while the lease is requested.

        Raises:
            MkError: the lease was refused or lost, or none is held; there is no such kind of setpoint.
            CommandRejectedError: `bad_field`: a field is missing, unknown or out of range.
        """
        self.require_held(now)
        self.repeated = None
        return self._next(kind, fields, ttl)

    def expect_stream(self, now: float, patience: float) -> None:
        """Wait for the engagement with a stream of the holder's own; see `has_started`."""
        self.repeated = None
        self._expect("", now, patience)

    def fly(self, wanted: RepeatedSetpoint, now: float) -> None:
        """Repeat a setpoint from now on.

        Raises:
            MkError: as `stream`.
            CommandRejectedError: as `stream`.
        """
        self.require_held(now)
        self._checked(wanted.kind, wanted.fields, TTL, 0, 0)
        self.repeated, self.due, self._engaged_at = wanted, now, None
        self._expect(wanted.kind, now, wanted.patience)

    def _expect(self, kind: str, now: float, patience: float) -> None:
        self._kind, self._patience, self._since, self._refusal = kind, patience, now, None

    def has_started(self, now: float) -> bool:
        """Whether the daemon flies what was wanted last.

        Raises:
            CommandRejectedError: the lease or the setpoint is refused.
            LeaseLostError: the lease has ended.
            NotEngagedError: the daemon did not begin in time.
        """
        self.require_held(now)
        status = self.status
        if self.is_engaged and status is not None and self._kind in {"", status.manoeuvre}:
            return True
        if self.state is not SessionState.HELD:
            return False
        waited = now - self._since
        refusal = self.take_refusal()
        if refusal is not None and waited > GRACE:
            raise refusal
        if waited >= self._patience:
            words = f"the daemon did not engage within {self._patience:g} s ({self.reason})"
            raise NotEngagedError(f"{words}: see `mkctl get event/command`")
        return False

    def step(self, now: float) -> Setpoint | None:
        """Make the next setpoint of what is repeated.

        Returns:
            The setpoint; None while the lease is requested, and when nothing is repeated: `repeated` is None when its
            time is over or it is done.

        Raises:
            MkError: the lease was refused or lost, or none is held.
            ManoeuvreError: not done in time, or aborted meanwhile; nothing is repeated any more.
        """
        self.require_held(now)
        wanted = self.repeated
        if wanted is None or self.state is SessionState.ASKED:
            return None
        if self._engaged_at is None and self.is_engaged:
            self._engaged_at, self._refusal = now, None
        fields = wanted.fields
        if self._engaged_at is None:
            fields = wanted.fields if wanted.lead is None else wanted.lead
        elif self._is_reached(wanted, now) or now >= self._engaged_at + wanted.seconds - EARLY:
            self._finish(wanted, is_done=self._is_reached(wanted, now))
            return None
        self.due = max(self.due + 1.0 / wanted.rate, now)
        if self._engaged_at is not None:
            self.due = min(self.due, self._engaged_at + wanted.seconds)
        return self._next(wanted.kind, fields, TTL)

    def _is_reached(self, wanted: RepeatedSetpoint, now: float) -> bool:
        from mkdaemon.telemetry.control import Phase

        status = self.status
        if not wanted.is_until_done or status is None or self._engaged_at is None:
            return False
        is_ours = status.phase is Phase.FLYING and status.manoeuvre == wanted.kind
        return is_ours and status.is_done and now >= self._engaged_at + LATEST_NEWS

    def _finish(self, wanted: RepeatedSetpoint, *, is_done: bool) -> None:
        """End what is repeated when it is done, or its time is over.

        Raises:
            ManoeuvreError: it was aborted, or should have been done by now.
        """
        self.repeated, self.finished = None, wanted
        if is_done:
            return
        if self._is_aborted:
            words = f"{wanted.kind} {self.reason}. The next call under this lease ends the abort and flies on"
            raise ManoeuvreError(words)
        if wanted.is_until_done:
            stage = "" if self.status is None else self.status.stage
            raise ManoeuvreError(f"{wanted.kind} not done within {wanted.seconds:g} s: {stage or self.reason}")

    def _next(self, kind: str, fields: Mapping[str, Any], ttl: float) -> Setpoint | None:
        epoch = 0 if self.grant is None else self.grant.epoch
        setpoint = self._checked(kind, fields, ttl, epoch, self.sequence + 1)
        if self.state is not SessionState.HELD:
            return None
        self.sequence += 1
        return setpoint

    def _checked(self, kind: str, fields: Mapping[str, Any], ttl: float, epoch: int, sequence: int) -> Setpoint:
        """Make a setpoint.

        Raises:
            CommandRejectedError: `bad_field`: a field is missing, unknown or out of range.
            MkError: there is no such kind.
        """
        from pydantic import ValidationError

        from mkdaemon.bus.codec import first_mistake

        model = setpoint_models().get(kind)
        if model is None:
            raise MkError(f"there is no setpoint {kind!r}; there is {', '.join(setpoint_models())}")
        numbers = {"epoch": epoch, "sequence": sequence, "ttl": ttl}
        try:
            return model.model_validate({"after_abort": self._after_abort, **fields, **numbers})
        except ValidationError as error:
            raise refuse(Token.BAD_FIELD, name=model.__name__, detail=first_mistake(error)) from error
