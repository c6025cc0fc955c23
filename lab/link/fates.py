"""What became of every single conversation by radio: taken by the radio, or lost by us. Virtual time, seeded.

Loss rates of two short runs scatter by more than the 0.2 % that is asked for, because a radio loses in bursts. So here
each link test and each stick frame is followed through the very packets that carried it: handed to the line, complete
at the board, acted on, answered, complete at the host. What the radio took on one of its two ways is the radio's loss;
everything else that is missing is ours, whatever the reason: never sent, sent into a busy receiver, answered too late.
The bound on our share is that of Clopper and Pearson (Biometrika 26, 1934), one-sided.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from lab.campaign import Row
from mkdaemon.link.session.health import PROBE_TIMEOUT
from mkdaemon.protocol.framing import Frame, FrameDecoder
from mksim.boards.generations import FC_GENERATIONS
from mksim.config import SimConfig
from mksim.physics.world import World
from mksim.simulation import Simulation

CONFIDENCE: Final = 0.95
"""Of the bound."""


@dataclass(slots=True)
class Fate:
    """One conversation; times it passed each place [s], None where it never did.

    Attributes:
        asked: handed to the line.
        arrived: complete at the board.
        taken: a stick frame copied into what the FlightCtrl holds, or into what a NaviCtrl that takes them hands on.
        answered: the board's answer complete at its transmitter.
        heard: that answer complete at the host.
    """

    asked: float
    arrived: float | None = None
    taken: float | None = None
    answered: float | None = None
    heard: float | None = None


class Tracer(Simulation):
    """A simulation that follows every link test and every stick frame.

    Attributes:
        echoes: fates of link tests, in order.
        sticks: fates of stick frames, in order.
    """

    def __init__(self, config: SimConfig, world: World | None = None) -> None:
        super().__init__(config, world)
        self.echoes: list[Fate] = []
        self.sticks: list[Fate] = []
        self._now: Callable[[], float] = asyncio.get_running_loop().time
        self._open: dict[tuple[str, int], Fate] = {}
        self._layout = FC_GENERATIONS[config.fc].control
        self._places = {place: FrameDecoder() for place in ("asked", "arrived", "answered", "heard")}
        self._poll = self.port.poll
        self.port.poll = self._note_answers  # type: ignore[method-assign]
        self._board_takes = self.port.receive_byte
        self.port.receive_byte = self._deliver  # type: ignore[method-assign]
        external, navigation = self.flight.external, self.navigation
        self._take, self._control = external.take, None if navigation is None else navigation.control
        external.take = self._note_taken  # type: ignore[method-assign]
        if navigation is not None:
            navigation.control = self._note_controlled  # type: ignore[method-assign]

    def write(self, data: bytes, at: float) -> None:
        """Take bytes of the host."""
        self._follow("asked", data)
        super().write(data, at)

    def advance(self, to: float) -> list[tuple[float, bytes]]:
        """Run, and note what reaches the host."""
        heard = super().advance(to)
        self._follow("heard", b"".join(data for _, data in heard))
        return heard

    def radio_loss(self) -> float:
        """Share of conversations that the radio took: there, or back."""
        kept = 1.0
        for channel in (self._to_board, self._to_host):
            kept *= 1 - channel.packets_lost / channel.packets if channel.packets else 1.0
        return round(1 - kept, 5)

    def _deliver(self, byte: int, at: float) -> None:
        self._follow("arrived", bytes((byte,)))
        self._board_takes(byte, at)

    def _note_taken(self, raw: bytes) -> None:
        self._mark(raw)
        self._take(raw)

    def _note_controlled(self, payload: bytes) -> None:
        assert self._control is not None
        self._mark(payload)
        self._control(payload)

    def _mark(self, raw: bytes) -> None:
        fate = self._open.get(("b", self._layout.decode(raw).frame))
        if fate is not None and fate.taken is None:
            fate.taken = self._now()

    def _note_answers(self) -> list[tuple[float, bytes]]:
        answers = self._poll()
        self._follow("answered", b"".join(data for _, data in answers))
        return answers

    def _follow(self, place: str, data: bytes) -> None:
        for item in self._places[place].feed(data):
            if isinstance(item, Frame) and item.id in "zZbB":
                self._pass(place, item)

    def _pass(self, place: str, frame: Frame) -> None:
        """A frame passed a place: open its fate, or note it; numbers of stick frames come again after 255."""
        key = (frame.id.lower(), self._token(frame))
        if place == "asked":
            fates = self.echoes if frame.id == "z" else self.sticks
            fates.append(Fate(self._now()))
            self._open[key] = fates[-1]
        elif key in self._open:
            setattr(self._open[key], place, self._now())

    def _token(self, frame: Frame) -> int:
        if frame.id in "zZ":
            return int.from_bytes(frame.payload[:2], "little")
        return frame.payload[0] if frame.id == "B" else self._layout.decode(frame.payload).frame


def echo_account(fates: Sequence[Fate]) -> Row:
    """Who lost the link tests: an answer later than the link waits for is lost by us; see `account`."""
    lost = [fate for fate in fates if fate.heard is None or fate.heard - fate.asked > PROBE_TIMEOUT]
    radio = [fate for fate in lost if fate.arrived is None or (fate.answered is not None and fate.heard is None)]
    return account(len(fates), len(lost), len(radio))


def stick_account(fates: Sequence[Fate], handed_in: int) -> Row:
    """Who lost the stick frames: those never sent, and those that arrived in a receiver that could not take them."""
    lost = handed_in - sum(fate.taken is not None for fate in fates)
    return account(handed_in, lost, sum(fate.arrived is None for fate in fates))


def account(sent: int, lost: int, by_radio: int) -> Row:
    """Conversations that were wanted, lost, by the radio and by us, and the upper bound of our share."""
    at_most = round(upper_bound(lost - by_radio, sent), 6)
    return {"sent": sent, "lost": lost, "by_radio": by_radio, "by_us": lost - by_radio, "by_us_at_most": at_most}


def upper_bound(hits: int, trials: int) -> float:
    """One-sided upper bound of a share of which so many hits were seen, 95 %; 1 without trials."""
    if hits >= trials:
        return 1.0

    def at_most_hits(share: float) -> float:
        """Probability of so many hits or fewer."""
        ways = (math.lgamma(trials + 1) - math.lgamma(k + 1) - math.lgamma(trials - k + 1) for k in range(hits + 1))
        odds = (k * math.log(share) + (trials - k) * math.log1p(-share) for k in range(hits + 1))
        return sum(math.exp(way + each) for way, each in zip(ways, odds, strict=True))

    low, high = hits / trials, 1.0
    for _ in range(60):
        share = (low + high) / 2
        low, high = (share, high) if at_most_hits(share) > 1 - CONFIDENCE else (low, share)
    return high
