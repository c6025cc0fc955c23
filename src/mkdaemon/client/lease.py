"""The right to fly, held by a program for as long as a context lasts."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager, suppress
from typing import TYPE_CHECKING, Any, Final, Literal, Self

from mkdaemon.client.asking import client_name
from mkdaemon.client.samples import Sample, typed_value
from mkdaemon.client.session import (
    ENGAGING,
    PAUSE,
    RATE,
    SIGHTING,
    TTL,
    FlightSession,
    RepeatedSetpoint,
    setpoint_models,
)
from mkdaemon.client.setpointcalls import SetpointCalls
from mkdaemon.client.transport import SetpointPublisher, Transport
from mkdaemon.errors import CommandRejectedError, LeaseLostError, ManoeuvreError, MkError, ProtocolError
from mkdaemon.telemetry.refusals import Token

if TYPE_CHECKING:
    from pydantic import BaseModel

    from mkdaemon.telemetry.control import ControlStatus, HolderGrant, LeaseState, Outcome
    from mkdaemon.telemetry.path import PathStored, PathUploadRequest
    from mkdaemon.telemetry.setpoint import Setpoint

LANDING: Final = 60.0
"""Longest time of a landing [s]; from 2 m it takes about ten."""
TAKING_OFF: Final = 30.0
"""Longest time of a take-off [s]; to 2 m it takes about nine."""
GOING: Final = 30.0
"""Longest time of a way [s]; it begins at the engagement."""
PROBES: Final = 3
"""Measurements of the path before it counts as slow: a busy machine is slow for a moment."""


GIVING_BACK: Final = 3.0
"""Longest wait for the answer when the lease is given back [s]; the end of the liveliness token ends it as well."""


class SetpointSender:
    """Signs setpoints of one lease and puts them."""

    def __init__(self, transport: Transport, grant: HolderGrant) -> None:
        self._transport, self._grant = transport, grant
        self._publishers: dict[str, tuple[SetpointPublisher, str]] = {}

    def send(self, setpoint: Setpoint) -> None:
        """Put one."""
        from mkdaemon.bus.codec import encode, encoding_of
        from mkdaemon.telemetry.signature import sign, stamped_proof

        suffix, secret = setpoint.suffix, self._grant.secret
        if suffix not in self._publishers:
            publisher = self._transport.stream(f"{self._grant.setpoint_root}/{setpoint.kind}")
            self._publishers[suffix] = (publisher, encoding_of(type(setpoint)))
        publisher, encoding = self._publishers[suffix]
        payload, is_stamped = encode(setpoint), self._grant.takes_stamps
        proof = (
            stamped_proof(secret, suffix, payload, time.monotonic()) if is_stamped else sign(secret, suffix, payload)
        )
        publisher.put(payload, encoding=encoding, attachment=proof)


def load_models() -> None:
    """Import what a lease needs.

    Done before it is asked for: imports take up to a second, in which setpoints would grow stale, and what the daemon
    said before the lease would seem to be said after it.
    """
    import mkdaemon.telemetry.signature  # noqa: F401
    from mkdaemon.telemetry.control import ControlStatus, HolderGrant
    from mkdaemon.telemetry.event import CommandEvent

    models: list[type[BaseModel]] = [*setpoint_models().values(), ControlStatus, CommandEvent, HolderGrant]
    for model in models:
        model.model_rebuild()
    typed_value(None, {})


class Lease:
    """The right to fly; made by `uav.lease()`.

    Attributes:
        holder: name others see.
        epoch: number of the lease; every setpoint carries it.
        session: decides what is streamed.
        set: sends one setpoint; for programs that stream at their own rate, at least twice a second.
    """

    def __init__(
        self, transport: Transport, holder: str, session: FlightSession, statuses: AsyncIterator[Sample]
    ) -> None:
        assert session.grant is not None
        self.holder, self.epoch, self.session = holder, session.grant.epoch, session
        self.set = SetpointCalls(self.put)
        self._transport, self._statuses = transport, statuses
        self._sender = SetpointSender(transport, session.grant)
        self._loop = asyncio.get_running_loop()
        self._following: asyncio.Task[None] | None = None
        self._path: dict[str, Any] = {}

    async def __aenter__(self) -> Self:
        self._following = asyncio.create_task(self._follow(), name=f"lease {self.epoch}")
        return self

    async def __aexit__(self, *_: object) -> None:
        if self._following is not None:
            self._following.cancel()
        await asyncio.shield(self._give_back())

    async def _give_back(self) -> None:
        """Release the aircraft; nothing where the daemon has said that this lease is over, as after a landing."""
        if (fields := self.session.release()) is not None:
            with suppress(MkError):
                await self._transport.command("do", "lease", fields, patience=GIVING_BACK)

    async def _follow(self) -> None:
        """Let the session know what the daemon reports."""
        async for sample in self._statuses:
            with suppress(ProtocolError):  # put there by another program than the daemon
                value, now = sample.value, self._loop.time()
                if sample.suffix == "control/status":
                    self.session.status_arrived(value, now)
                else:
                    self.session.event_arrived(value, now)

    @property
    def setpoints(self) -> int:
        """Number of setpoints streamed."""
        return self.session.sequence

    @property
    def is_engaged(self) -> bool:
        """Whether the daemon sends the streamed setpoints to the aircraft."""
        return self.session.is_engaged

    @property
    def status(self) -> ControlStatus | None:
        """The daemon's last status of this lease: phase, manoeuvre, stage; None before the first one."""
        return self.session.status

    @property
    def outcome(self) -> Outcome | None:
        """How the manoeuvre ended; None before."""
        return self.session.outcome

    @property
    def reason(self) -> str:
        """The reason of the present state, one sentence, for example what the daemon waits for."""
        return self.session.reason

    def put(self, kind: str, fields: Mapping[str, Any], ttl: float = TTL) -> None:
        """Send one setpoint by the name of its kind, for gateways; programs use `set`.

        Args:
            kind: last word of a key `setpoint/<kind>`.
            fields: of the setpoint, without epoch and sequence.
            ttl: age from which it is refused [s].

        Raises:
            LeaseLostError: the lease has ended; the text says why.
            CommandRejectedError: `bad_field`: a field is missing, unknown or out of range.
            MkError: there is no such kind of setpoint.
        """
        self.send(self.session.stream(kind, fields, self._loop.time(), ttl))

    def send(self, setpoint: Setpoint | None) -> None:
        """Sign a setpoint of the session, and put it; None does nothing."""
        if setpoint is not None:
            self._sender.send(setpoint)

    async def renew(self) -> LeaseState:
        """Keep the lease without streaming; it would expire otherwise.

        Raises:
            LeaseLostError: it has ended; the text says why.
            CommandRejectedError: it has ended.
        """
        from mkdaemon.telemetry.control import LeaseState

        fields = self.session.renew(self._loop.time())
        return (await self._transport.command("do", "lease", fields)).as_a(LeaseState)

    async def pause(self, seconds: float) -> None:
        """Keep the lease for a time without flying [s]; not in flight, where setpoints would grow stale.

        Raises:
            LeaseLostError: it has ended.
            CommandRejectedError: it has ended.
        """
        await self.renew()
        await asyncio.sleep(seconds)
        self.session.require_held(self._loop.time())

    async def fly(self, wanted: RepeatedSetpoint) -> None:
        """Repeat a setpoint for its time, or until it is done. This also ends a reported abort.

        Raises:
            LeaseLostError: the lease has ended; the text says why.
            NotEngagedError: the daemon did not engage.
            ManoeuvreError: not done in time, aborted, or another setpoint replaced it.
            CommandRejectedError: a setpoint is refused.
        """
        session, clock = self.session, self._loop.time
        session.require_held(clock())
        session.resume()
        session.fly(wanted, clock())
        while session.repeated is wanted:
            now = clock()
            # With sticks flown already a refusal counts at once: the estimate does not restart.
            if not session.is_engaged:
                session.has_started(now)
            setpoint = session.step(now)
            if session.is_engaged and (refusal := session.take_refusal()) is not None:
                raise refusal
            self.send(setpoint)
            if setpoint is not None:
                await asyncio.sleep(max(session.due - clock(), 0.0))
        session.require_held(clock())
        if session.finished is not wanted:
            raise ManoeuvreError(f"{wanted.kind}: another setpoint replaced it")

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
            LeaseLostError: another client took the lease, or the daemon released the aircraft; the text says why.
            NotEngagedError: the daemon did not begin to send sticks.
            CommandRejectedError: a stick is out of range.
        """
        sticks = {"pitch": pitch, "roll": roll, "yaw": yaw, "throttle": throttle}
        lead = {**sticks, "pitch": 0.0, "roll": 0.0, "yaw": 0.0}
        await self.fly(RepeatedSetpoint("stick", sticks, ENGAGING, seconds, rate, lead=lead))

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

        The FlightCtrl's estimate of level drifts while the aircraft accelerates (docs/control.md), and the position is
        not held.

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
        lead = {**wanted, "pitch": 0.0, "roll": 0.0, "yaw_rate": 0.0}
        await self.fly(RepeatedSetpoint("attitude", wanted, ENGAGING, seconds, rate, lead=lead))

    async def velocity(
        self,
        x: float,
        y: float,
        z: float,
        *,
        frame: Literal["pad", "body"] = "pad",
        yaw_rate: float = 0.0,
        target: str = "",
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
            target: its name; empty for the one in sight.
            seconds: how long from the engagement on [s].
            rate: setpoints a second [Hz]; 50 unless given.

        Raises:
            LeaseLostError: as `stick`; also if the target was out of sight for too long.
            NotEngagedError: the daemon did not begin to fly; the text names what it waited for.
            CommandRejectedError: `no_estimate`: no target was seen; `no_frame`; `bad_field`.
        """
        wanted = {"velocity": (x, y, z), "frame": frame, "yaw_rate": yaw_rate, "target": target}
        await self.fly(RepeatedSetpoint("velocity", wanted, SIGHTING, seconds, rate))

    async def hold(self, *, target: str = "", seconds: float, rate: float = RATE) -> None:
        """Stay where the aircraft is over a target in sight, for some time.

        Args:
            target: its name; empty for the one in sight.
            seconds: how long from the engagement on [s].
            rate: setpoints a second [Hz]; 50 unless given.

        Raises:
            LeaseLostError: as `velocity`.
            NotEngagedError: as `velocity`.
            CommandRejectedError: as `velocity`.
        """
        await self.fly(RepeatedSetpoint("hold", {"target": target}, SIGHTING, seconds, rate))

    async def take_off(
        self, height: float, *, target: str = "", patience: float = TAKING_OFF, rate: float = RATE
    ) -> None:
        """Take off from the target and hold over its middle; returns at that height.

        The pilot has started the motors. For `control.autopilot.takeoff_ready` seconds the throttle stays at its
        lowest; meanwhile the pilot raises the throttle stick above hover.

        Args:
            height: above the target [m].
            target: its name; empty for the one in sight.
            patience: longest time [s].
            rate: setpoints a second [Hz]; 50 unless given.

        Raises:
            LeaseLostError: it did not take off; the text says why.
            NotEngagedError: the daemon did not begin; the text names what it waited for.
            ManoeuvreError: not at height in time, or aborted.
            CommandRejectedError: `bad_field`: the height is out of range.
        """
        wanted = {"height": height, "target": target}
        await self.fly(RepeatedSetpoint("takeoff", wanted, SIGHTING, patience, rate, is_until_done=True))

    async def goto(
        self,
        x: float,
        y: float,
        z: float,
        *,
        yaw: float | None = None,
        frame: Literal["pad", "body"] = "pad",
        target: str = "",
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
            target: its name; empty for the one in sight.
            seconds: fly there and hold for this long from the engagement on, without waiting for arrival [s].
            patience: longest time until arrival [s]; unused with `seconds`.
            rate: setpoints a second [Hz]; 50 unless given.

        Raises:
            LeaseLostError: as `velocity`.
            NotEngagedError: as `velocity`.
            ManoeuvreError: not there in time, or aborted.
            CommandRejectedError: as `velocity`.
        """
        wanted = {"position": (x, y, z), "frame": frame, "yaw": yaw, "target": target}
        is_free = seconds is None
        limit = patience if seconds is None else seconds
        await self.fly(RepeatedSetpoint("position", wanted, SIGHTING, limit, rate, is_until_done=is_free))

    async def land(
        self, *, yaw: float | None = None, target: str = "", patience: float = LANDING, rate: float = RATE
    ) -> None:
        """Land on the target in sight; returns after touchdown, when the daemon has released the aircraft.

        The motors still turn then: the pilot stops them. The lease has ended.

        Args:
            yaw: heading on the way down, counter-clockwise from the target's x [rad]; None keeps the heading.
            target: its name; empty for the one in sight.
            patience: longest time [s].
            rate: setpoints a second [Hz]; 50 unless given.

        Raises:
            LeaseLostError: the aircraft did not land; says why the daemon released it.
            ManoeuvreError: not landed in time, or aborted.
            NotEngagedError: as `velocity`.
            CommandRejectedError: as `velocity`.
        """
        from mkdaemon.telemetry.control import Outcome

        try:
            await self.fly(RepeatedSetpoint("land", {"yaw": yaw, "target": target}, SIGHTING, patience, rate))
        except LeaseLostError:
            if self.outcome is not Outcome.LANDED:
                raise
            return
        raise ManoeuvreError(f"not landed within {patience:g} s")

    async def follow(
        self,
        path: PathUploadRequest | PathStored,
        *,
        target: str = "",
        patience: float = math.inf,
        rate: float = RATE,
    ) -> None:
        """Fly along a path over a target in sight; returns when the aircraft is at its end.

        It flies to the first point before. Meanwhile another task may call `pause_path` and `resume_path`. A path that
        is not uploaded yet is, and that takes a moment: in flight, upload it before (`uav.paths.upload`).

        Args:
            path: points or pieces, or what `uav.paths.upload` has answered.
            target: in whose axes the path lies; empty for the one in sight.
            patience: longest time, pauses included [s]; without it the daemon alone ends a flight that is too slow.
            rate: setpoints a second [Hz]; 50 unless given.

        Raises:
            LeaseLostError: as `velocity`.
            NotEngagedError: as `velocity`.
            ManoeuvreError: not at the end in time, or aborted.
            CommandRejectedError: `path_refused`: this aircraft cannot fly it, and why; `no_path`: the daemon has
                restarted since it was uploaded; else as `velocity`.
        """
        from mkdaemon.telemetry.path import PathStored

        if not isinstance(path, PathStored):
            fields = path.model_dump(exclude_defaults=True)
            path = (await self._transport.command("do", "path_upload", fields)).as_a(PathStored)
        run = self._path.get("run", 0) + 1
        self._path = {"path": path.id, "run": run, "target": target, "paused": False}
        await self.fly(RepeatedSetpoint("path", self._path, SIGHTING, patience, rate, is_until_done=True))

    def pause_path(self) -> None:
        """Let the aircraft stop on the path that `follow` flies, and hold there.

        Raises:
            ManoeuvreError: no path is flown.
        """
        self._pause(is_paused=True)

    def resume_path(self) -> None:
        """Go on along the path after `pause_path`.

        Raises:
            ManoeuvreError: no path is flown.
        """
        self._pause(is_paused=False)

    def _pause(self, *, is_paused: bool) -> None:
        flown = self.session.repeated
        if flown is None or flown.fields is not self._path:
            raise ManoeuvreError("no path is flown: call `lease.follow` in another task")
        self._path["paused"] = is_paused  # of the setpoint that is repeated, too


class Leases:
    """The right to fly: `async with uav.lease() as lease`. One program at a time holds it."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    @asynccontextmanager
    async def __call__(
        self,
        session: FlightSession | None = None,
        /,
        *,
        force: bool = False,
        ttl: float | None = None,
        holder: str | None = None,
        use_remembered: bool = False,
    ) -> AsyncIterator[Lease]:
        """Hold the lease for as long as the context lasts; on leaving, however, it is given back at once.

        A liveliness token stands beside it: when this program dies, the daemon releases the aircraft.

        Args:
            session: decides what is streamed, and outlives this lease; a new one where None.
            force: take it from its present holder.
            ttl: life without setpoints or renewal, if shorter than configured [s].
            holder: name others see; else user, machine and process.
            use_remembered: confirms that a FlightCtrl that cannot be asked in flight is the one before; docs/link.md.

        Raises:
            CommandRejectedError: `lease_held`, `gate_shut`, ...; what may pass, as `link_down`, after asking for 2 s.
            MkError: no daemon serves this vehicle.
        """
        load_models()
        session, name = session or FlightSession(), holder or client_name()
        session.take()
        watch = self._transport.watch("control/status", "event/command", are_known=True)
        async with self._transport.token(name), watch as statuses:
            granted = None
            while granted is None:
                try:
                    granted = await self.take(force=force, ttl=ttl, holder=name, use_remembered=use_remembered)
                except CommandRejectedError as error:
                    if not session.refused(error):
                        raise
                    await asyncio.sleep(PAUSE)
            session.granted(granted, asyncio.get_running_loop().time())
            async with Lease(self._transport, name, session, statuses) as lease:
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
            MkError: no daemon serves this vehicle.
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
            MkError: no daemon serves this vehicle.
        """
        fields = {"action": "release", "epoch": epoch, "secret": secret}
        (await self._transport.command("do", "lease", fields)).require()

    async def show(self) -> LeaseState | None:
        """The lease and its holder; None if no client holds it.

        Raises:
            MkError: no daemon serves this vehicle.
        """
        from mkdaemon.telemetry.control import LeaseState

        answer = await self._transport.command("do", "lease", {"action": "show"})
        return answer.as_a(LeaseState) if answer.require() else None
