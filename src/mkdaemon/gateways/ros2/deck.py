"""The command source of the gateway: a pad, a topic of setpoints, or a verb; one at a time, under one lease."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import structlog

from mkdaemon.client import Lease, Vehicle
from mkdaemon.client.leasekeeper import LeaseKeeper
from mkdaemon.client.session import SessionState
from mkdaemon.client.teleop.inputs import PadFacts
from mkdaemon.client.teleop.teleop import Teleop, TeleopOutput
from mkdaemon.config.gamepad import Gamepad
from mkdaemon.errors import MkError
from mkdaemon.gateways.ros2.commands import CommandStream
from mkdaemon.telemetry.path import PathUploadRequest

PERIOD: Final = 0.02
"""Between two looks while something is flown, or a pad is there [s]."""
PAD_GONE: Final = 3.0
"""A pad is forgotten after this silence [s]; its sticks are neutral after 0.25 s, and released after 0.9 s."""
PROOF: Final = 0.2
"""A hold has begun once it has been flown for this time [s]."""
PAD: Final = "joy"
HOLD: Final = "hold"

Manoeuvre = Callable[[Lease], Awaitable[None]]
_log = structlog.get_logger("gateway.ros2")


@dataclass(frozen=True, slots=True)
class Habits:
    """How the gateway flies.

    Attributes:
        mapping: of the pad.
        facts: what the pad is.
        hold_for: how long it holds a place without a new command before it lands [s].
        take_off_height: above the target [m].
    """

    mapping: Gamepad
    facts: PadFacts
    hold_for: float
    take_off_height: float


class FlightDeck:
    """Chooses the command source, holds the lease while there is one, and returns it afterwards.

    Attributes:
        flown: the command source: `joy`, the name of a topic or of a verb; empty for none.
        note: what happened last that a person should know.
        velocity: the topic `cmd_vel`.
        pose: the topic `setpoint_pose`.
    """

    def __init__(self, uav: Vehicle, habits: Habits, newest: Mapping[str, Any]) -> None:
        self.flown = self.note = ""
        self.velocity, self.pose = CommandStream("cmd_vel"), CommandStream("setpoint_pose")
        self._uav, self._habits, self._newest = uav, habits, newest
        self._keeper = LeaseKeeper(uav.lease)
        self._teleop = Teleop()
        self._pad_at = 0.0
        self._verb: asyncio.Task[None] | None = None
        self._stopping: asyncio.Task[None] | None = None
        self._paths: set[asyncio.Task[None]] = set()
        self._news = asyncio.Event()
        self._loop = asyncio.get_running_loop()

    @property
    def words(self) -> str:
        """What is flown and what happened last, one line."""
        lease = self._keeper.flight.reason
        who = f"{self.flown} flies" if self.flown else "no client flies through the gateway"
        return "; ".join(part for part in (who, lease, self.note) if part)

    async def run(self) -> None:
        """Look after what is flown, for ever; on leaving the lease is given back."""
        try:
            while True:
                if self.flown or self._teleop.hands:
                    await asyncio.sleep(PERIOD)
                else:
                    self._news.clear()
                    await self._news.wait()
                self._tick()
        finally:
            self._end_verb("the gateway ends")
            await self._keeper.close()

    def _tick(self) -> None:
        now = self._loop.time()
        if self._teleop.hands:
            if now - self._pad_at > PAD_GONE:
                self._teleop.detach(PAD, "the pad of joy has not been heard for 3 s")
            self._fly_by_hand(now)
        for stream in (self.velocity, self.pose):
            if self.flown == stream.name and stream.is_gone(now):
                self._let_go(f"{stream.name} has been silent too long")

    # -- hands ------------------------------------------------------------------------------------------------------

    def pad_arrived(self, state: Mapping[str, float], age: float) -> None:
        """Take the state of the pad.

        Args:
            state: raw values by control.
            age: how old it was when it came [s].
        """
        now = self._pad_at = self._loop.time()
        if PAD not in self._teleop.hands:
            self._teleop.attach(PAD, self._habits.mapping, self._habits.facts, now)
        hands = self._teleop.hands[PAD]
        hands.inputs.reported_at = now
        hands.asked(state, now - age)
        self._fly_by_hand(now)
        self._news.set()

    def _fly_by_hand(self, now: float) -> None:
        flight = self._newest.get("state/flight")
        stands = None if flight is None or flight.is_flying is None else not flight.is_flying
        output = self._teleop.tick(now, is_engaged=self._keeper.is_engaged, is_on_ground=stands)
        if output.stop_motors:
            self._stopping = asyncio.create_task(self._stop_motors(), name="ros2 stop")
        if output.let_go:
            self._let_go(output.reason)
        if output.setpoint is not None:
            self._carry_out(output)
        elif self.flown == PAD:
            self.flown = ""
        if self._teleop.hands and not self.flown:
            self.note = output.reason

    def _carry_out(self, output: TeleopOutput) -> None:
        assert output.setpoint is not None
        if self.flown != PAD:
            self._end_verb("the pad of joy takes over")
            self._shut_streams()
            self.flown = PAD
        if self._put(output.setpoint.kind, output.setpoint.fields) and self._take_refusal():
            self._teleop.refused()

    async def _stop_motors(self) -> None:
        try:
            await self._uav.stop()
            self._write_note("motors: asked to stop; only telemetry shows whether they have stopped")
        except MkError as error:
            self._write_note(str(error))

    # -- streams ----------------------------------------------------------------------------------------------------

    def command_arrived(self, stream: CommandStream, kind: str, fields: Mapping[str, Any]) -> None:
        """Take a setpoint of a topic; it is put at once, or dropped while another source flies.

        Args:
            stream: the topic.
            kind: last word of a key `setpoint/<kind>`.
            fields: of the setpoint.
        """
        if not stream.arrived(self._loop.time()):
            return
        if self.flown not in {"", HOLD, stream.name}:
            self._write_note(f"{stream.name} is left out: {self.flown} flies")
            return
        if self.flown == HOLD:
            self._end_verb(f"{stream.name} takes over")
        self.flown = stream.name
        self._news.set()
        if self._put(kind, fields):
            self._take_refusal()

    def refused(self, reason: str) -> None:
        """Take note of a message that cannot be flown."""
        self._write_note(reason)

    def _put(self, kind: str, fields: Mapping[str, Any]) -> bool:
        """Put a setpoint; whether the lease is still ours, or on its way."""
        try:
            if self._keeper.flight.state is SessionState.FREE:
                self._keeper.begin()
            self._keeper.stream(kind, fields)
        except MkError as error:
            if not self._keeper.flight.is_wanted:
                self._let_go(str(error))
                return False
            self._write_note(str(error))  # the setpoint is none, the lease is held
        return True

    def _take_refusal(self) -> bool:
        refusal = self._keeper.flight.take_refusal()
        if refusal is not None:
            self._write_note(str(refusal))
        return refusal is not None

    def _shut_streams(self) -> None:
        self.velocity.ended()
        self.pose.ended()

    # -- verbs ------------------------------------------------------------------------------------------------------

    async def take_off(self) -> str:
        """Take off, and hold.

        Raises:
            MkError: it was refused, or ended on the way.
        """
        height = self._habits.take_off_height
        await self._fly("take_off", lambda lease: lease.take_off(height))
        return f"at {height:g} m; {self._begin_hold()}"

    async def hold(self) -> str:
        """Hold the place where the aircraft is.

        Raises:
            MkError: it was refused, or ended on the way.
        """
        await self._fly(HOLD, lambda lease: lease.hold(seconds=PROOF))
        return self._begin_hold()

    def path_arrived(self, path: PathUploadRequest) -> None:
        """Fly along a path of the topic `path`, in place of the one before, and hold at its end."""
        flying = asyncio.create_task(self._follow(path), name="ros2 path")
        self._paths.add(flying)
        flying.add_done_callback(self._paths.discard)

    async def _follow(self, path: PathUploadRequest) -> None:
        try:
            await self._fly("path", lambda lease: lease.follow(path))
            self._write_note(f"at the end of the path; {self._begin_hold()}")
        except MkError as error:
            self._write_note(str(error))

    async def land(self) -> str:
        """Land on the target in sight.

        Raises:
            MkError: it was refused, or ended on the way; where the aircraft is still flown it holds.
        """
        await self._fly("land", lambda lease: lease.land())
        self._let_go("landed")
        return "landed, and released: the pilot stops the motors"

    async def release(self) -> str:
        """Release the aircraft from any client.

        Raises:
            MkError: no daemon serves this vehicle.
        """
        self._let_go("released, as asked for")
        report = await self._uav.release("asked for in ROS")
        return f"{report.status.value}: {report.confirmed} of {report.sent} frames confirmed"

    async def _fly(self, name: str, manoeuvre: Manoeuvre) -> None:
        """Fly a manoeuvre to its end; nothing but another verb, the pad or a release interrupts it.

        Raises:
            MkError: it was refused, or ended on the way.
        """
        if self.flown == PAD:
            raise MkError("the pad of joy flies: release its enable button first")
        self._end_verb(f"{name} was asked for")
        self._shut_streams()
        self.flown = name
        self._news.set()
        self._verb = task = asyncio.create_task(self._flown(manoeuvre), name=f"ros2 {name}")
        try:
            await task
        except asyncio.CancelledError:
            if not task.cancelled():
                raise
            raise MkError(f"{name} was interrupted: {self.note}") from None
        except MkError as error:
            if self._verb is task:
                self._write_note(str(error))
                if self._keeper.is_engaged:
                    self._begin_hold()
                else:
                    self._let_go(str(error))
            raise

    async def _flown(self, manoeuvre: Manoeuvre) -> None:
        await manoeuvre(await self._keeper.take())

    def _begin_hold(self) -> str:
        self.flown = HOLD
        self._verb = asyncio.create_task(self._hold_then_land(), name="ros2 hold")
        return f"holds for {self._habits.hold_for:g} s, then lands, unless something else is flown"

    async def _hold_then_land(self) -> None:
        try:
            lease = await self._keeper.take()
            await lease.hold(seconds=self._habits.hold_for)
            self._write_note("no new command during the hold: it lands")
            await lease.land()
            self._let_go("landed")
        except MkError as error:
            self._let_go(str(error))

    def _end_verb(self, reason: str) -> None:
        task, self._verb = self._verb, None
        if task is not None and not task.done() and task is not asyncio.current_task():
            self._write_note(reason)
            task.cancel()

    def _let_go(self, reason: str) -> None:
        """End whatever is flown and give the lease back; commands that still come must fall silent first."""
        self._write_note(reason)
        self._end_verb(reason)
        self._shut_streams()
        self._teleop.ended(reason)
        self.flown = ""
        self._keeper.give_back()

    def _write_note(self, words: str) -> None:
        if words != self.note:
            self.note = words
            _log.info("note", words=words)
