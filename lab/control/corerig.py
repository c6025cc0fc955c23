"""The same flights through the flight core: a client streams position setpoints, the core decides every stick frame."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Final

from lab.control.flights import Flight
from lab.control.rig import CONTROL_PERIOD, FIRST_HOVER, Rig, believed_model
from mkdaemon.config.control import ControlConfig, LimiterConfig
from mkdaemon.control.actions import Action, PublishEstimate, SendSticks
from mkdaemon.control.activeset import Gate, GateKind, KnownSet
from mkdaemon.control.core import FlightCore
from mkdaemon.control.estimator.values import GAS_CENTRE, TargetView
from mkdaemon.control.events import (
    LeaseAsked,
    LineChanged,
    LinkVerdict,
    ModelKnown,
    PoseSeen,
    SetpointAccepted,
    StateValue,
)
from mkdaemon.control.modes import IN_FLIGHT
from mkdaemon.control.regulator.autopilot import Goal
from mkdaemon.frames import quaternion_from_rotation
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.command import LeaseRequest
from mkdaemon.telemetry.control import ControlLine, EstimateValue
from mkdaemon.telemetry.link import LinkCondition, LinkState
from mkdaemon.telemetry.setpoint import PositionSetpoint, Setpoint, SetpointFrame, TakeOffSetpoint
from mkdaemon.telemetry.state import Attitude
from mkdaemon.telemetry.vision import VisionPose

CLIENT: Final = "lab"
SECRET: Final = "of the lab"


def stamp(at: float) -> Stamp:
    """A stamp in virtual time."""
    return Stamp(monotonic=at, wall=at, boot="00000000", synchronised=None)


class CoreRig(Rig):
    """A flight decided by the flight core.

    Attributes:
        actions: everything it decided, with its time [s].
        estimates: what it published.
        is_silent: the client sends nothing any more.
        handover: when the client begins to stream; until the core flies, who flew before holds the aircraft [s].
    """

    handover = 0.0

    def __init__(self, flight: Flight) -> None:
        super().__init__(flight)
        cfg = ControlConfig(limiter=LimiterConfig(hover_throttle=FIRST_HOVER - GAS_CENTRE))
        self.cfg = cfg
        self.core = FlightCore(cfg, first_epoch=1)
        self.core.feed(ModelKnown(flight.model or believed_model(flight.gains, flight.radio)), 0.0)
        self.core.feed(LineChanged(ControlLine(layout="v2")), 0.0)
        self.core.feed(LinkVerdict(link_state()), 0.0)
        self.actions: list[tuple[float, Action]] = []
        self.estimates: list[EstimateValue] = []
        self.is_silent = False
        self._epoch = 0
        self._sequence = 0
        self._untold: list[Callable[[], None]] = []

    def _show_pilot(self, view: TargetView, at: float) -> None:
        """Let who holds the aircraft before the core does see the target."""
        self._tell_pilot(partial(super()._see, view, at))

    def _tell_pilot(self, event: Callable[[], None]) -> None:
        """Let him know of something: at once, or, while the core flies, when he holds the aircraft again.

        He has an estimator of his own, which costs as much as the core's and which nobody asks in the meantime.
        """
        self._untold.append(event)
        if self.core.phase not in IN_FLIGHT:
            self._tell_rest()

    def _tell_rest(self) -> None:
        for event in self._untold:
            event()
        self._untold.clear()

    def _see(self, view: TargetView, at: float) -> None:
        self._show_pilot(view, at)
        self.core.feed(PoseSeen(pose_of(view)), at)

    def _hear(self, pitch: float, roll: float, yaw: float, at: float) -> None:
        self._tell_pilot(partial(super()._hear, pitch, roll, yaw, at))
        quaternion = (math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2))
        value = Attitude(stamp=stamp(at), source="lab", quaternion=quaternion, roll=roll, pitch=pitch, yaw=yaw)
        self.core.feed(StateValue(value), at)

    def _control(self, at: float) -> None:
        """The client's turn, then the core's; until the core flies a pilot holds the aircraft where it is."""
        if self.core.phase in IN_FLIGHT or self._flight.start <= 0.0:
            self._at(at + CONTROL_PERIOD, self._control)
        else:
            self._hold_by_hand(at)
        if at < self.handover:
            return
        goal = self._flight.goal(at)
        if not self._epoch:
            request = LeaseRequest(action="take", holder=CLIENT)
            found = KnownSet(Gate(GateKind.CHANNEL))
            granted = self.core.feed(LeaseAsked(request, SECRET, found), at).lease
            assert granted is not None
            self._epoch = granted.epoch
        self._sequence += 1
        setpoint = self._setpoint(goal, at)
        if not self.is_silent:
            self.core.feed(SetpointAccepted(setpoint, self._epoch), at)
        for action in self.core.tick(at):
            self.actions.append((at, action))
            if isinstance(action, SendSticks):
                counts = action.counts
                self._send(counts, at)
            elif isinstance(action, PublishEstimate):
                self.estimates.append(action.value)
        if self.core.phase in IN_FLIGHT:
            self._keep(goal, at)

    def _hold_by_hand(self, at: float) -> None:
        """The turn of who holds the aircraft while the core does not."""
        self._tell_rest()
        super()._control(at)

    def _setpoint(self, goal: Goal, at: float) -> Setpoint:
        """What the client streams."""
        x, y, z = (float(part) for part in goal.position)
        return PositionSetpoint(
            epoch=self._epoch,
            sequence=self._sequence,
            ttl=0.3,
            position=(x, y, z),
            frame=SetpointFrame.PAD,
            yaw=goal.yaw,
        )


class TakeOffRig(CoreRig):
    """A take-off to 2 m from beside the middle of the target, decided by the flight core."""

    def _setpoint(self, goal: Goal, at: float) -> Setpoint:
        """What the client streams."""
        return TakeOffSetpoint(epoch=self._epoch, sequence=self._sequence, ttl=0.3, height=float(goal.position[2]))


def pose_of(view: TargetView) -> VisionPose:
    """A view as the cameras publish it."""
    rotation = view.target_from_flu
    x, y, z = (float(part) for part in -rotation @ view.position_flu)
    a, b, c = (float(part) for part in view.position_flu)
    return VisionPose(
        stamp=stamp(view.at),
        camera="down",
        sequence=0,
        stamped_by="driver",
        target="pad",
        position_target=(x, y, z),
        quaternion_target_from_flu=quaternion_from_rotation(rotation),
        position_flu=(a, b, c),
        quaternion_flu_from_target=quaternion_from_rotation(rotation.T),
        covariance=tuple(float(part) for part in view.covariance.reshape(-1)),
        calibration_sd=view.calibration_sd,
        position_cam=(0.0, 0.0, 0.0),
        quaternion_cam_from_target=(1.0, 0.0, 0.0, 0.0),
        source="edges",
        mode="predicted",
        points=40,
        rms_px=0.3,
        ambiguity=None,
        decided_by="",
        decode_age=0.0,
        delivered=0.08,
        latency=0.08,
    )


def link_state() -> LinkState:
    """A line that is up."""
    return LinkState(
        stamp=stamp(0.0),
        condition=LinkCondition.UP,
        reason="",
        since=stamp(0.0),
        port="lab",
        baud=57600,
        hears_board=True,
        board_hears_us=True,
        openings=1,
    )
