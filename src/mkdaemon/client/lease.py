"""The right to fly, held by a program for as long as a context lasts."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, Any, Final, Literal

from mkdaemon.client.asking import client_name
from mkdaemon.client.setpoints import RATE, SIGHTING, SetpointStream, load_models
from mkdaemon.client.transport import Transport
from mkdaemon.errors import LeaseLostError, ManoeuvreError
from mkdaemon.telemetry.refusals import Token

if TYPE_CHECKING:
    from mkdaemon.telemetry.control import HolderGrant, LeaseState

LANDING: Final = 60.0
"""Longest time of a landing [s]; from 2 m it takes about ten."""
TAKING_OFF: Final = 30.0
"""Longest time of a take-off [s]; to 2 m it takes about nine."""
GOING: Final = 30.0
"""Longest time of a way [s]; it begins at the engagement."""
PROBES: Final = 3
"""Measurements of the path before it counts as slow: a busy machine is slow for a moment."""


class Lease(SetpointStream):
    """The right to fly; made by `uav.lease()`.

    Attributes:
        holder: name others see.
        epoch: number of the lease; every setpoint carries it.
        set: sends one setpoint; for programs that stream at their own rate, at least twice a second.
    """

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
            LeaseLostError: another client took the lease, or the daemon released the aircraft; says why.
            NotEngagedError: the daemon did not begin to send sticks.
            CommandRejectedError: a stick is out of range.
        """
        sticks = {"pitch": pitch, "roll": roll, "yaw": yaw, "throttle": throttle}
        await self._fly("stick", sticks, {**sticks, "pitch": 0.0, "roll": 0.0, "yaw": 0.0}, seconds, rate)

    async def attitude(
        self,
        *,
        pitch: float = 0.0,
        roll: float = 0.0,
        yaw_rate: float = 0.0,
        thrust: float = 1.0,
        seconds: float,
        rate: float = RATE,
    ) -> None:
        """Fly by attitude for some time; engages like `stick`, with a level attitude.

        The FlightCtrl's own idea of level drifts while the aircraft accelerates (docs/control.md): nothing here holds
        a place.

        Args:
            pitch: nose down positive [rad].
            roll: right side down positive [rad].
            yaw_rate: nose left positive [rad/s].
            thrust: share of the weight; 1 carries the aircraft when level.
            seconds: how long [s].
            rate: setpoints a second [Hz]; 50 unless given.

        Raises:
            LeaseLostError: as `stick`.
            NotEngagedError: as `stick`.
            CommandRejectedError: a number is out of range.
        """
        wanted = {"pitch": pitch, "roll": roll, "yaw_rate": yaw_rate, "thrust": thrust}
        await self._fly("attitude", wanted, {**wanted, "pitch": 0.0, "roll": 0.0, "yaw_rate": 0.0}, seconds, rate)

    async def velocity(
        self,
        x: float,
        y: float,
        z: float,
        *,
        frame: Literal["pad", "body"] = "pad",
        yaw_rate: float = 0.0,
        seconds: float,
        rate: float = RATE,
    ) -> None:
        """Fly at a velocity against a target in sight, for some time; zero stays where the aircraft is.

        Args:
            x: along the first axis of `frame` [m/s].
            y: along the second [m/s].
            z: up [m/s].
            frame: `pad`, the axes of the target, or `body`, forward and left, turned level.
            yaw_rate: nose left positive [rad/s].
            seconds: how long from the engagement on [s].
            rate: setpoints a second [Hz]; 50 unless given.

        Raises:
            LeaseLostError: as `stick`; also because the target was out of sight for too long.
            NotEngagedError: the daemon did not begin to fly; says what it waited for.
            CommandRejectedError: `no_estimate`: no target was seen; `no_frame`; `bad_field`.
        """
        wanted = {"velocity": (x, y, z), "frame": frame, "yaw_rate": yaw_rate}
        await self._fly("velocity", wanted, wanted, seconds, rate, patience=SIGHTING)

    async def hold(self, *, seconds: float, rate: float = RATE) -> None:
        """Stay where the aircraft is over a target in sight, for some time.

        Args:
            seconds: how long from the engagement on [s].
            rate: setpoints a second [Hz]; 50 unless given.

        Raises:
            LeaseLostError: as `velocity`.
            NotEngagedError: as `velocity`.
            CommandRejectedError: as `velocity`.
        """
        await self._fly("hold", {}, {}, seconds, rate, patience=SIGHTING)

    async def take_off(
        self, height: float, *, target: str = "", patience: float = TAKING_OFF, rate: float = RATE
    ) -> None:
        """Take off from the target and hold over its middle; returns at that height.

        The pilot has started the motors. For `control.autopilot.takeoff_ready` seconds the throttle stays at its
        lowest, in which he raises his above hover.

        Args:
            height: above the target [m].
            target: its name; empty for the one in sight.
            patience: longest time [s].
            rate: setpoints a second [Hz]; 50 unless given.

        Raises:
            LeaseLostError: it did not take off; says why.
            NotEngagedError: the daemon did not begin; says what it waited for.
            ManoeuvreError: not at height in time, or aborted.
            CommandRejectedError: `bad_field`: the height is out of range.
        """
        await self._fly_until_done("takeoff", {"height": height, "target": target}, patience, rate)

    async def goto(
        self,
        x: float,
        y: float,
        z: float,
        *,
        yaw: float | None = None,
        frame: Literal["pad", "body"] = "pad",
        seconds: float | None = None,
        patience: float = GOING,
        rate: float = RATE,
    ) -> None:
        """Fly to a position over a target in sight; returns when the daemon reports arrival, or after `seconds`.

        Follow it with the next call: nothing is streamed after it returns.

        Args:
            x: from the middle of the target, to the right of its print [m].
            y: towards the top of its print [m].
            z: up [m].
            yaw: heading, counter-clockwise from x [rad]; None keeps the heading.
            frame: `pad`, or `body`: from where the aircraft is when the first of these setpoints arrives.
            seconds: fly there and hold for this long from the engagement on, without waiting for arrival [s].
            patience: longest time until arrival [s]; unused with `seconds`.
            rate: setpoints a second [Hz]; 50 unless given.

        Raises:
            LeaseLostError: as `velocity`.
            NotEngagedError: as `velocity`.
            ManoeuvreError: not there in time, or aborted.
            CommandRejectedError: as `velocity`.
        """
        wanted = {"position": (x, y, z), "frame": frame, "yaw": yaw}
        if seconds is None:
            await self._fly_until_done("position", wanted, patience, rate)
        else:
            await self._fly("position", wanted, wanted, seconds, rate, patience=SIGHTING)

    async def land(self, *, yaw: float | None = None, patience: float = LANDING, rate: float = RATE) -> None:
        """Land on the target in sight; returns when the feet stand and the daemon has released the aircraft.

        The motors still turn then: the pilot stops them. The lease has ended.

        Args:
            yaw: heading on the way down, counter-clockwise from the target's x [rad]; None keeps the heading.
            patience: longest time [s].
            rate: setpoints a second [Hz]; 50 unless given.

        Raises:
            LeaseLostError: the aircraft did not land; says why the daemon released it.
            ManoeuvreError: not landed in time, or aborted.
            NotEngagedError: as `velocity`.
            CommandRejectedError: as `velocity`.
        """
        from mkdaemon.telemetry.control import Outcome

        wanted = {"yaw": yaw}
        try:
            await self._fly("land", wanted, wanted, patience, rate, patience=SIGHTING)
        except LeaseLostError:
            if self.outcome is not Outcome.LANDED:
                raise
            return
        msg = f"not landed within {patience:g} s"
        raise ManoeuvreError(msg)


class Leases:
    """The right to fly: `async with uav.lease() as lease`. One program at a time holds it."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    @asynccontextmanager
    async def __call__(
        self, *, force: bool = False, ttl: float | None = None, holder: str | None = None, use_remembered: bool = False
    ) -> AsyncIterator[Lease]:
        """Hold the lease for as long as the context lasts; on leaving, however, it is given back at once.

        A liveliness token stands beside it: when this program dies, the daemon releases the aircraft.

        Args:
            force: take it from its present holder.
            ttl: life without setpoints or renewal, if shorter than configured [s].
            holder: name others see; else user, machine and process.
            use_remembered: confirms that a FlightCtrl that cannot be asked in flight is the one before; docs/link.md.

        Raises:
            CommandRejectedError: `lease_held` by somebody else, `busy`, `gate_shut`, `link_down`, ...; says what to do.
            MkError: no daemon speaks for this vehicle.
        """
        load_models()
        name = holder or client_name()
        watch = self._transport.watch("control/status", "event/command", are_known=True)
        async with self._transport.token(name), watch as statuses:
            granted = await self.take(force=force, ttl=ttl, holder=name, use_remembered=use_remembered)
            async with Lease(self._transport, name, granted, statuses) as lease:
                yield lease

    async def take(
        self, *, force: bool = False, ttl: float | None = None, holder: str | None = None, use_remembered: bool = False
    ) -> HolderGrant:
        """Take the lease without a context: it ends by itself when nothing follows. Arguments as for `uav.lease()`.

        The daemon measures the path to this program first, and grants none over a slow one.

        Args:
            force: see `uav.lease()`.
            ttl: see `uav.lease()`.
            holder: see `uav.lease()`.
            use_remembered: see `uav.lease()`.

        Raises:
            CommandRejectedError: as `uav.lease()`.
            MkError: no daemon speaks for this vehicle.
        """
        from mkdaemon.telemetry.control import HolderGrant

        fields: dict[str, Any] = {"action": "take", "holder": holder or client_name(), "force": force}
        if ttl is not None:
            fields["ttl"] = ttl
        if use_remembered:
            fields["use_remembered"] = True
        for _ in range(PROBES):
            # A daemon that knows no probe answers without an echo, and measures nothing.
            probe = await self._transport.command("do", "lease", {"action": "probe"})
            echo = {"echo": probe.reply["echo"]} if "echo" in probe.reply else {}
            answer = await self._transport.command("do", "lease", {**fields, **echo})
            if answer.token != Token.SLOW_PATH:
                break
        return answer.as_a(HolderGrant)

    async def release(self, epoch: int, secret: str) -> None:
        """Give back a lease that was taken without a context; the aircraft is released.

        Args:
            epoch: as `take` returned it.
            secret: as `take` returned it.

        Raises:
            CommandRejectedError: no client holds it, or another one does.
            MkError: no daemon speaks for this vehicle.
        """
        fields = {"action": "release", "epoch": epoch, "secret": secret}
        (await self._transport.command("do", "lease", fields)).require()

    async def show(self) -> LeaseState | None:
        """The lease and its holder; None if no client holds it.

        Raises:
            MkError: no daemon speaks for this vehicle.
        """
        from mkdaemon.telemetry.control import LeaseState

        answer = await self._transport.command("do", "lease", {"action": "show"})
        return answer.as_a(LeaseState) if answer.require() else None
