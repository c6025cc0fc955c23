"""Position, velocity and attitude setpoints against a target: entry, flight, loss of sight; the whole core decides."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from lab.control.camera import CameraModel, rotation_of
from lab.control.flights import Flight
from mkdaemon.config.autopilot import AutopilotConfig
from mkdaemon.control.actions import (
    PublishError,
    PublishEstimate,
    ReleaseAircraft,
    ReportCommand,
    ReportFailsafe,
    ReportMode,
    SendSticks,
)
from mkdaemon.control.estimator.values import TargetView
from mkdaemon.control.events import Released
from mkdaemon.control.manoeuvres.land import LandingPhase
from mkdaemon.control.sight import velocity_between
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.setpoint import LandSetpoint, SetpointFrame, VelocitySetpoint
from mksim.config import WindClass
from tests.control.coreflights import Plan, UntilReleased

CFG = AutopilotConfig()
BASE = {"epoch": 1, "sequence": 1, "ttl": 0.3}
CALM = Flight(seed=4, wind=WindClass.INDOOR, seconds=7.0)


FORWARD, TURNS = 6.0, 8.0
"""A flight that holds a position is asked for a velocity, then to turn [s]."""


@pytest.fixture(scope="module")
def held():
    """That flight, one second of it out of sight, and its record; nobody changes either."""
    forward = {"velocity": (0.3, 0.0, 0.0), "frame": SetpointFrame.BODY}
    turn = {"velocity": (0.0, 0.0, 0.0), "frame": SetpointFrame.PAD, "yaw_rate": 0.15}
    flight = replace(CALM, camera=CameraModel(gone=((3.0, 4.0),)), seconds=10.0)
    rig = Plan(flight, (FORWARD, VelocitySetpoint, forward), (TURNS, VelocitySetpoint, turn))
    return rig, rig.fly()


def test_the_core_holds_a_position_after_a_short_loss_of_sight_too_and_says_what_it_believes(held):
    rig, record = held
    assert record.lost == ""
    assert rig.core.phase is Phase.FLYING
    late = [error for at, error in zip(record.times, record.errors, strict=True) if 5.8 < at < FORWARD]
    assert max(math.hypot(*error[:2]) for error in late) < 0.25
    last = rig.estimates[-1]
    assert last.position == pytest.approx(record.positions[-1], abs=0.1)
    assert last.image_age < 0.25
    spread = np.array(last.covariance)
    assert np.sqrt(spread[:, 0]) == pytest.approx(last.position_sd)
    assert (spread[:, 0] * spread[:, 2] > spread[:, 1] ** 2).all(), "positive definite"
    assert all(s.is_limited is (s.wanted != s.counts) for _, s in rig.of(SendSticks)[-50:])


def test_no_flight_begins_before_images_have_agreed_for_a_while(held):
    rig, _ = held
    began, _ = rig.first(ReportMode, after=Phase.FLYING)
    assert began >= CFG.entry_clean
    assert not rig.of(SendSticks, end=began)


LANDS = 4.0
"""When the client asks to land [s]."""


class Lands(UntilReleased, Plan):
    """From then on the client asks to land; keeps what was true when it was said to be down.

    Attributes:
        is_aborted: somebody asks for an abort as soon as the landing has committed.
    """

    stood: bool | None = None
    is_aborted = False

    def __init__(self, flight):
        super().__init__(flight, (LANDS, LandSetpoint, {}))

    def _control(self, at):
        landing = getattr(self.core._flown.current, "landing", None)
        if landing is not None and landing.phase is LandingPhase.COMMIT and self.is_aborted:
            self.abort_at, self.is_aborted = at, False
        super()._control(at)
        if landing is not None and landing.phase is LandingPhase.DOWN and self.stood is None:
            self.stood = self._world.truth.on_ground


@pytest.fixture(scope="module")
def landed():
    """A landing on a target that moves; nobody changes it."""
    rig = Lands(replace(CALM, land_at=LANDS, pad=(0.3, 0.2), pad_starts=3.0, seconds=21.0))
    return rig, rig.fly()


def test_a_landing_ends_on_the_target_with_a_release_that_is_no_failsafe(landed):
    rig, record = landed
    released_at, released = rig.first(ReleaseAircraft)
    assert record.touch_error < 0.12
    assert record.touch_sink < 0.6
    assert released.reason == "landed on pad"
    assert rig.status.hands.startswith("pulls the throttle down")
    assert released_at >= record.touched + 0.3
    assert rig.counts()[-1].throttle <= -90
    assert not [report for _, report in rig.of(ReportCommand, LANDS, released_at) if report.result.token]
    rig.core.feed(Released(None), released_at)
    rig.actions += [(released_at, action) for action in rig.core.tick(released_at)]
    assert not rig.of(ReportFailsafe)


def land_in_wind(gone, *, is_aborted=False):
    """A landing in light wind during which the target goes out of sight [s]; and its record."""
    camera = CameraModel(gone=((gone, 99.0),))
    rig = Lands(Flight(seed=5, wind=WindClass.LIGHT, seconds=15.0, land_at=LANDS, camera=camera))
    rig.is_aborted = is_aborted
    return rig, rig.fly()


@pytest.fixture(scope="module")
def blind_at_its_end():
    """A landing whose last images come 26 cm above the target, aborted after its last decision; nobody changes it."""
    return land_in_wind(10.3, is_aborted=True)


@pytest.mark.parametrize("flight", ["landed", "blind_at_its_end"])
def test_the_estimate_ends_where_the_feet_stand(flight, request):
    rig, record = request.getfixturevalue(flight)
    assert rig.stood is True, "it is not called down in the air"
    assert record.touch_error < 0.2
    assert record.touch_sink < 0.6
    last_at, last = rig.of(PublishEstimate)[-1]
    assert last_at < rig.first(ReleaseAircraft)[0] - 0.3
    assert rig.of(PublishError)[-1][0] <= last_at
    assert min(value.position[2] for value in rig.estimates) > 0.0
    assert last.value.velocity[2] > -1.0


def test_an_abort_after_the_last_decision_changes_nothing(blind_at_its_end):
    rig, _ = blind_at_its_end
    assert rig.first(ReportMode, after=Phase.ABORTED)
    assert rig.first(ReleaseAircraft)[1].reason == "landed on pad"


def test_a_descent_without_images_before_the_commit_rises_then_is_released_and_never_down():
    gone = 8.05
    rig, _ = land_in_wind(gone)
    released_at, release = rig.first(ReleaseAircraft)
    assert rig.stood is None
    assert released_at == pytest.approx(gone + CFG.exit_after, abs=0.2)
    assert "no image of pad" in release.reason
    assert min(counts.throttle for counts in rig.counts(gone + 1.2, released_at)) > -30


def test_a_velocity_is_flown_in_its_frame_and_then_turns(held):
    rig, record = held
    start, end = (next(k for k, time in enumerate(record.times) if time > at) for at in (FORWARD, TURNS))
    x, y, z = record.positions[end] - record.positions[start]
    assert math.hypot(x, y) == pytest.approx(0.5, abs=0.15)
    assert math.atan2(y, x) == pytest.approx(0.3, abs=0.25), "the nose points there"
    assert z == pytest.approx(0.0, abs=0.1)
    assert rig.estimates[-1].yaw - rig.estimates[-101].yaw == pytest.approx(0.15 * 2.0, abs=0.12)
    assert math.hypot(*(record.positions[-1] - record.positions[end])[:2]) < 0.35, "on the spot"


def test_two_views_whose_tilts_disagree_by_half_a_radian_give_the_speed_of_the_aircraft():
    spread = np.diag([0.5, 0.5, 0.1, 0.5, 0.5, 0.01]) ** 2
    before = TargetView(1.0, np.array([-0.30, 0.0, -1.00]), rotation_of(np.array([0.0, 0.3, 0.0])), spread)
    view = TargetView(1.04, np.array([-0.32, 0.0, -1.04]), rotation_of(np.array([0.2, -0.2, 0.0])), spread)
    assert velocity_between(before, view) == pytest.approx([0.5, 0.0, 1.0], abs=0.02)
    assert velocity_between(before, before) is None
