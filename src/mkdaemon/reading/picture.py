"""The picture of a moment: facts, alarms with the worst first, the chain of causes, and what may be commanded."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

from mkdaemon.bus.keys import fresh_for
from mkdaemon.reading.alarms import RaisedAlarm, alarms_of, is_known
from mkdaemon.reading.facts import Fact, fact_of, holder_of, phase_words, rows_of
from mkdaemon.reading.known import Knowledge, Known, LastValues
from mkdaemon.spelling import on_one_line
from mkdaemon.telemetry.base import Stamped
from mkdaemon.telemetry.control import ControlStatus, Phase
from mkdaemon.telemetry.state import Flight
from mkdaemon.telemetry.tone import Tone
from mkdaemon.telemetry.vehicle import VehicleHealth

_FREE: Final = {True: "The pilot flies", False: "On the ground", None: "The pilot has it"}


@dataclass(frozen=True, slots=True)
class Offer:
    """A command that may be given now, or may not.

    Attributes:
        id: its verb.
        meaning: what it does, one sentence.
        why_not: why it may not be given; empty where it may.
    """

    id: str
    meaning: str
    why_not: str


_MEANINGS: Final = {
    "lease": "Takes the lease: the right to fly, until it is given back.",
    "abort": "Stops the manoeuvre: the aircraft holds its place over a target in sight, else it flies level. The lease "
    "stays.",
    "release": "Ends external control: the pilot's sticks alone fly, at once. The pilot's hands must be on the sticks.",
}


class Picture(Knowledge):
    """What is known at a moment. Each part is made when it is asked for, of what has changed since the last picture."""

    def __init__(self, held: LastValues, now: float, absence: str = "") -> None:
        """Look at last values.

        Args:
            held: the values.
            now: the moment, on the clock of their times [s].
            absence: why no program publishes for the vehicle, one sentence; empty while one does.
        """
        super().__init__(held, now)
        self.absence = absence

    @cached_property
    def facts(self) -> tuple[Fact, ...]:
        """Everything that is said, in order."""
        return tuple(fact_of(row, self) for row in rows_of(self.cameras()).values())

    def fact(self, word: str) -> Fact:
        """The fact of a stable word.

        Raises:
            KeyError: there is no such row.
        """
        return fact_of(rows_of(self.cameras())[word], self)

    @cached_property
    def alarms(self) -> tuple[RaisedAlarm, ...]:
        """What is wrong, the worst first."""
        return alarms_of(self, self.absence)

    @property
    def headline(self) -> str:
        """The worst thing in words; the holder and the manoeuvre while nothing is wrong."""
        return self.alarms[0].text if self.alarms else on_one_line(self._authority())

    @property
    def tone(self) -> Tone:
        """How good it is: as the worst thing; good only while nothing is wrong and what must be known is known."""
        if self.alarms:
            return self.alarms[0].tone
        status = self.fresh("control/status", ControlStatus)
        tone = Tone.OK if status is None or status.phase is Phase.FREE else status.phase.tone
        return tone if is_known(self) or tone is not Tone.OK else Tone.NOTE

    @property
    def causes(self) -> tuple[str, ...]:
        """The chain of causes of *Flights that finish*, the effect first; empty while nothing keeps a flight back."""
        status = self.fresh("control/status", ControlStatus)
        return () if status is None else tuple(on_one_line(cause.text) for cause in status.causes)

    @cached_property
    def offers(self) -> tuple[Offer, ...]:
        """What may be commanded now and what not, and why."""
        why_not = {"lease": self._no_lease(), "abort": self._no_abort(), "release": ""}
        return tuple(Offer(word, meaning, self.absence or why_not[word]) for word, meaning in _MEANINGS.items())

    def _no_abort(self) -> str:
        status = self.fresh("control/status", ControlStatus)
        return "" if status is None or status.phase.may_be_aborted else "Nothing is flown that an abort would change."

    def _no_lease(self) -> str:
        status, health = self.fresh("control/status", ControlStatus), self.fresh("health", VehicleHealth)
        if status is not None and status.lease is not None:
            return on_one_line(f"{holder_of(status)} holds the lease.")
        if health is not None and not health.is_alive:
            return on_one_line(f"The aircraft is silent: {health.reason}")
        return "" if health is None else on_one_line(health.read_only or "")

    def _authority(self) -> str:
        status = self.fresh("control/status", ControlStatus)
        if status is not None and status.phase is not Phase.FREE:
            return phase_words(status)
        flight, health = self.fresh("state/flight", Flight), self.fresh("health", VehicleHealth)
        if flight is None and health is not None and health.motors_running is False:
            return _FREE[False]
        return _FREE[None if flight is None else flight.is_flying]


class Reading:
    """Keeps the last values of one vehicle. Which clock its times are of is the caller's choice, one for all."""

    def __init__(self) -> None:
        """Know nothing."""
        self._held = LastValues()

    def take(self, key: str, value: object, now: float) -> None:
        """Keep a value; one that is older than what is known is left, and an event.

        Args:
            key: without the vehicle.
            value: as its key carries it; what another version publishes is left too.
            now: when it was true [s].
        """
        if fresh_for(key) is not None and isinstance(value, Stamped):
            self._held.take(Known(key, value, now))

    def forget(self) -> None:
        """Know nothing again."""
        self._held = LastValues()

    def at(self, now: float, absence: str = "") -> Picture:
        """The picture of a moment.

        Args:
            now: the moment [s].
            absence: why no program publishes for the vehicle, one sentence; empty while one does.
        """
        return Picture(self._held.copy(), now, absence)
