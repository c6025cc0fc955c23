"""From what the authority wants to one stick frame: limited, not sooner than the boards can take, with a deadline."""

from __future__ import annotations

from typing import Final

from mkdaemon.config.control import ControlConfig
from mkdaemon.control.actions import SendSticks
from mkdaemon.control.authority import Fly
from mkdaemon.control.limiter import StickCounts, Sticks, count, limit
from mkdaemon.control.throttlelid import ThrottleLid
from mkdaemon.control.vehicle import VehicleFacts
from mkdaemon.telemetry.control import ControlLine
from mkdaemon.telemetry.state import Flight, Pilot

SHORTEST_STEP: Final = 0.01
"""Stick frames are at least this far apart [s]: the boards lose frames beyond 100 Hz."""
LONGEST_STEP: Final = 0.03
"""A decision waits no longer for the boards to take the next stick frame [s]; on a slower line the frame waits."""
AHEAD: Final = 2.0
"""Periods of `control.rate` that stick frames may be ahead, so that a client's jitter delays none."""
LONGEST_QUEUE: Final = 0.1
"""A stick frame that could not be sent for this long is never sent [s]."""


class StickOutput:
    """Makes stick frames and counts what becomes of them.

    Attributes:
        handed_over: frames handed to the line since the start.
        sent: of those, written to the port.
        confirmed: of those, confirmed by the board.
        line: what the link can take.
        lid: whether the pilot's throttle caps ours.
    """

    def __init__(self, cfg: ControlConfig, facts: VehicleFacts) -> None:
        self._cfg = cfg
        self._facts = facts
        self._last = Sticks(0.0, 0.0, 0.0, cfg.limiter.hover_throttle)
        self._made_at = self._due_at = float("-inf")
        self._is_waiting = False
        self._awaited: set[int] = set()
        self.line = ControlLine()
        self.lid = ThrottleLid()
        self.handed_over = self.sent = self.confirmed = 0

    @property
    def step(self) -> float:
        """Least time between two frames [s]; one made sooner would be out of date when it leaves."""
        return min(max(SHORTEST_STEP, self.line.shortest_step), LONGEST_STEP)

    @property
    def next_step(self) -> float:
        """Earliest time of the next frame, by the boards and by `control.rate` [s]."""
        return max(self._made_at + self.step, self._due_at - AHEAD / self._cfg.rate)

    def engage(self, sticks: Sticks, now: float) -> None:
        """Start a flight, or restart it after the line took no frames: the board may have dropped external control.

        Tilt begins from neutral, throttle where the client holds it; less would drop the aircraft.
        """
        self._last = Sticks(0.0, 0.0, 0.0, sticks.throttle)
        self._made_at = now - 1.0 / self._cfg.rate

    def make(
        self,
        order: Fly,
        layout: str,
        now: float,
        *,
        is_extra: bool = False,
        hover: float | None = None,
        low_cell: float | None = None,
    ) -> SendSticks:
        """Limit the sticks and make a frame of them.

        Args:
            order: what the authority wants.
            layout: of external control.
            now: [s].
            is_extra: it answers an image, beside those of `control.rate`.
            hover: throttle that carries the aircraft by the estimate [stick]; None where there is none.
            low_cell: voltage of a cell above which throttle is compensated [V]; None for the factory's.
        """
        cfg, ttl = self._cfg.limiter, self._life(order)
        cap, wanted = self._throttle_cap(order, now), order.sticks
        if order.is_level and cap is not None:
            wanted = wanted._replace(throttle=min(wanted.throttle, cap))
        sticks = limit(
            wanted,
            self._last,
            age=order.age,
            ttl=ttl,
            dt=max(now - self._made_at, SHORTEST_STEP),
            layout=layout,
            cfg=cfg,
            throttle_cap=cap,
            hover=hover,
        )
        self._last, self._made_at = sticks, now
        self.lid.frame_made(sticks.throttle, self._facts.throttle_in_use(low_cell), now)
        self._due_at = max(self._due_at, now) + (0.0 if is_extra else 1.0 / self._cfg.rate)
        self.handed_over += 1
        self._is_waiting = True
        life = min(ttl - order.age, LONGEST_QUEUE) if order.age <= ttl else LONGEST_QUEUE
        counts = count(sticks)
        is_limited = _differs(counts, order.sticks)
        return SendSticks(counts, now + life, order.epoch, order.sequence, order.age, is_limited, order.sticks)

    def frame_sent(self, number: int) -> None:
        """Note that a frame was written to the port, under a number that comes again after 255 frames."""
        self.sent += 1
        self._is_waiting = False
        self._awaited.add(number)

    def dropped(self, *, is_flying: bool) -> int:
        """Frames handed over that never leave: a newer one took their place, they grew too old, or a release began."""
        return self.handed_over - self.sent - (self._is_waiting and is_flying)

    def frame_confirmed(self, number: int) -> None:
        """Note a confirmation; those of releases are not counted."""
        if number in self._awaited:
            self._awaited.remove(number)
            self.confirmed += 1

    def _throttle_cap(self, order: Fly, now: float) -> float | None:
        """Largest throttle, if the client did not ask for more; None without a limit.

        It does not rise where the ground may be touched: what is flown knows that best, because a board may say that
        the aircraft flies while its motors run. A stale command counts the pilot's throttle, and a board that says
        nothing, for the ground, too: it is over in a second.
        """
        facts, now_sent = self._facts, self._last.throttle
        flight, pilot = facts.newest(Flight, now), facts.newest(Pilot, now)
        is_flying = None if flight is None else flight.is_flying
        may_stand = order.may_touch or is_flying is False or facts.motors_running(now) is False
        if order.age <= self._life(order):
            return now_sent if may_stand else None
        caps = [None if pilot is None else pilot.throttle, now_sent if may_stand or is_flying is None else None]
        return min((cap for cap in caps if cap is not None), default=None)

    def _life(self, order: Fly) -> float:
        """How long its setpoint holds [s]."""
        return min(order.ttl, self._cfg.limiter.setpoint_ttl)


def _differs(counts: StickCounts, asked: Sticks) -> bool:
    """Whether what is sent is more than rounding away from what was asked for, or that is not a number."""
    return not all(abs(sent - wanted) <= 0.5 for sent, wanted in zip(counts, asked, strict=True))
