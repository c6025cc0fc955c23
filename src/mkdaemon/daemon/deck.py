"""The flight core, with what stands between it, the frames of the line and the bus: on an aircraft and in a replay.

Nothing here waits or looks at a clock to decide: frames and events come in with their time, and what the core wants
published is stamped with the time of its tick.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from mkdaemon.bus.codec import Payload, check_command, decode_map
from mkdaemon.clock import Clock
from mkdaemon.config.control import ControlConfig
from mkdaemon.config.positions import PositionSource
from mkdaemon.control.actions import (
    Action,
    PublishError,
    PublishEstimate,
    PublishNavi,
    PublishPath,
    PublishStatus,
    Report,
    SendSticks,
)
from mkdaemon.control.core import FlightCore
from mkdaemon.control.events import Event, Feed, Reply, SetpointAccepted, SetpointUnreadable, SetpointUnsigned
from mkdaemon.daemon.audit import Audit, Outlet
from mkdaemon.daemon.eyes import Eyes
from mkdaemon.daemon.positions import PositionSources
from mkdaemon.daemon.sink import BusSink
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.control import ControlError, ControlEstimate, ControlOutput, ControlStatus
from mkdaemon.telemetry.navi import ControlNavi
from mkdaemon.telemetry.path import PathFlown
from mkdaemon.telemetry.preflight import ControlPreflight, PreflightReport
from mkdaemon.telemetry.setpoint import Setpoint
from mkdaemon.telemetry.signature import HolderKey, Signature

if TYPE_CHECKING:
    from mkdaemon.record.tap import Tap

MakeEyes = Callable[[Feed], Eyes]
"""Makes the cameras, which tell the flight core what they see."""
Publication = PublishStatus | PublishEstimate | PublishNavi | PublishPath | PublishError | Report
"""What the flight core wants published."""


class RecordedCore(FlightCore):
    """A flight core whose events and ticks are all recorded."""

    def __init__(self, cfg: ControlConfig, *, first_epoch: int, tap: Tap) -> None:
        """Start as `FlightCore` does; `tap` records."""
        super().__init__(cfg, first_epoch=first_epoch)
        self._tap = tap

    def feed(self, event: Event, now: float) -> Reply:
        """Take an event; see `FlightCore.feed`. It is recorded with the answer, and even if the core fails on it."""
        reply: Reply | None = None
        try:
            reply = super().feed(event, now)
        finally:
            self._tap.fed(event, now, reply)
        return reply

    def tick(self, now: float, *, slept: float = 0.0) -> list[Action]:
        """Decide; see `FlightCore.tick`."""
        self._tap.ticked(now, slept)
        return super().tick(now, slept=slept)


def no_eyes(feed: Feed) -> Eyes:
    """Make no camera."""
    return Eyes(None)


class Deck:
    """The core and what translates for it.

    Attributes:
        core: decides.
        audit: publishes events.
        eyes: the cameras.
        positions: sources of poses.
        sink: receives what the line reports.
        news: set when a tick is due at once.
        holder_key: identifies setpoints of the lease's holder; replaced as a whole, so any thread may read it.
    """

    def __init__(
        self,
        cfg: ControlConfig,
        bus: Outlet,
        clock: Clock,
        *,
        first_epoch: int,
        make_eyes: MakeEyes = no_eyes,
        positions: Sequence[PositionSource] = (),
        tap: Tap | None = None,
        core: FlightCore | None = None,
    ) -> None:
        """Build.

        Args:
            cfg: of the core.
            bus: where values go.
            clock: stamps.
            first_epoch: of the leases.
            make_eyes: makes the cameras.
            positions: sources of poses.
            tap: records the core's events.
            core: another one than the product's.
        """
        self._bus, self._clock = bus, clock
        if core is not None:
            self.core = core
        elif tap is None:
            self.core = FlightCore(cfg, first_epoch=first_epoch)
        else:
            self.core = RecordedCore(cfg, first_epoch=first_epoch, tap=tap)
        self.news = asyncio.Event()
        self.holder_key: HolderKey | None = None
        self.audit = Audit(bus, clock)
        self.eyes = make_eyes(self.feed)
        self.positions = PositionSources(positions, self.core, self.feed, self.audit, bus, clock)
        tilted = self.positions.attitude_received
        self.sink = BusSink(bus, self.feed, self.core.vehicle, self.audit, self.eyes, clock, tilted)

    def setpoint_arrived(
        self, kind: type[Setpoint], arrived: float, payload: Payload, signed_for: int | None
    ) -> CommandRejectedError | None:
        """Take a streamed setpoint; one that is refused is counted and reported.

        Args:
            kind: what the key carries.
            arrived: when it was sent, by our clock, where that is known; else when it arrived [s; monotonic].
            payload: as it came.
            signed_for: epoch of the lease whose holder signed it, see `signed_for`; None where he did not.

        Returns:
            Why it was refused; None where it was taken.
        """
        fields: dict[str, Any] = {"bytes": len(payload) if isinstance(payload, bytes) else payload.size}
        if signed_for is not None:
            fields["epoch"] = signed_for  # so that the holder knows it for its own
        try:
            fields = decode_map(payload)
            setpoint = check_command(kind, fields)
        except CommandRejectedError as error:
            unreadable = SetpointUnreadable(kind.suffix, fields, error, is_by_holder=signed_for is not None)
            return self.feed(unreadable, arrived).refusal
        event = SetpointUnsigned(setpoint) if signed_for is None else SetpointAccepted(setpoint, signed_for)
        return self.feed(event, arrived).refusal

    def signed_for(self, kind: type[Setpoint], payload: Payload, proof: bytes) -> int | None:
        """Epoch of the lease whose holder signed a setpoint; None where he did not. From any thread."""
        key = self.holder_key
        if key is None or not isinstance(payload, bytes):
            return None
        return key.epoch_signed(Signature(kind.suffix, payload, proof))

    def feed(self, event: Event, now: float) -> Reply:
        """Feed the core with an event at a time [s], and wake the control task if a tick is due."""
        reply = self.core.feed(event, now)
        self.holder_key = self.core.holder_key
        if reply.is_due:
            self.news.set()
        return reply

    def tick(self, now: float, *, slept: float) -> list[Action]:
        """Let the core decide; see `FlightCore.tick`."""
        actions = self.core.tick(now, slept=slept)
        self.holder_key = self.core.holder_key
        return actions

    def publish(self, action: Publication, now: float) -> None:
        """Publish what the core wants published, stamped with the time of its tick [s]."""
        bus, stamp = self._bus, self._clock.stamp(now)
        match action:
            case PublishStatus():
                bus.publish("control/status", ControlStatus(stamp=stamp, **action.__dict__))
            case PublishEstimate():
                bus.publish("control/estimate", ControlEstimate(stamp=stamp, **action.value.__dict__))
            case PublishNavi():
                bus.publish("control/navi", ControlNavi(stamp=stamp, **action.value.__dict__))
            case PublishPath():
                bus.publish("control/path", PathFlown(stamp=stamp, **action.value.__dict__))
            case PublishError():
                bus.publish("control/error", ControlError(stamp=stamp, **action.value.__dict__))
            case _:
                self.audit.report(action, now)

    def publish_output(self, order: SendSticks, frame: int, now: float) -> None:
        """Publish a stick frame that the line has taken under a number, stamped with the time of the tick [s]."""
        output = ControlOutput(
            stamp=self._clock.stamp(now),
            epoch=order.epoch,
            sequence=order.sequence,
            frame=frame,
            age=order.age,
            **order.counts._asdict(),
            limited=order.is_limited,
            wanted=order.wanted,
        )
        self._bus.publish("control/output", output)

    def publish_preflight(self, now: float) -> PreflightReport:
        """Ask the core for every check before a flight at a time [s]; publish and return what it found."""
        report = self.core.preflight(now)
        self._bus.publish("control/preflight", ControlPreflight(stamp=self._clock.stamp(now), **dict(report)))
        return report
