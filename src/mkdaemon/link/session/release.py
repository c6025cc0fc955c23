"""The active release: how external control is ended for certain. Pure; driven with `now`.

"Stop sending" is no release: old FlightCtrls hold the last sticks for 0.5 s (oldest) or 5.1 s (up to 2.08), and any
polling keeps them held for ever; 2.12a holds them for 2.0 s. So: neutral sticks, then Config = 0 at least five times,
each confirmed by its `B` where a `B` can come (never through a NaviCtrl 0.24). Where a confirmation should come and
does not, the release is repeated for a while, and every request that would refresh the dead-man is silenced for 6 s,
so that it runs out by itself. Source: docs/safety.md, "The trap that decides the design".

Before the FlightCtrl's release is known the frame of an opening is the 11-byte layout (v1), all zero but its number.
It cannot set the valid bit anywhere: FlightCtrls up to 2.08 read Config = 0 from byte 10; 2.12a ignores frames of 20
or more characters; every 7- or 9-byte layout would read Config from byte 5, which is zero as well. The reverse does
not hold: a 7-byte frame fills Frame and Config of an old FlightCtrl with leftovers of its decoder, so v2 and v3 wait
for the version reply. Source: docs/protocol.md, "ExternalControl"; docs/firmware-notes, "External control".
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Final

from mkdaemon.link.session.controlpath import BuildControl, FrameNumber
from mkdaemon.link.session.traffic import ReleaseResult
from mkdaemon.protocol.messages.control import ExternControlV1
from mkdaemon.protocol.wire import WireMessage
from mkdaemon.telemetry.control import ReleaseOutcome

REPEATS: Final = 5
"""Frames with Config = 0, each confirmed."""
CONFIRM_WAIT: Final = 0.06
"""Wait for one `B` [s]: 5 ms measured, 25 ms beside a debug stream, 62 ms is a radio's spike."""
SPACING: Final = 0.025
"""Between unconfirmed frames [s]: 40 Hz passes a NaviCtrl 0.24 without loss."""
GIVE_UP: Final = 1.5
"""After this long without the confirmations the release counts as unconfirmed [s]."""
QUIET_TIME: Final = 6.0
"""Longer than the longest dead-man (5.1 s, counted by a clock 2.4 % slow) [s]."""
REMIND: Final = 0.5
"""After giving up, while everything else is quiet: one more frame this often [s]. One that arrives clears the control
and can be confirmed, one that does not arrive keeps nothing alive."""


def zero_frame(layout: type[WireMessage] | None, number: int) -> WireMessage:
    """The release frame of a layout; of v1 where the layout is unknown, because that one is safe everywhere."""
    make: Callable[..., WireMessage] = layout or ExternControlV1
    return make(pitch=0, roll=0, yaw=0, throttle=0, frame=number)


def neutral_of(setpoint: WireMessage, number: int) -> WireMessage:
    """The same command with level sticks and its own throttle."""
    return setpoint.model_copy(update={"pitch": 0, "roll": 0, "yaw": 0, "frame": number})


class ReleasePlan:
    """One release, from the first neutral frame to the verdict.

    Attributes:
        outcome: how it ended; None while it runs.
    """

    def __init__(
        self,
        *,
        layout: type[WireMessage] | None,
        last_setpoint: WireMessage | None,
        confirms: bool,
        now: float,
        reason: str,
    ) -> None:
        """Begin.

        Args:
            layout: external control layout of this FlightCtrl; None while unknown.
            last_setpoint: the last command sent if the aircraft may still obey it, else None.
            confirms: whether a `B` can come back.
            now: [s; monotonic].
            reason: for the record.
        """
        self.layout = layout
        self.reason = reason
        self._zero: BuildControl = partial(zero_frame, layout)
        self._neutral: BuildControl | None = None if last_setpoint is None else partial(neutral_of, last_setpoint)
        self.confirms = confirms
        self._began = now
        self._next = now
        self._reminds_until = -math.inf
        self._awaited: dict[FrameNumber, float] = {}
        self._sent = 0
        self._confirmed = 0
        self.outcome: ReleaseOutcome | None = None

    @property
    def is_running(self) -> bool:
        """Whether frames are still to be sent or confirmed."""
        return self.outcome is None

    def due(self, now: float) -> BuildControl | None:
        """Return what builds the frame to send now; None for none."""
        if now < self.next_time():
            return None
        if self.outcome is ReleaseOutcome.UNCONFIRMED:
            self._next = now + REMIND if now <= self._reminds_until else math.inf
            return self._zero if now <= self._reminds_until else None
        if self._neutral is not None:
            neutral, self._neutral = self._neutral, None
            self._next = now
            return neutral
        if self.confirms and now - self._began > GIVE_UP:
            self.outcome = ReleaseOutcome.UNCONFIRMED
            self._next, self._reminds_until = now + REMIND, now + QUIET_TIME
            return None
        if not self.confirms and self._sent >= REPEATS:
            self.outcome = ReleaseOutcome.NOT_OBSERVABLE
            return None
        self._next = now + (CONFIRM_WAIT if self.confirms else SPACING)
        return self._zero

    def sent(self, message: WireMessage, number: FrameNumber, now: float) -> None:
        """A frame of this plan went out under a number."""
        if message.config:  # type: ignore[attr-defined]  # every layout of external control has it
            return
        self._sent += 1
        self._awaited[number] = now
        if not self.confirms and self._sent >= REPEATS:
            self.outcome = ReleaseOutcome.NOT_OBSERVABLE

    def confirmed(self, number: FrameNumber, now: float) -> None:
        """The board confirmed a frame number."""
        if self._awaited.pop(number, None) is None:
            return
        self._confirmed += 1
        self._next = now
        if self._confirmed >= REPEATS:
            self.outcome = ReleaseOutcome.CONFIRMED

    def expect_no_confirmation(self) -> None:
        """What could confirm is out of reach from now on, as when a redirection ends."""
        self.confirms = False

    def next_time(self) -> float:
        """When `due` has something next [s]; infinite when it has ended."""
        return self._next if self.outcome in {None, ReleaseOutcome.UNCONFIRMED} else math.inf

    def result(self) -> ReleaseResult:
        """How it went."""
        return ReleaseResult(self.outcome or ReleaseOutcome.UNCONFIRMED, self._sent, self._confirmed, self.reason)
