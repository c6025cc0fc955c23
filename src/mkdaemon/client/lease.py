"""The right to fly, held by a program for as long as a context lasts."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from typing import TYPE_CHECKING, Any, Final, Self

from mkdaemon.client.identity import client_name
from mkdaemon.client.samples import Sample
from mkdaemon.client.setpoints import Setpoints
from mkdaemon.client.transport import Transport
from mkdaemon.errors import LeaseLostError, MkError, NotEngagedError

if TYPE_CHECKING:
    from mkdaemon.telemetry.control import ControlStatus, LeaseState

RATE: Final = 50.0
"""Setpoints a second."""
TTL: Final = 0.3
"""Time each setpoint holds [s]; the daemon's own limit, `control.limiter.setpoint_ttl`, is the same."""
ENGAGING: Final = 5.0
"""Longest time neutral sticks are streamed until the daemon engages [s]; it wants a live stream of 1 s."""
SILENCE: Final = 3.0
"""A daemon that was not heard for this long is gone [s]; it publishes `control/status` once a second."""
SETTLING: Final = 1.0
"""Status from before the lease may still arrive for so long after it was granted [s]."""
GIVING_BACK: Final = 3.0
"""Longest wait for the answer when the lease is given back [s]; the end of the liveliness token ends it as well."""


class Lease:
    """The right to fly; made by `Vehicle.lease`.

    Attributes:
        holder: name others see.
        epoch: number of the lease; every setpoint carries it.
    """

    def __init__(self, transport: Transport, holder: str, epoch: int, statuses: AsyncIterator[Sample]) -> None:
        self.holder = holder
        self.epoch = epoch
        self._transport = transport
        self._statuses = statuses
        self._setpoints = Setpoints(transport, epoch)
        self._loop = asyncio.get_running_loop()
        self._taken_at = self._heard_at = self._loop.time()
        self._status: ControlStatus | None = None
        self._lost: str | None = None
        self._following: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Self:
        self._following = asyncio.create_task(self._follow(), name=f"lease {self.epoch}")
        return self

    async def __aexit__(self, *_: object) -> None:
        if self._following is not None:
            self._following.cancel()
        await asyncio.shield(self._give_back())

    async def _give_back(self) -> None:
        """Release the aircraft; what is refused, or not answered, has ended already."""
        with suppress(MkError):
            fields = {"action": "release", "epoch": self.epoch}
            await self._transport.command("do", "lease", fields, patience=GIVING_BACK)

    @property
    def setpoints(self) -> int:
        """Setpoints streamed so far."""
        return self._setpoints.sequence

    @property
    def is_engaged(self) -> bool:
        """Whether the daemon has begun to send what is streamed to the aircraft."""
        from mkdaemon.telemetry.control import Phase

        return self._lost is None and self._status is not None and self._status.phase in {Phase.FLYING, Phase.STALE}

    async def stick(
        self,
        *,
        throttle: float,
        pitch: float = 0.0,
        roll: float = 0.0,
        yaw: float = 0.0,
        seconds: float,
        rate: float = RATE,
    ) -> None:
        """Fly by sticks for some time.

        The first call streams neutral sticks at this throttle until the daemon engages; the time counts from then.
        Nothing is streamed after it returns: follow it with the next call, or the last sticks grow stale after 0.3 s,
        the daemon levels the aircraft, and takes the lease away after one second.

        Args:
            throttle: more lift positive [stick from the centre]; stock firmware takes the smaller of this and the
                pilot's.
            pitch: nose down positive [stick].
            roll: right side down positive [stick].
            yaw: nose left positive [stick].
            seconds: how long [s].
            rate: setpoints a second [Hz]; 50 unless given.

        Raises:
            LeaseLostError: somebody else took the lease, or the daemon let go of the aircraft; says why.
            NotEngagedError: the daemon did not begin to send sticks.
            CommandRejectedError: a stick is out of range.
        """
        sticks = {"pitch": pitch, "roll": roll, "yaw": yaw, "throttle": throttle}
        self._setpoints.check("stick", TTL, sticks)
        if not self.is_engaged:
            await self._engage(throttle, rate)
        await self._stream(sticks, seconds, rate)

    def set(self, kind: str = "stick", *, ttl: float = TTL, **fields: Any) -> None:
        """Send one setpoint; for programs that stream at their own rate, at least twice a second.

        Args:
            kind: last word of a key `setpoint/<kind>`.
            ttl: time after arrival at which it no longer holds [s]; 0.3 unless given.
            fields: of the setpoint, without epoch and sequence: for sticks `pitch`, `roll`, `yaw`, `throttle`.

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

        reply = (await self._transport.command("do", "lease", {"action": "renew", "epoch": self.epoch})).require()
        return LeaseState.model_validate(reply)

    async def _engage(self, throttle: float, rate: float) -> None:
        """Stream neutral sticks until the daemon engages."""
        neutral = {"pitch": 0.0, "roll": 0.0, "yaw": 0.0, "throttle": throttle}
        end = self._loop.time() + ENGAGING
        while not self.is_engaged:
            if self._loop.time() >= end:
                why = "it has not shown the lease" if self._status is None else self._status.reason
                msg = f"the daemon did not engage within {ENGAGING:g} s ({why}): see `mkctl get event/command`"
                raise NotEngagedError(msg)
            await self._stream(neutral, 1.0 / rate, rate)

    async def _stream(self, sticks: dict[str, float], seconds: float, rate: float) -> None:
        """Stream the same sticks at a steady rate; late setpoints are not made up for."""
        start = due = self._loop.time()
        while due < start + seconds:
            await asyncio.sleep(max(due - self._loop.time(), 0.0))
            self.set("stick", **sticks)
            due = max(due + 1.0 / rate, self._loop.time())
        await asyncio.sleep(max(start + seconds - self._loop.time(), 0.0))
        self._require_held()

    def _require_held(self) -> None:
        silence = self._loop.time() - self._heard_at
        if self._lost is None and silence > SILENCE:
            self._lost = f"the daemon has not been heard for {silence:.1f} s"
        if self._lost is not None:
            msg = f"the lease was lost: {self._lost}; see `mkctl get control/status event/failsafe`"
            raise LeaseLostError(msg)

    async def _follow(self) -> None:
        """Learn from `control/status` whether the lease is still held."""
        async for sample in self._statuses:
            self._heard_at = self._loop.time()
            self._status_arrived(sample.value)

    def _status_arrived(self, status: ControlStatus) -> None:
        if status.lease is not None and status.lease.epoch == self.epoch:
            self._status = status
        elif self._status is not None or self._heard_at - self._taken_at > SETTLING:
            self._lost = self._lost or status.reason


class Leasing(Transport):
    """Takes the lease."""

    @asynccontextmanager
    async def lease(
        self, *, force: bool = False, ttl: float | None = None, holder: str | None = None
    ) -> AsyncIterator[Lease]:
        """Hold the lease for as long as the context lasts; on leaving, however, it is given back at once.

        A liveliness token stands beside it: when this program dies, the daemon releases the aircraft.

        Args:
            force: take it from whoever holds it.
            ttl: life without setpoints or renewal, if shorter than configured [s].
            holder: name others see; else user, machine and process.

        Raises:
            CommandRejectedError: `lease_held` by somebody else, `busy`, `gate_shut`, `link_down`, ...; says what to do.
            MkError: no daemon speaks for this vehicle.
        """
        name = holder or client_name()
        fields: dict[str, Any] = {"action": "take", "holder": name, "force": force}
        if ttl is not None:
            fields["ttl"] = ttl
        async with self.token(name), self._watch_unchecked("control/status") as statuses:
            epoch = int((await self.command("do", "lease", fields)).require()["epoch"])
            async with Lease(self, name, epoch, statuses) as lease:
                yield lease
