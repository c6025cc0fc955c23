"""A gate that is shut while a client streams: the daemon notices, winds nothing up, and goes on when it is opened."""

from __future__ import annotations

import math

import pytest

from lab.control.corerig import stamp
from lab.control.flights import Flight
from mkdaemon.config.autopilot import AutopilotConfig
from mkdaemon.control.actions import PublishStatus, Warn
from mkdaemon.control.answers import AnswerWatch
from mkdaemon.control.estimator.model import AircraftModel
from mkdaemon.control.estimator.values import OURS
from mkdaemon.control.events import StateValue
from mkdaemon.control.limiter import StickCounts
from mkdaemon.control.sight import CONFIRMED_BY_CABLE, Sight
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.link import LinkHealth, RoundTripStats
from mkdaemon.telemetry.setpoint import HoldSetpoint
from mkdaemon.telemetry.state import Pilot
from mksim.config import WindClass
from mksim.physics.hand_flight import HandFlight
from mksim.physics.world import StickInput
from tests.control.coreflights import Told

SHUT, OPENED = 3.0, 6.0


class Gated(Told):
    """A client holds; the pilot shuts the gate, flies by hand, and opens it again.

    Attributes:
        tells: the board reports the gate.
    """

    tells = False

    def _sticks(self):
        if not SHUT <= self._world.now < OPENED:
            return super()._sticks()
        pilot = self._world.pilot
        if not isinstance(pilot.program, HandFlight):
            pilot.program = HandFlight(height=2.0, flying=True)
        return StickInput(pilot.pitch, pilot.roll, pilot.yaw, pilot.gas + 127.0, motors_running=True)

    def _setpoint(self, goal, at):
        return HoldSetpoint(epoch=self._epoch, sequence=self._sequence, ttl=0.3)

    def _control(self, at):
        if self.tells:
            is_open = not SHUT <= at < OPENED
            said = {"rc_quality": 1.0, "has_signal": True, "throttle": None, "sticks": None, "is_gate_open": is_open}
            self.core.feed(StateValue(Pilot(stamp=stamp(at), source="fc/debug", **said)), at)
        super()._control(at)

    def phases(self):
        """Each phase and when it was first told."""
        shown = {}
        for at, action in self.of(PublishStatus):
            shown.setdefault(action.phase, at)
        return shown

    def sticks(self, begin, end):
        """Largest pitch or roll between two times."""
        return max(max(abs(each.pitch), abs(each.roll)) for each in self.counts(begin, end))

    def phase_at(self, when):
        return self.of(PublishStatus, end=when)[-1][1].phase


class Leaning(Gated):
    """The same with a pilot who holds the aircraft 0.7 m beside the target, in wind; the client holds the middle."""

    def _sticks(self):
        pilot = self._world.pilot
        if self._world.now >= SHUT and not isinstance(pilot.program, Aside):
            pilot.program = Aside(self._world)
        return super()._sticks()

    def _setpoint(self, goal, at):
        return Told._setpoint(self, goal, at)

    def record_end(self):
        """How far it is from the middle now [m]."""
        return math.hypot(*self._world.truth.position_enu[:2])


class Aside(HandFlight):
    """A pilot who carries the aircraft to a place, and leans against the wind there."""

    def __init__(self, world):
        super().__init__(height=2.0, flying=True)
        self._world = world

    def path(self, t):
        east, north = self._world.truth.position_enu[:2]
        return (0.7 - float(east), -float(north)), (0.0, 0.0)


@pytest.fixture(scope="module")
def silent():
    """A board that tells nothing of its gate."""
    rig = Gated(Flight(seed=1, wind=WindClass.INDOOR, seconds=9.0))
    rig.record = rig.fly()
    return rig


def test_a_shut_gate_is_noticed_told_and_nothing_winds_up(silent):
    assert silent.record.lost == ""
    noticed = silent.phases()[Phase.UNANSWERED]
    assert SHUT < noticed < SHUT + 2.5
    # Then sticks are level. In still air an aircraft that a pilot holds level looks as if it answered: then the flight
    # goes on with small ones.
    assert silent.sticks(noticed + 0.3, noticed + 0.8) == 0
    assert silent.sticks(OPENED - 0.1, OPENED) <= 30
    warnings = [action.text for _, action in silent.of(Warn)]
    assert any("does not answer its sticks" in text and "open the gate" in text for text in warnings)


def test_nothing_is_learnt_from_sticks_that_do_not_act(silent):
    gains = [value.stick_gain for value in silent.estimates]
    assert gains[-1] == 1.0
    noticed = silent.phases()[Phase.UNANSWERED]
    assert not any("angle per stick count" in action.text for _, action in silent.of(Warn, noticed))


def test_an_opened_gate_is_flown_through_again_where_the_aircraft_is(silent):
    assert silent.phase_at(9.0) is Phase.FLYING
    positions = [p for at, p in zip(silent.record.times, silent.record.positions, strict=True) if at > OPENED]
    assert max(float(abs(p - positions[0])[:2].max()) for p in positions) < 0.6


@pytest.fixture(scope="module")
def told():
    """A board that reports its gate, and a pilot who carries the aircraft aside in wind; nobody changes it."""
    rig = Leaning(Flight(seed=1, wind=WindClass.MODERATE, seconds=OPENED + 3.0))
    rig.tells = True
    assert rig.fly().lost == ""
    return rig


def test_a_board_that_reports_its_gate_is_believed_at_once(told):
    assert told.phases()[Phase.UNANSWERED] == pytest.approx(SHUT, abs=0.05)
    assert told.sticks(SHUT + 0.3, OPENED) == 0
    assert told.phase_at(OPENED - 0.1) is Phase.UNANSWERED


def test_an_opened_gate_is_flown_through_from_where_the_pilot_left_the_aircraft_in_wind(told):
    """Level sticks have nothing against the wind: who waited for a nearer or slower aircraft saw it blown away."""
    assert told.phase_at(OPENED + 0.5) is Phase.FLYING
    assert told.phase_at(OPENED + 3.0) is Phase.FLYING
    assert told.record_end() < 0.5


def test_the_watch_goes_by_the_line_that_was_measured():
    sight = Sight(AutopilotConfig(), -2.0)
    confirm = RoundTripStats(p50_ms=1000.0 * CONFIRMED_BY_CABLE + 200.0)  # 100 ms more each way than a cable
    sight.link_measured(LinkHealth.model_construct(echo=RoundTripStats(), confirm=confirm))
    for k in range(10):
        sight.sticks_made(StickCounts(20, 0, 0, 0), OURS, 1.0 + 0.02 * k)
    for at, has_tilted in ((1.10, False), (1.19, True)):
        sight.answer.attitude_received(at, 0.0, 0.0, says_something=False)
        assert bool(sight.answer.expected[0] > 0.0) is has_tilted


def test_the_watch_goes_by_the_stick_filter_that_was_found():
    expected = []
    for model in (AircraftModel(), AircraftModel().with_other_filter()):
        watch = AnswerWatch(AircraftModel())
        watch.model_found(model)
        for k in range(10):
            watch.sent(20.0, 0.0, 1.0 + 0.02 * k)
        watch.attitude_received(1.2, 0.0, 0.0, says_something=False)
        expected.append(watch.expected[0])
    assert expected[1] > 1.5 * expected[0] > 0.0
