"""A flight through the flight core to which things happen: client, line, camera, computer and air fail.

Everything the core hands to the line is checked against the rules of docs/safety.md, "The output limiter", by a
second implementation that shares no code with it.
"""

from __future__ import annotations

import math
import random
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Final, NamedTuple

import numpy as np

from lab.control.corerig import CLIENT, SECRET, CoreRig, pose_of
from lab.control.flights import Flight
from lab.control.rig import CONTROL_PERIOD
from mkdaemon.control.actions import ReleaseAircraft, ReportMode, SendSticks
from mkdaemon.control.activeset import Gate, GateKind, KnownSet
from mkdaemon.control.estimator.values import TargetView
from mkdaemon.control.events import LeaseAsked, PoseSeen, Released, SetpointAccepted
from mkdaemon.control.limiter import StickCounts
from mkdaemon.control.modes import IN_FLIGHT
from mkdaemon.telemetry.command import LeaseRequest
from mkdaemon.telemetry.control import Phase, ReleaseOutcome
from mkdaemon.telemetry.setpoint import LandSetpoint, PositionSetpoint, Setpoint, SetpointFrame

LAND_AT: Final = 13.0
"""The client asks for the landing [s]."""
HANDOVER: Final = 1.0
"""The client begins to stream [s]."""
AFTERWARDS: Final = 0.9
"""Time after a release in which no stick frame may come, though the client streams on [s]."""
LOOK: Final = 0.002
"""Between two looks whether the core wants to tick [s]."""
SLEW_TIME: Final = 0.1
"""A loop that stood still may move the sticks as far as in this time [s]; docs/safety.md."""
ROUNDING: Final = 1e-6
"""Of times; an age of just this setpoint's time may count as stale or not [s]."""
GESTURE: Final = 70
"""Most yaw, and none below `LOW` [stick]; docs/safety.md."""
LOW: Final = -100
"""See `GESTURE` [stick]."""


TOLERANCE: Final = 1.2
"""A trigger fires at its time, at most so much later: docs/safety.md."""


class Expectation(NamedTuple):
    """What may follow from a fault.

    Attributes:
        reasons: what the reason of a release may begin with or contain; of a client whose setpoints are refused and
            which has none left, what the refusal may contain.
        within: it must come so soon after the fault [s]; infinite where it need not.
    """

    reasons: tuple[str, ...] = ()
    within: float = math.inf


NOTHING: Final = Expectation()
LOST_SIGHT: Final = ("no image of", "it needs a fresh image of")
"""Images that are gone for too long end a flight, and what needs one cannot begin while they come late."""


@dataclass(slots=True)
class Trouble:
    """What is wrong at the moment; times are ends [s].

    Attributes:
        client_silent: the client streams nothing.
        client_late: largest delay of a setpoint [s].
        client_wild: the client streams nonsense.
        blind: images show no target.
        camera_late: poses come later by this [s].
        camera_wrong: poses are off by this [m].
        eyes_stalled: no pose comes before this time; then all of them do.
        core_stalled: the core does not run, from a beginning to an end.
        telemetry_silent: no attitude is heard.
        uplink_dead: no stick frame arrives.
        lids: the pilot's throttle lies so far below hover [stick], each from a beginning to an end.
    """

    client_silent: float = 0.0
    client_late: tuple[float, float] = (0.0, 0.0)
    client_wild: float = 0.0
    blind: float = 0.0
    camera_late: tuple[float, float] = (0.0, 0.0)
    camera_wrong: tuple[float, float] = (0.0, 0.0)
    eyes_stalled: float = 0.0
    core_stalled: tuple[float, float] = (0.0, 0.0)
    telemetry_silent: float = 0.0
    uplink_dead: float = 0.0
    lids: list[tuple[float, float, float]] = field(default_factory=list)


@dataclass(slots=True)
class Outcome:
    """What became of a flight.

    Attributes:
        engaged: the core flew.
        released: when it let go [s]; infinite for never.
        stood: the feet stood then, by the physics.
        aside: distance from the middle of the target then [m].
        refused: why the client's newest setpoint before that was refused; empty where it was not.
        violations: rules that were broken, by name.
    """

    engaged: bool = False
    released: float = math.inf
    reason: str = ""
    stood: bool = False
    aside: float = math.inf
    refused: str = ""
    violations: Counter[str] = field(default_factory=Counter)
    frames: int = 0


class FaultRig(CoreRig):
    """A flight with faults.

    Attributes:
        stream: what the client streams at a time, in place of its plan; None for the plan.
    """

    def __init__(self, flight: Flight) -> None:
        super().__init__(flight)
        self.trouble, self.outcome = Trouble(), Outcome()
        self.stream: Callable[[float], Setpoint | None] | None = None
        self._last: tuple[float, tuple[int, ...]] | None = None
        self._late: list[Callable[[float], None]] = []
        self._wild = random.Random(f"{flight.seed} wild client")
        self._newest = -math.inf
        self._arrived = self._held

    # -- for faults -----------------------------------------------------------------------------------------------

    def at(self, when: float, event: Callable[[float], object]) -> None:
        """Let something happen at a time [s]."""
        self._at(when, event)

    @property
    def stream_fields(self) -> dict[str, Any]:
        """What every setpoint of the present lease carries."""
        return {"epoch": self._epoch, "sequence": self._sequence}

    def disturb(self, name: str, seconds: float, **values: float) -> None:
        """Begin a fault of the simulated aircraft."""
        self._world.faults.start(name, duration=seconds, **values)

    # -- the flight -----------------------------------------------------------------------------------------------

    def fly_with(self, faults: Callable[[FaultRig], None]) -> Outcome:
        """Fly to the end, to a release, or until the aircraft is lost."""
        faults(self)
        self._at(HANDOVER, self._stream)
        self._at(HANDOVER, self._run_core)
        self.fly()
        return self.outcome

    def _control(self, at: float) -> None:
        """Who holds the aircraft before the core does."""
        if self.outcome.engaged:
            self._at(at + CONTROL_PERIOD, self._control)
            self._keep(self._flight.goal(at), at)
        else:
            self._hold_by_hand(at)

    def _is_over(self, at: float) -> bool:
        """Whether nothing is left to see: the client streams on for a while after a release."""
        return at > self.outcome.released + AFTERWARDS

    def _stream(self, at: float) -> None:
        """The client streams at 50 Hz, as well as it can."""
        trouble = self.trouble
        self._at(at + CONTROL_PERIOD, self._stream)
        if not self._epoch:
            known = KnownSet(Gate(GateKind.CHANNEL))
            granted = self.core.feed(LeaseAsked(LeaseRequest(action="take", holder=CLIENT), SECRET, known), at).lease
            if granted is None:
                return
            self._epoch = granted.epoch
        if at < trouble.client_silent:
            return
        until, most = trouble.client_late
        delay = self._wild.uniform(0.0, most) if at < until else 0.0
        self._sequence += 1
        setpoint = self._wanted(at)
        if setpoint is not None:
            self._at(at + delay, lambda now: self._offer(setpoint, now))

    def _wanted(self, at: float) -> Setpoint | None:
        stream: dict[str, Any] = {"epoch": self._epoch, "sequence": self._sequence, "ttl": 0.3}
        if at < self.trouble.client_wild:
            x, y, z = (self._wild.choice((-9e3, -1.0, 0.0, 1.0, 9e3)) for _ in range(3))
            yaw = self._wild.uniform(-3.0, 3.0)
            return PositionSetpoint(**stream, position=(x, y, z), frame=SetpointFrame.PAD, yaw=yaw)
        if self.stream is not None:
            return self.stream(at)
        if at >= LAND_AT:
            return LandSetpoint(**stream)
        goal = self._flight.goal(at).position
        place = (float(goal[0]), float(goal[1]), float(goal[2]))
        return PositionSetpoint(**stream, position=place, frame=SetpointFrame.PAD)

    def _offer(self, setpoint: Setpoint, at: float) -> None:
        refusal = self.core.feed(SetpointAccepted(setpoint, self._epoch), at).refusal
        if refusal is None:
            self._newest = at
        if math.isinf(self.outcome.released):
            self.outcome.refused = "" if refusal is None else str(refusal)

    def _run_core(self, at: float) -> None:
        """The core's own loop: it ticks when it wants to."""
        begun, until = self.trouble.core_stalled
        if begun <= at < until:
            self._at(until, self._run_core)
            return
        if self.core.next_time() <= at:
            for action in self.core.tick(at):
                match action:
                    case SendSticks():
                        self._check(action, at)
                        if at >= self.trouble.uplink_dead:
                            self._send(action.counts, at)
                    case ReleaseAircraft():
                        self._released(action, at)
                    case ReportMode():
                        if action.after is Phase.FLYING:
                            self.outcome.engaged, self._autopilot = True, None
                    case _:
                        pass
        self._at(at + LOOK, self._run_core)

    def _released(self, action: ReleaseAircraft, at: float) -> None:
        if self.outcome.engaged and math.isinf(self.outcome.released):
            outcome = self.outcome
            outcome.released, outcome.reason = at, action.reason
            outcome.stood, outcome.aside = self._world.truth.on_ground, float(np.hypot(*self._place(at)[:2]))
        self._at(at + 0.2, lambda now: self.core.feed(Released(ReleaseOutcome.CONFIRMED), now))

    @property
    def throttle_in_use(self) -> int:
        """Throttle that the FlightCtrl flies with [stick from the centre]."""
        return self._held.throttle

    def lid_moved(self, at: float) -> None:
        """The pilot moves his throttle: the FlightCtrl takes the smaller of the two at any time."""
        hover = self.cfg.limiter.hover_throttle
        lids = [round(hover - below) for start, end, below in self.trouble.lids if start <= at < end]
        super()._hold(self._arrived._replace(throttle=min([self._arrived.throttle, *lids])))

    def _hold(self, sticks: StickCounts) -> None:
        self._arrived = sticks
        self.lid_moved(self._world.now)

    # -- cameras and boards ---------------------------------------------------------------------------------------

    def _see(self, view: TargetView, at: float) -> None:
        trouble = self.trouble
        if not self.outcome.engaged:
            self._show_pilot(view, at)
        if view.at < trouble.blind:
            return
        until, off = trouble.camera_wrong
        if view.at < until:
            view = replace(view, position_flu=view.position_flu + np.array([off, -off, 0.3 * off]))
        pose = pose_of(view)
        until, late = trouble.camera_late
        if at < trouble.eyes_stalled:
            self._at(trouble.eyes_stalled, lambda now: self.core.feed(PoseSeen(pose), now))
        elif at < until:
            self._at(at + late, lambda now: self.core.feed(PoseSeen(pose), now))
        else:
            self.core.feed(PoseSeen(pose), at)

    def _hear(self, pitch: float, roll: float, yaw: float, at: float) -> None:
        if at >= self.trouble.telemetry_silent:
            super()._hear(pitch, roll, yaw, at)

    # -- the rules ------------------------------------------------------------------------------------------------

    def _check(self, action: SendSticks, at: float) -> None:
        """Check a stick frame against every rule."""
        outcome, cfg = self.outcome, self.cfg.limiter
        outcome.frames += 1
        counts = action.counts
        now = (counts.pitch, counts.roll, counts.yaw, counts.throttle)
        broken = outcome.violations
        broken["after the release"] += math.isfinite(outcome.released)
        broken["without lease"] += self.core.phase not in IN_FLIGHT
        broken["old epoch"] += action.epoch != self._epoch
        broken["not whole"] += any(not isinstance(value, int) for value in now)
        broken["tilt"] += abs(now[0]) > cfg.max_pitch or abs(now[1]) > cfg.max_roll
        broken["yaw"] += abs(now[2]) > cfg.max_yaw
        broken["throttle"] += not cfg.min_throttle <= now[3] <= cfg.max_throttle
        broken["gesture"] += abs(now[2]) > GESTURE or (now[3] < LOW and now[2] != 0)
        age = at - self._newest
        broken["stale tilt"] += age > cfg.setpoint_ttl + ROUNDING and now[:3] != (0, 0, 0)
        broken["sent late"] += action.deadline <= at
        if self._last is not None and age < cfg.setpoint_ttl - ROUNDING:  # then neutral comes at once
            step = min(at - self._last[0], SLEW_TIME)
            for new, old, slew in zip(now, self._last[1], (cfg.slew,) * 3 + (cfg.throttle_slew,), strict=True):
                # Whole counts: each end may be rounded by a half.
                broken["slew"] += abs(new - old) > slew * max(step, 0.01) + 1.0
            broken["too soon"] += at - self._last[0] < 0.01 - ROUNDING
        self._last = (at, now)
        for name in [name for name, count in broken.items() if not count]:
            del broken[name]
