"""External control: frames numbered, sent, confirmed and remembered until they are taken back; releases. Pure.

A release ends with one of three results. Confirmed: the FlightCtrl holds no command. Not observable: five frames went
out, and nothing here can confirm them. Unconfirmed: it may still hold a command, so for `release.QUIET_TIME` nothing is
asked that would refresh its dead-man, and a release frame every `release.REMIND` goes on asking for confirmation.
Such a frame cannot keep the sticks alive even where it refreshes the dead-man, because the same frame clears the valid
bit that the dead-man guards. Source: docs/safety.md; docs/firmware-notes, "External control".
"""

from __future__ import annotations

import itertools
import math
from collections import deque
from dataclasses import dataclass
from typing import Final

from mkdaemon.link.session import release
from mkdaemon.link.session.health import HealthMonitor
from mkdaemon.link.session.peers import Peers
from mkdaemon.link.session.scheduler import QueuedTransmission, TransmitScheduler
from mkdaemon.link.session.traffic import (
    UNNUMBERED,
    BuildControl,
    FrameNumber,
    Purpose,
)
from mkdaemon.protocol.messages.control import ExternControlV1
from mkdaemon.protocol.messages.flightctrl import SerialChannels
from mkdaemon.protocol.messages.version import VersionRequest
from mkdaemon.protocol.wire import Board, WireMessage
from mkdaemon.telemetry.control import Obstacle, ReleaseOutcome

_CONFIRM_DELAY: Final = 0.008
"""From the beginning of an external control frame to that of its confirmation, the board being free [s]: 3.1 ms on the
wire and 5 ms in the board."""
_RADIO: Final = 0.01
"""Answers later than over a cable by this much come by radio [s]."""
_PAUSE: Final = 0.005
"""A FlightCtrl begins its next frame up to this long after the last one [s]: one or two passes of its main loop."""
_TOLERANCE_TIME: Final = 0.003
"""Times at the host and at the board differ by about this much, and by the line's jitter [s]."""


@dataclass(slots=True, eq=False)
class ControlEntry(QueuedTransmission):
    """An external control frame waiting for its turn.

    Attributes:
        number: of the frame.
    """

    number: FrameNumber = UNNUMBERED


class ControlPath:
    """The way of external control frames to the board and of their confirmations back.

    Attributes:
        last_command: the latest frame sent that the aircraft may still obey; None after a release.
    """

    def __init__(self, health: HealthMonitor) -> None:
        self.last_command: WireMessage | None = None
        self._health = health
        self._number = FrameNumber(0)
        self._rx_busy: deque[tuple[float, float]] = deque(maxlen=16)

    def restart(self) -> None:
        """A port was opened or lost.

        The last command is forgotten: minutes may have passed, and repeating its throttle, even with level sticks, is
        no release.
        """
        self.last_command = None
        self._rx_busy.clear()

    def entry(self, build: BuildControl, purpose: Purpose, deadline: float, *, tag: object = None) -> ControlEntry:
        """Build the next frame with its number, ready to send."""
        self._number = FrameNumber(self._number % 255 + 1)
        message = build(self._number)
        return ControlEntry(
            message.to_frame(), purpose, deadline, Board.FC, message, reaches_fc=True, tag=tag, number=self._number
        )

    def sent(self, entry: ControlEntry, now: float, *, confirms: bool) -> None:
        """A frame went out."""
        if confirms:
            self._health.confirm.sent(entry.number, now)
        else:
            tally = self._health.confirm.tally
            tally.sent, tally.silent = tally.sent + 1, tally.silent + 1
        if entry.purpose is Purpose.SETPOINT:
            self.last_command = entry.message

    def board_was_busy(self, began: float, ended: float) -> None:
        """Another frame occupied the board's transmitter for this time [s]; frames on end are one stretch."""
        if self._rx_busy and began - self._rx_busy[-1][1] < _PAUSE:
            began = self._rx_busy.pop()[0]
        self._rx_busy.append((began, ended))

    def confirmed(self, number: FrameNumber, now: float) -> None:
        """A confirmation came; older numbers that it replaced in the board, which keeps one, are not confirmed."""
        confirm = self._health.confirm
        began = confirm.began(number)
        if began is not None:
            # How much later than over a cable an answer comes here: what the radio takes, there and back.
            delay = max(0.0, confirm.fastest - _CONFIRM_DELAY)
            waiting = [*confirm.before(began), (number, began)]
            for (older, sent), (_, replaced) in itertools.pairwise(waiting):
                # A radio bunches frames: two may arrive together however far apart they were sent.
                spread = confirm.jitter * (3.0 if delay > _RADIO else 1.0)
                if self._was_busy(sent + delay, replaced + delay, _TOLERANCE_TIME + spread):
                    confirm.replaced(older, now)
        self._health.confirmed(number, now)

    def _was_busy(self, sent: float, replaced: float, unsure: float) -> bool:
        """Whether one stretch kept the board's transmitter busy from one external control frame to the next."""
        first, last = sent + _CONFIRM_DELAY + unsure, replaced + _CONFIRM_DELAY - unsure
        return any(start < first and end > last for start, end in self._rx_busy)


_LETTER: Final = ExternControlV1.spec.id


class Steering:
    """External control of one aircraft.

    Attributes:
        control: numbers, confirmations and the command the aircraft may still obey.
        plan: the latest release; None before the first opening.
        released_at: when a release was confirmed last [s].
        navictrl_confirms: the NaviCtrl at the end of the wire has confirmed a frame, so it takes them itself.
    """

    def __init__(self, scheduler: TransmitScheduler, peers: Peers, health: HealthMonitor) -> None:
        self.control = ControlPath(health)
        self._health = health
        self.plan: release.ReleasePlan | None = None
        self.navictrl_confirms = False
        self._scheduler = scheduler
        self._peers = peers
        self._plan_is_settled = True
        self.released_at = -math.inf

    def restart(self) -> None:
        """A port was opened: whatever was agreed before is void."""
        self.navictrl_confirms = False
        self.plan = None
        self.control.restart()

    @property
    def confirms(self) -> bool:
        """Whether external control frames are confirmed here.

        A FlightCtrl on the wire does. A NaviCtrl 0.24 never does; whether a later one does, its first `B` tells.
        """
        fc_listens = self._peers.direct is Board.FC or self._peers.redirected is Board.FC
        return fc_listens or (self.navictrl_confirms and self._peers.redirected is None)

    @property
    def is_releasing(self) -> bool:
        """Whether a release is under way."""
        return self.plan is not None and self.plan.is_running

    def obstacle(self, now: float) -> Obstacle | None:
        """Reason why a release prevents stick frames; None if none does."""
        if self.is_releasing:
            return Obstacle.RELEASING
        return Obstacle.UNCONFIRMED if self._scheduler.holds_back(_LETTER, now) else None

    def release(self, reason: str, now: float) -> None:
        """Begin a release; setpoints are refused until it is done."""
        self._scheduler.drop_setpoint()
        layout = self._peers.dialect.extern_control
        confirms = self.confirms and layout is not None
        plan = self.plan
        if plan is not None and plan.is_running and plan.layout is layout and plan.confirms == confirms:
            return  # it is being done, and no command came since it began
        self._plan_is_settled = False
        self.plan = release.ReleasePlan(
            layout=layout, last_setpoint=self.control.last_command, confirms=confirms, now=now, reason=reason
        )

    def forget_command(self) -> None:
        """The last command may have gone to other boards: it is not sent again, not even with level sticks."""
        self._scheduler.drop_setpoint()
        self.control.last_command = None
        self.plan = None

    def leave(self, now: float) -> None:
        """Begin an orderly exit: a release, and nothing else after it."""
        self.release("exit", now)
        self._scheduler.send_only_releases()

    def redirection_changed(self) -> None:
        """The wire leads to another board from now on, perhaps to one that cannot confirm."""
        if self.plan is not None and not self.confirms:
            self.plan.expect_no_confirmation()

    def confirmed(self, number: FrameNumber, now: float) -> bool:
        """A confirmation came; returns whether it is the first of a NaviCtrl that takes the frames itself."""
        self.control.confirmed(number, now)
        is_navictrl = self._peers.direct is Board.NC and self._peers.redirected is None
        is_first = is_navictrl and not self.navictrl_confirms
        self.navictrl_confirms |= is_navictrl
        if self.plan is not None:
            before = self.plan.outcome
            self.plan.confirmed(number, now)
            if self.plan.outcome is ReleaseOutcome.CONFIRMED is not before:
                self.released_at = now
        return is_first

    def sent(self, entry: ControlEntry, now: float) -> None:
        """A setpoint or a frame of a release went out."""
        # A frame in the layout that is safe everywhere is not confirmed by a board that does not understand it.
        is_understood = type(entry.message) is self._peers.dialect.extern_control
        self.control.sent(entry, now, confirms=self.confirms and is_understood)
        if isinstance(entry.tag, release.ReleasePlan) and entry.message is not None:
            entry.tag.sent(entry.message, entry.number)

    def step(self, now: float) -> None:
        """Queue the next frame of the release, and act on its end."""
        plan = self.plan
        if plan is None:
            return
        build = None if self._scheduler.release_waits else plan.due(now)
        if build is not None:
            self._scheduler.submit(self.control.entry(build, Purpose.RELEASE, now + 1.0, tag=plan), now)
        if plan.outcome is ReleaseOutcome.CONFIRMED:
            self._scheduler.end_quiet()  # an earlier release that could not be confirmed may have started it
            self._health.keep_quiet(now)
        if plan.is_running or self._plan_is_settled:
            return
        self._plan_is_settled = True
        if plan.outcome is ReleaseOutcome.UNCONFIRMED:
            refreshes = self._peers.dialect.dead_man.refreshed_by
            self._scheduler.quieten(refreshes, now + release.QUIET_TIME)
            if refreshes(VersionRequest.spec.id):
                self._health.keep_quiet(now + release.QUIET_TIME)
        elif plan.outcome is ReleaseOutcome.NOT_OBSERVABLE and not self._scheduler.holds_back(_LETTER, now):
            # Nothing shows whether it arrived; beside stick frames a NaviCtrl passes only serial channels on.
            refreshes = self._peers.dialect.dead_man.refreshed_by
            channels = SerialChannels.spec.id
            self._scheduler.quieten(lambda letter: letter == channels and refreshes(channels), now + release.QUIET_TIME)
        self.control.last_command = None

    def next_time(self) -> float:
        """When `step` has something to do again [s]; infinite while it has not."""
        return math.inf if self.plan is None or self._scheduler.release_waits else self.plan.next_time()
