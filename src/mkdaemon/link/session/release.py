"""The active release: how external control is ended for certain. Pure; driven with `now`.

"Stop sending" is no release: old FlightCtrls hold the last sticks for 0.5 s (oldest) or 5.3 s (up to 2.08), and any
polling keeps them held for ever; 2.12a holds them for 2.0 s. So: neutral sticks, then Config = 0 at least five times,
each confirmed by its `B` where a `B` can come (never through a NaviCtrl 0.24). Where a confirmation should come and
does not, the release is repeated for a while, and every request that would refresh the dead-man is silenced for 6 s,
so that it runs out by itself. Source: docs/safety.md, "Silence is not a release".

Before the FlightCtrl's release is known every frame goes out in both forms in turn, all zero but the number, because
each generation obeys one of them only, and neither sets the valid bit (Config, bit 0) anywhere:

* The 11-byte form (v1) is read by FlightCtrls up to 2.08, with Config = 0 from byte 10. 2.12a ignores frames of 20 or
  more characters. A board that reads 7 or 9 bytes takes Config from byte 5, which is zero.
* The 7-byte form (v2; v3 is the same zeros, 9 bytes on the wire either way) is read by 2.10 and later, with Config = 0.
  A FlightCtrl up to 2.08 takes Config from byte 10 of what its decoder makes of 12 payload characters, two of the
  checksum (c, d), the CR and leftovers, decoded as if they went on: byte 10 is ((d - 61) & 15) << 4 | (CR - 61) >> 2,
  modulo 256. The four low bits come from the CR alone, 208 >> 2 = 52, and bit 0 of 52 is 0: not valid, whatever the
  number, the checksum and the leftovers.

v1 is the first and the last: an old FlightCtrl is left with zeros in every field.
Source: docs/protocol.md, "ExternalControl" and "Framing"; docs/firmware-notes, "Sending" and "External control".
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from functools import partial
from typing import Final

from mkdaemon.link.session.traffic import BuildControl, FrameNumber, ReleaseResult
from mkdaemon.protocol.messages.control import ExternControlV1, ExternControlV2
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
"""Longer than the longest dead-man (5.3 s) [s]."""
REMIND: Final = 0.5
"""After giving up, while everything else is quiet: one more frame this often [s]. One that arrives clears the control
and can be confirmed, one that does not arrive keeps nothing alive."""


EITHER: Final[tuple[type[WireMessage], ...]] = (ExternControlV1, ExternControlV2)
"""Layouts of a release while the FlightCtrl's is unknown, in turn."""
REPEATS_EITHER: Final = 2 * REPEATS + 1
"""Frames of such a release: five of each, and v1 again."""


def zero_frame(layout: type[WireMessage], number: int) -> WireMessage:
    """The release frame of a layout."""
    make: Callable[..., WireMessage] = layout
    return make(pitch=0, roll=0, yaw=0, throttle=0, frame=number)


def shortest_release(layout: type[WireMessage] | None) -> list[WireMessage]:
    """The shortest release there is, without confirmation; in both forms where the layout is unknown."""
    layouts: tuple[type[WireMessage], ...] = (layout,) if layout else (*EITHER, ExternControlV1)
    return [zero_frame(each, 0) for each in layouts]


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
        self._repeats = REPEATS if layout else REPEATS_EITHER
        self._zeros = itertools.cycle([partial(zero_frame, each) for each in ((layout,) if layout else EITHER)])
        self._neutral: BuildControl | None = None if last_setpoint is None else partial(neutral_of, last_setpoint)
        self.confirms = confirms
        self._began = now
        self._next = now
        self._reminds_until = -math.inf
        self._awaited: set[FrameNumber] = set()
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
            if now > self._reminds_until:
                self._next = math.inf
                return None
            self._next = now + REMIND
            return next(self._zeros)
        if self._neutral is not None:
            neutral, self._neutral = self._neutral, None
            return neutral
        if self.confirms and now - self._began > GIVE_UP:
            self.outcome = ReleaseOutcome.UNCONFIRMED
            self._next, self._reminds_until = now + REMIND, now + QUIET_TIME
            return None
        if not self.confirms and self._sent >= self._repeats:
            self.outcome = ReleaseOutcome.NOT_OBSERVABLE
            return None
        self._next = now + (CONFIRM_WAIT if self.confirms else SPACING)
        return next(self._zeros)

    def sent(self, message: WireMessage, number: FrameNumber) -> None:
        """A frame of this plan went out under a number."""
        if message.config:  # type: ignore[attr-defined]  # every layout of external control has it
            return
        self._sent += 1
        self._awaited.add(number)
        if not self.confirms and self._sent >= self._repeats:
            self.outcome = ReleaseOutcome.NOT_OBSERVABLE

    def confirmed(self, number: FrameNumber, now: float) -> None:
        """The board confirmed a frame number."""
        # In the form of another generation a frame is confirmed under a number that was never sent.
        if self.layout is None or number not in self._awaited:
            return
        self._awaited.remove(number)
        self._confirmed += 1
        self._next = now
        if self._confirmed >= REPEATS:
            self.outcome = ReleaseOutcome.CONFIRMED

    def expect_no_confirmation(self) -> None:
        """No confirmation can arrive any more, for example after a redirection."""
        self.confirms = False

    def next_time(self) -> float:
        """When `due` has something next [s]; infinite when it has ended."""
        return self._next if self.outcome in {None, ReleaseOutcome.UNCONFIRMED} else math.inf

    def result(self) -> ReleaseResult:
        """Its outcome."""
        return ReleaseResult(self.outcome or ReleaseOutcome.UNCONFIRMED, self._sent, self._confirmed, self.reason)
