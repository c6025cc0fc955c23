"""Setpoints under one lease: checked as the daemon checks them, numbered, signed, streamed until the lease ends."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Mapping
from contextlib import suppress
from functools import cache
from typing import TYPE_CHECKING, Any, Final, Self

from mkdaemon.client.answers import Answer
from mkdaemon.client.samples import Sample, typed_value
from mkdaemon.client.setpointcalls import SetpointCalls
from mkdaemon.client.transport import SetpointPublisher, Transport
from mkdaemon.errors import (
    CommandRejectedError,
    LeaseLostError,
    ManoeuvreError,
    MkError,
    NotEngagedError,
    ProtocolError,
)
from mkdaemon.telemetry.refusals import Token
from mkdaemon.telemetry.status import Status

if TYPE_CHECKING:
    from pydantic import BaseModel

    from mkdaemon.telemetry.control import ControlStatus, HolderGrant, LeaseState, Outcome
    from mkdaemon.telemetry.event import CommandEvent

RATE: Final = 50.0
"""Setpoints a second."""
TTL: Final = 0.3
"""Time each setpoint holds [s]; the daemon's own limit, `control.limiter.setpoint_ttl`, is the same."""
SIGHTING: Final = 12.0
"""Longest time a setpoint that needs a target is streamed until the daemon engages [s]; the target must be in sight and
agree with the aircraft's model for 2 s."""
LOOKING: Final = 0.1
"""Between two looks whether a manoeuvre is done [s]."""
LATEST_NEWS: Final = 0.5
"""What the daemon says sooner after the first setpoint of a manoeuvre may be about the one before [s]."""
ENGAGING: Final = 5.0
"""Longest time neutral sticks are streamed until the daemon engages [s]; it wants a live stream of 1 s."""
GRACE: Final = 1.5
"""Refusals of setpoints before this time are ignored [s]: with a new lease the estimate restarts."""
SILENCE: Final = 3.0
"""A daemon that was not heard for this long is gone [s]; it publishes `control/status` once a second."""
SETTLING: Final = 1.0
"""Longest time after the grant in which a status from before the lease may still arrive [s]."""
GIVING_BACK: Final = 3.0
"""Longest wait for the answer when the lease is given back [s]; the end of the liveliness token ends it as well."""
_OF_STRANGERS: Final = frozenset({Token.NOT_HOLDER, Token.BAD_FIELD, Token.MALFORMED})
"""Refusals that no setpoint from here can meet: signed and checked as they are, others send those under our epoch."""
_OF_THE_WAY: Final = frozenset({Token.SETPOINT_LATE})
"""Refusals of a network or machine that stood still: the stream goes on, and ends with the lease where it is no use."""
_OF_THE_END: Final = frozenset({Token.WRONG_EPOCH, Token.NOT_LEASED})
"""Refusals of a lease that has ended; `control/status`, which follows them, says why."""


class Setpoints:
    """Streams setpoints of every kind under one lease.

    Attributes:
        sequence: number of the last setpoint; counts up over all kinds.
        after_abort: number of the abort that they end; 0 for none.
    """

    def __init__(self, transport: Transport, grant: HolderGrant) -> None:
        self.sequence = self.after_abort = 0
        self._transport = transport
        self._grant = grant
        self._publishers: dict[str, tuple[SetpointPublisher, str]] = {}

    def check(self, kind: str, ttl: float, fields: Mapping[str, Any]) -> BaseModel:
        """Make a setpoint of a kind, as the next one.

        Raises:
            CommandRejectedError: `bad_field`: a field is missing, unknown or out of range.
            MkError: there is no such kind.
        """
        from pydantic import ValidationError

        from mkdaemon.bus.codec import first_mistake
        from mkdaemon.telemetry.refusals import refuse

        model = _models().get(kind)
        if model is None:
            msg = f"there is no setpoint {kind!r}; there is {', '.join(_models())}"
            raise MkError(msg)
        try:
            filled_in = {"epoch": self._grant.epoch, "sequence": self.sequence + 1, "ttl": ttl}
            return model.model_validate({"after_abort": self.after_abort, **fields, **filled_in})
        except ValidationError as error:
            raise refuse(Token.BAD_FIELD, name=model.__name__, detail=first_mistake(error)) from error

    def put(self, kind: str, ttl: float, fields: Mapping[str, Any]) -> None:
        """Check a setpoint, sign it and put it.

        Raises:
            CommandRejectedError: `bad_field`.
            MkError: there is no such kind.
        """
        from mkdaemon.bus.codec import encode, encoding_of
        from mkdaemon.telemetry.signature import sign, stamped_proof

        setpoint = self.check(kind, ttl, fields)
        if kind not in self._publishers:
            publisher = self._transport.stream(f"{self._grant.setpoint_root}/{kind}")
            self._publishers[kind] = (publisher, encoding_of(type(setpoint)))
        publisher, encoding = self._publishers[kind]
        self.sequence += 1
        payload, suffix, secret = encode(setpoint), f"setpoint/{kind}", self._grant.secret
        is_stamped = self._grant.takes_stamps
        proof = (
            stamped_proof(secret, suffix, payload, time.monotonic()) if is_stamped else sign(secret, suffix, payload)
        )
        publisher.put(payload, encoding=encoding, attachment=proof)


def load_models() -> None:
    """Import what a lease needs.

    Done before it is asked for: imports take up to a second, in which setpoints would grow stale, and what the daemon
    said before the lease would seem to be said after it.
    """
    import mkdaemon.telemetry.control
    import mkdaemon.telemetry.event
    import mkdaemon.telemetry.refusals
    import mkdaemon.telemetry.signature  # noqa: F401

    _models()
    typed_value(None, {})


@cache
def _models() -> dict[str, type[BaseModel]]:
    """Every kind of setpoint of the table of keys."""
    from mkdaemon.bus.keys import Use, of_use

    return {spec.suffix.removeprefix("setpoint/"): spec.carries for spec in of_use(Use.SETPOINT) if spec.carries}


class SetpointStream:
    """Streams setpoints for as long as a lease lasts.

    Attributes:
        holder: name others see.
        epoch: number of the lease; every setpoint carries it.
        set: sends one setpoint; for programs that stream at their own rate, at least twice a second.
    """

    def __init__(self, transport: Transport, holder: str, grant: HolderGrant, statuses: AsyncIterator[Sample]) -> None:
        self.holder = holder
        self.epoch = grant.epoch
        self._secret = grant.secret
        self._transport = transport
        self._statuses = statuses
        self.set = SetpointCalls(self.put)
        self._setpoints = Setpoints(transport, grant)
        self._loop = asyncio.get_running_loop()
        self._taken_at = self._received_at = self._loop.time()
        self._status: ControlStatus | None = None
        self._lost: str | None = None
        self._has_ended = False
        self._outcome: Outcome | None = None
        self._refusal: CommandRejectedError | None = None
        self._following: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Self:
        self._following = asyncio.create_task(self._follow(), name=f"lease {self.epoch}")
        return self

    async def __aexit__(self, *_: object) -> None:
        if self._following is not None:
            self._following.cancel()
        await asyncio.shield(self._give_back())

    async def _give_back(self) -> None:
        """Release the aircraft; nothing where the daemon has said that this lease is over, as after a landing."""
        if self._has_ended:
            return
        with suppress(MkError):
            fields = {"action": "release", "epoch": self.epoch, "secret": self._secret}
            await self._transport.command("do", "lease", fields, patience=GIVING_BACK)

    @property
    def setpoints(self) -> int:
        """Setpoints streamed so far."""
        return self._setpoints.sequence

    @property
    def is_engaged(self) -> bool:
        """Whether the daemon has begun to send what is streamed to the aircraft."""
        return self._lost is None and self._status is not None and self._status.phase.is_in_flight

    @property
    def status(self) -> ControlStatus | None:
        """What the daemon last said of this lease: phase, manoeuvre, stage; None before it said anything."""
        return self._status

    @property
    def outcome(self) -> Outcome | None:
        """How the manoeuvre ended by itself; None while it has not."""
        return self._outcome

    @property
    def reason(self) -> str:
        """Why the lease stands where it stands, one sentence, for example what the daemon waits for."""
        if self._lost is not None or self._refusal is not None:
            return self._lost or str(self._refusal)
        return "the daemon has not shown the lease yet" if self._status is None else self._status.reason

    def take_refusal(self) -> CommandRejectedError | None:
        """Return the newest refusal of a setpoint of this lease, once; None where none was refused since."""
        refusal, self._refusal = self._refusal, None
        return refusal

    def put(self, kind: str, fields: Mapping[str, Any], ttl: float = TTL) -> None:
        """Send one setpoint of a kind that is only known by its name; see `set`.

        Args:
            kind: last word of a key `setpoint/<kind>`.
            fields: of the setpoint, without epoch and sequence.
            ttl: age at which it no longer holds [s].

        Raises:
            LeaseLostError: the lease has ended; says why.
            CommandRejectedError: `bad_field`: a field is missing, unknown or out of range.
            MkError: there is no such kind of setpoint.
        """
        self._require_held()
        self._setpoints.put(kind, ttl, fields)

    async def renew(self) -> LeaseState:
        """Keep the lease without streaming; it ends by itself otherwise.

        Raises:
            CommandRejectedError: it has ended.
        """
        from mkdaemon.telemetry.control import LeaseState

        fields = {"action": "renew", "epoch": self.epoch, "secret": self._secret}
        return (await self._transport.command("do", "lease", fields)).as_a(LeaseState)

    async def pause(self, seconds: float) -> None:
        """Keep the lease for some time without flying [s]; in flight it would grow stale.

        Raises:
            LeaseLostError: it has ended.
            CommandRejectedError: it has ended.
        """
        await self.renew()
        await asyncio.sleep(seconds)
        self._require_held()

    async def _fly(
        self,
        kind: str,
        wanted: dict[str, Any],
        lead: dict[str, Any],
        seconds: float,
        rate: float,
        *,
        patience: float | None = None,
    ) -> None:
        """Stream a setpoint; before the daemon engages, stream the lead, one with which it begins a flight.

        Args:
            kind: last word of a key `setpoint/<kind>`.
            wanted: its fields.
            lead: fields of the lead.
            seconds: how long [s].
            rate: setpoints a second [Hz].
            patience: longest lead [s].

        Raises:
            ManoeuvreError: aborted meanwhile.
        """
        self._setpoints.check(kind, TTL, wanted)
        self._end_abort()
        if not self.is_engaged:
            await self._engage(kind, lead, rate, ENGAGING if patience is None else patience)
        self._refusal = None
        await self._stream(kind, wanted, seconds, rate)
        self._require_not_aborted(kind)

    def _end_abort(self) -> None:
        """Let the following setpoints end a reported abort: the program that calls again continues the flight."""
        if self._is_aborted:
            assert self._status is not None
            self._setpoints.after_abort = self._status.aborts

    @property
    def _is_aborted(self) -> bool:
        """Whether an abort is reported that no setpoint of this program ends."""
        from mkdaemon.telemetry.control import Phase

        status = self._status
        if status is None or status.phase is not Phase.ABORTED:
            return False
        return status.aborts != self._setpoints.after_abort

    def _require_not_aborted(self, kind: str) -> None:
        if self._is_aborted:
            raise ManoeuvreError(f"{kind} {self.reason}. The next call under this lease ends the abort and flies on")

    async def _fly_until_done(self, kind: str, wanted: dict[str, Any], patience: float, rate: float) -> None:
        """Stream a setpoint until the daemon says that what it asks for is reached.

        After an abort the stream goes on until the patience ends: the daemon holds the aircraft with it.

        Raises:
            ManoeuvreError: not reached in time, or aborted; says where it stood.
        """
        from mkdaemon.telemetry.control import Phase

        self._setpoints.check(kind, TTL, wanted)
        self._end_abort()
        if not self.is_engaged:
            await self._engage(kind, wanted, rate, SIGHTING)
        self._refusal = None
        start = self._loop.time()
        while self._loop.time() < start + patience:
            await self._stream(kind, wanted, LOOKING, rate)
            status = self._status
            is_ours = status is not None and status.phase is Phase.FLYING and status.manoeuvre == kind
            if status is not None and is_ours and status.is_done and self._loop.time() >= start + LATEST_NEWS:
                return
        self._require_not_aborted(kind)
        stage = "" if self._status is None else self._status.stage
        raise ManoeuvreError(f"{kind} not done within {patience:g} s: {stage or self.reason}")

    async def _engage(self, kind: str, lead: dict[str, Any], rate: float, patience: float) -> None:
        start = self._loop.time()
        while not self.is_engaged:
            if self._loop.time() >= start + patience:
                msg = f"the daemon did not engage within {patience:g} s ({self.reason}): see `mkctl get event/command`"
                raise NotEngagedError(msg)
            if self._loop.time() < start + GRACE:
                self._refusal = None
            await self._stream(kind, lead, 1.0 / rate, rate)

    async def _stream(self, kind: str, fields: dict[str, Any], seconds: float, rate: float) -> None:
        """Stream the same setpoint at a steady rate; late ones are not made up for."""
        start = due = self._loop.time()
        while due < start + seconds:
            await asyncio.sleep(max(due - self._loop.time(), 0.0))
            if self._refusal is not None:
                raise self._refusal
            self.put(kind, fields)
            due = max(due + 1.0 / rate, self._loop.time())
        await asyncio.sleep(max(start + seconds - self._loop.time(), 0.0))
        self._require_held()

    def _require_held(self) -> None:
        silence = self._loop.time() - self._received_at
        if self._lost is None and silence > SILENCE:
            self._lost = f"the daemon has not been heard for {silence:.1f} s"
        if self._lost is None:
            return
        from mkdaemon.telemetry.control import Outcome

        if self._outcome is Outcome.LANDED:
            msg = f"the lease ended with the landing ({self._lost}): take a new lease for the next flight"
            raise LeaseLostError(msg)
        msg = f"the lease was lost: {self._lost}; see `mkctl get control/status event/failsafe`"
        raise LeaseLostError(msg)

    async def _follow(self) -> None:
        """Learn from `control/status` whether the lease is still held, and which setpoints are refused."""
        async for sample in self._statuses:
            try:
                value = sample.value
            except ProtocolError:  # put there by another program than the daemon
                continue
            self._received_at = self._loop.time()
            if sample.suffix == "control/status":
                self._status_arrived(value)
            else:
                self._event_arrived(value)

    def _event_arrived(self, event: CommandEvent) -> None:
        is_ours = event.key.startswith("setpoint/") and event.fields.get("epoch") == self.epoch
        if is_ours and event.token is not None and event.token not in _OF_STRANGERS | _OF_THE_END | _OF_THE_WAY:
            self._refusal = Answer(Status.DENIED, {}, event.token, event.reason, event.fix).refusal

    def _status_arrived(self, status: ControlStatus) -> None:
        if status.lease is not None and status.lease.epoch == self.epoch:
            self._status, self._outcome = status, status.outcome
        elif self._lost is None and (self._status is not None or self._received_at - self._taken_at > SETTLING):
            self._lost, self._has_ended, self._outcome = status.reason, True, status.outcome
