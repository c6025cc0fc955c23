"""Newest values of the vehicle with their ages: motors, flight, pilot, link, poses."""

from __future__ import annotations

from collections import deque
from typing import Final, NamedTuple, TypeVar

from mkdaemon.control.estimator.values import GAS_CENTRE
from mkdaemon.telemetry.base import Telemetry
from mkdaemon.telemetry.control import ControlLine, Obstacle
from mkdaemon.telemetry.link import LinkHealth, LinkState
from mkdaemon.telemetry.state import Battery, Pilot
from mkdaemon.telemetry.vision import PoseRefused, VisionStats

FRESH: Final = 2.0
"""Knowledge about motors, flight and pilot that is older is none [s]."""
HIGHEST_CELL: Final = 4.3
"""The FlightCtrl counts cells by this voltage [V]; docs/firmware-notes.md."""
FACTORY_LOW_CELL: Final = 3.2
"""Voltage of a cell at which the factory's sets warn, and above which throttle is compensated [V]."""
LEAST_BATTERY: Final = 5.0
"""A voltage below this is none of a battery that flies [V]: one NaviCtrl reports its used charge in that field."""
MOST_BATTERY: Final = 60.0
"""Nor one above this [V]."""
FC_LOST: Final = "the NaviCtrl does not hear its FlightCtrl, which may be booting"
"""Reason that prevents a flight meanwhile."""
EMPTY_CELL: Final = 3.0
"""A cell that rests below this is damaged by it [V], so no battery that is flown has such cells."""
MOTOR_TEST: Final = 1.0
"""A motor test turns motors for 0.5 s, and the last message that shows them turning may be as old again [s]."""

REFUSALS_KEPT: Final = 256
"""Refused images that are kept: four seconds of two cameras at 30 Hz, longer than a flight goes on without a pose."""


_State = TypeVar("_State", bound=Telemetry)


class ThrottleReport(NamedTuple):
    """A throttle that the FlightCtrl flew with.

    Attributes:
        throttle: [stick from the centre].
        at: when the report arrived [s].
        share: of the stick that this is, after the compensation of the battery's voltage; None if unknown.
    """

    throttle: float
    at: float
    share: float | None = None

    @property
    def stick(self) -> float:
        """The stick that gave it [count of 254]."""
        return (self.throttle + GAS_CENTRE) / (self.share or 1.0)


class VehicleFacts:
    """The last values, each with the time it arrived; reading changes nothing.

    Attributes:
        link: the latest verdict on the line; None before the first.
        health: the latest measurements of the line; None before the first.
        is_fc_lost: the NaviCtrl says that it does not hear its FlightCtrl.
        certain_cells: cells that the voltage at rest has shown beyond doubt; None where it has not.
        highest_voltage: of the battery since the port was opened [V].
        list_changed_at: when the daemon last changed the NaviCtrl's list [s].
        free_disk: where flights are recorded [bytes]; None where nothing has looked.
    """

    def __init__(self) -> None:
        """Begin with nothing known."""
        self.link: LinkState | None = None
        self.health: LinkHealth | None = None
        self.is_fc_lost = False
        self.certain_cells: int | None = None
        self.highest_voltage = 0.0
        self.list_changed_at = self._tested_at = float("-inf")
        self.free_disk: float | None = None
        self._eyes: dict[str, VisionStats] = {}
        self._refused: deque[PoseRefused] = deque(maxlen=REFUSALS_KEPT)
        self._known_cells: int | None = None
        self._motors: tuple[bool, float] | None = None
        self._states: dict[type[Telemetry], tuple[Telemetry, float]] = {}

    @property
    def eyes(self) -> tuple[VisionStats, ...]:
        """Latest state of each camera."""
        return tuple(self._eyes.values())

    @property
    def refused_sights(self) -> tuple[PoseRefused, ...]:
        """The newest images whose pose vision refused, of all cameras, in the order of arrival."""
        return tuple(self._refused)

    @property
    def cells(self) -> int | None:
        """Cells of the battery: as many as are known, more where its voltage shows more; None where nothing says so.

        The voltage alone counts them as the FlightCtrl does: a battery of four cells that rests at 12.8 V is counted as
        one of three.
        """
        if self.highest_voltage <= 0.0:
            return self._known_cells
        return max(self._known_cells or 0, 1 + int(self.highest_voltage / HIGHEST_CELL))

    @property
    def are_cells_doubtful(self) -> bool:
        """Whether the battery may have a cell more than its voltage shows, and nothing else says how many it has."""
        return self._known_cells is None and self.certain_cells is None and self.cells is not None

    def limit_line(self, line: ControlLine) -> ControlLine:
        """What the line accepts, if the FlightCtrl is present."""
        return ControlLine(obstacle=Obstacle.READ_ONLY, reason=FC_LOST) if self.is_fc_lost else line

    def motors_running(self, now: float, within: float = FRESH) -> bool | None:
        """Whether motors run; None where no message has said so lately.

        Args:
            now: [s].
            within: how old that message may be [s].
        """
        if self._motors is None or now - self._motors[1] > within:
            return None
        return self._motors[0]

    def is_testing_motors(self, now: float) -> bool:
        """Whether motors that turn may turn because of a motor test."""
        return now - self._tested_at <= MOTOR_TEST

    def newest(self, kind: type[_State], now: float) -> _State | None:
        """The newest value of a kind; None where no message has given one lately."""
        value, at = self._states.get(kind, (None, now))
        return value if isinstance(value, kind) and now - at <= FRESH else None

    def throttle_in_use(self, low_cell: float | None = None) -> ThrottleReport | None:
        """Latest throttle report of the FlightCtrl; None without one.

        Above the voltage of its low-battery warning the FlightCtrl takes throttle back as the voltage is higher.

        Args:
            low_cell: that voltage for a cell, by the active set [V]; None for the factory's.
        """
        pilot, at = self._states.get(Pilot, (None, 0.0))
        if not isinstance(pilot, Pilot) or pilot.throttle_in_use is None:
            return None
        voltage = pilot.compensated_at
        share = None
        if voltage is not None and LEAST_BATTERY <= voltage <= MOST_BATTERY:
            # The FlightCtrl compensates by the cells that it counts itself, whatever is known here.
            cells = 1 + int(max(voltage, self.highest_voltage) / HIGHEST_CELL)
            share = min(1.0, cells * (low_cell or FACTORY_LOW_CELL) / voltage)
        return ThrottleReport(pilot.throttle_in_use, at, share)


class VehicleMemory(VehicleFacts):
    """Takes what the boards and the cameras tell; the one owner of what is known about the vehicle."""

    def motors_reported(self, are_running: bool, at: float) -> None:
        """Take what a message says about the motors."""
        self._motors = are_running, at

    def flightctrl_reported(self, *, is_lost: bool) -> None:
        """Note whether the NaviCtrl hears its FlightCtrl; while it does not, what it shows of it is old."""
        if is_lost:
            self._forget()
        self.is_fc_lost = is_lost

    def motor_test_sent(self, at: float) -> None:
        """Note that motors are about to turn because a client tests them."""
        self._tested_at = at

    def list_changed(self, at: float) -> None:
        """Note that the daemon changed the NaviCtrl's list."""
        self.list_changed_at = at

    def eye_reported(self, stats: VisionStats) -> None:
        """Take what a camera says of itself."""
        self._eyes[stats.camera] = stats

    def sight_refused(self, refused: PoseRefused) -> None:
        """Keep an image whose pose vision refused."""
        self._refused.append(refused)

    def disk_measured(self, free: float | None) -> None:
        """Note how much can be recorded [bytes]."""
        self.free_disk = free

    def link_measured(self, health: LinkHealth) -> None:
        """Take the measurements of the line."""
        self.health = health

    def state_received(self, value: Telemetry, at: float) -> None:
        """Take a state value; kinds that decide nothing are not asked for."""
        self._states[type(value)] = value, at
        if isinstance(value, Battery):
            self.highest_voltage = max(self.highest_voltage, value.voltage)
            self._count_cells(value.voltage, at)

    def link_changed(self, state: LinkState) -> None:
        """Take a verdict on the line; what was said through an earlier opening of the port is forgotten."""
        if self.link is not None and self.link.openings != state.openings:
            self._forget()
            self.is_fc_lost = False
            self.highest_voltage = 0.0
            self.certain_cells = None
        self.link = state

    def cells_known(self, cells: int) -> None:
        """Take how many cells the battery has, as configured or remembered."""
        self._known_cells = cells

    def _count_cells(self, voltage: float, at: float) -> None:
        """Count the cells at rest: they are certain where one more would have to be damaged."""
        cells = self.cells
        if cells is not None and self.motors_running(at) is False and voltage < EMPTY_CELL * (cells + 1):
            self.certain_cells = cells

    def _forget(self) -> None:
        self._motors = None
        self._states.clear()
