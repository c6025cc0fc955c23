"""The stick gain is found from what the boards report, and is the model's where the boards' scale may explain it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from mkdaemon.control.estimator.model import AircraftModel
from mkdaemon.control.estimator.stickresponse import STEP, StickResponse
from mkdaemon.control.linear import discretise

MODEL = AircraftModel()


def flown(gain, *, size=0.08, seconds=5.0, late=0.024, hold=0.0, model=MODEL, aircraft=MODEL, wind=0.0, start=0.0,
          stamped=None, lost=(9.0, 9.0), weak=(9.0, 9.0), rest=0.0):  # fmt: skip
    """What is found of an aircraft whose sticks ask for so much more tilt than the model's.

    Its reports come `late`, and are taken to be of the time `stamped` before; sticks of the time `lost` do not act.
    They are at rest at first, and in the time `weak` ask for half of what they should.
    """
    f, g = discretise(*by_equations(aircraft), STEP)
    found, state = StickResponse(model, start), np.zeros((2, 4))
    reports, acting = [], np.zeros(2)
    for k in range(round(seconds / STEP)):
        now = k * STEP
        asked = size * np.array([math.sin(2.0 * now), math.cos(3.0 * now)]) * (now >= rest)
        found.sent(start + now, asked)
        acting = acting if lost[0] <= now < lost[1] else asked
        state = state @ f.T + gain * (0.5 if weak[0] <= now < weak[1] else 1.0) * acting[:, None] * g[:, 0]
        reports.append((start + now + STEP, state[:, 0] + wind))
        if k % 2 == 0 and now > late + hold:
            at, tilt = reports[-1 - round(late / STEP)]
            found.attitude_received(at + (0.0 if stamped is None else late - stamped), tilt)
    return found


@pytest.mark.parametrize(
    ("gain", "options", "measured", "believed"),
    [
        *((gain, {"seconds": 2.5 if gain < 1.0 else 2.2}, gain, gain) for gain in (0.67, 0.75, 1.33, 1.5)),
        # Before two seconds only a larger one is, and only if it is larger than an aircraft that is handed over shows.
        *((0.67, {"seconds": 1.9, "start": start}, None, 1.0) for start in (0.0, 500.0)),
        *((1.5, {"seconds": 1.9, "start": start}, 1.5, 1.5) for start in (0.0, 500.0)),
        (1.28, {"seconds": 1.9}, None, 1.0),
        (1.28, {"seconds": 3.0}, 1.28, 1.28),
        *((gain, {}, gain, 1.0) for gain in (0.89, 1.0, 1.13)),  # the boards' scale may explain it
        (1.5, {"wind": 0.1, "seconds": 3.0}, 1.5, 1.5),
        (1.5, {"size": 0.0001}, 1.0, 1.0),  # sticks at rest tell nothing
        (5.0, {}, 2.0, 2.0),  # no aircraft has it
        (0.1, {}, 0.5, 0.5),
    ],
)
def test_a_gain_is_believed_once_it_differs_for_long_enough_by_more_than_the_boards_scale(
    gain, options, measured, believed
):
    found = flown(gain, **options)
    assert found.gain == pytest.approx(believed, abs=0.05 if believed != 1.0 else 0.0)
    assert measured is None or found.measured == pytest.approx(measured, abs=0.05)


@pytest.mark.parametrize("seconds", [6.6, 6.8, 7.0, 7.2, 8.0])
def test_an_answer_that_is_weak_for_a_moment_is_no_smaller_gain(seconds):
    found = flown(1.0, size=0.2, seconds=seconds, rest=6.0, weak=(6.0, 6.4))
    assert found.measured < 0.95
    assert found.gain == 1.0


@pytest.mark.parametrize("gain", [0.7, 1.0, 1.4])
@pytest.mark.parametrize("model", [MODEL, MODEL.with_other_filter()])
def test_the_stick_filter_that_the_aircraft_has_is_found_within_a_second_of_reports(model, gain):
    for aircraft in (MODEL, MODEL.with_other_filter()):
        found = flown(gain, seconds=1.4, model=model, aircraft=aircraft)
        assert found.has_other_filter == (aircraft != model)
        assert found.measured == pytest.approx(gain, abs=0.06)


def test_attitudes_that_come_too_late_are_left_out():
    found = StickResponse(MODEL, 0.0)
    for k in range(400):
        found.sent(k * STEP, np.array([0.1, 0.1]))
        found.attitude_received(k * STEP, np.array([0.0, 0.0]))
    before = found.measured
    found.attitude_received(0.5, np.array([9.0, 9.0]))
    assert found.measured == before == 0.5


def test_before_sticks_act_the_boards_tell_nothing_of_them():
    found = StickResponse(MODEL, 0.0)
    found.sent(10.0, np.array([0.1, 0.1]))
    for k in range(300):
        found.attitude_received(k * STEP, np.array([0.2 * math.sin(0.1 * k), 0.0]))
    assert found.measured == 1.0
    assert not found.has_other_filter


SLOW = 0.7
"""What is slower is left out: docs/lab/control.md, "Estimator" [s]."""


def believed(model, frequency):
    """Believed tilt over a stick that swings at a frequency [rad/s], less what changes slowly."""
    s = 1j * frequency
    stick = 1.0 / (1.0 + s * model.stick_filter)
    # Rate and tilt: (tw s + 1) w = a1 (us - th) - a2 (th - us) / s, and (s + 1 / ta) th = w.
    loop = (model.a1 + model.a2 / s) / (model.rate_lag * s + 1.0)
    tilt = loop / (s + 1.0 / model.leak + loop)
    return stick * tilt * (s * SLOW / (1.0 + s * SLOW))


def swung(size, *, gain=1.0, seconds=14.0, model=MODEL, frequencies=(5.0, 7.0)):
    """What is found of an aircraft whose sticks swing, each axis at its own frequency, for long enough to settle."""
    found, response = StickResponse(model, 0.0), []
    for frequency in frequencies:
        s = 1j * frequency
        response.append(believed(MODEL, frequency) * (1.0 + s * SLOW) / (s * SLOW))
    for k in range(round(seconds / STEP)):
        now = k * STEP
        found.sent(now, size * np.array([math.sin(frequency * now) for frequency in frequencies]))
        if k % 2 == 0:
            swings = [np.exp(1j * w * (now - STEP / 2.0)) * h for w, h in zip(frequencies, response, strict=True)]
            found.attitude_received(now, gain * size * np.array(swings).imag)
    return found


@pytest.mark.parametrize(("mean_deg", "tells"), [(0.9, False), (1.12, True)])
def test_a_mean_tilt_of_one_degree_tells_enough(mean_deg, tells):
    """The filter through which less motion comes counts."""
    per_count = min(
        math.sqrt(sum(abs(believed(model, frequency)) ** 2 / 2.0 for frequency in (5.0, 7.0)))
        for model in (MODEL, MODEL.with_other_filter())
    )
    found = swung(math.radians(mean_deg) / per_count, gain=1.5)
    assert found.measured == pytest.approx(1.5 if tells else 1.0, rel=0.03)


def test_the_filter_is_the_models_until_sticks_have_acted_for_seven_tenths_of_a_second():
    aircraft = MODEL.with_other_filter()
    assert not flown(1.0, seconds=0.7, aircraft=aircraft, size=0.3).has_other_filter
    assert flown(1.0, seconds=0.8, aircraft=aircraft, size=0.3).has_other_filter


def held_for(seconds):
    """Believed tilt after a stick of 0.1 rad was held so long, by the model."""
    _, g = discretise(*by_equations(MODEL), seconds)
    return 0.1 * g[0, 0]


def by_equations(model):
    """Rates of believed tilt, its integral, its rate and the filtered stick."""
    k = 1.0 / model.rate_lag
    return (
        np.array(
            [
                [-1.0 / model.leak, 0.0, 1.0, 0.0],
                [1.0, 0.0, 0.0, -1.0],
                [-k * model.a1, -k * model.a2, -k, k * model.a1],
                [0.0, 0.0, 0.0, -1.0 / model.stick_filter],
            ]
        ),
        np.array([[0.0], [0.0], [0.0], [1.0 / model.stick_filter]]),
    )


def test_of_a_long_silence_one_second_is_computed():
    found = StickResponse(MODEL, 0.0)
    found.sent(0.0, np.array([0.1, 0.0]))
    found.attitude_received(0.3, np.zeros(2))
    found.attitude_received(0.9, np.zeros(2))
    assert found._expected[-1][0][0] == pytest.approx(held_for(0.9), rel=0.01)
    found.attitude_received(100.0, np.zeros(2))
    assert found._expected[-1][0][0] == pytest.approx(held_for(1.9), rel=0.01)


def test_a_silence_of_the_boards_leaves_nothing_to_catch_up():
    silent, told = StickResponse(MODEL, 0.0), StickResponse(MODEL, 0.0)
    for k in range(600):
        at = 0.02 * k
        for found in (silent, told):
            found.sent(at, np.array([0.1 * math.sin(at), 0.05]))
        told.attitude_received(at, np.zeros(2))
    assert at - silent._time < 0.4
    assert len(silent._commands) < 30
    silent.attitude_received(at, np.zeros(2))
    assert silent._expected[-1] == pytest.approx(told._expected[-1], abs=1e-12), "nothing of it is lost"


@pytest.mark.parametrize("lag", [-0.02, 0.0, 0.02, 0.03])
def test_what_the_line_delays_beyond_what_was_measured_is_found_with_the_filter(lag):
    model = replace(MODEL, line_sd=0.02)
    found = flown(1.0, model=model, late=0.06, stamped=0.06 - lag)
    assert found.lag == pytest.approx(lag, abs=0.006)
    assert not found.has_other_filter


def test_sticks_that_were_lost_are_no_smaller_gain():
    found, lost = flown(1.0, seconds=2.5, lost=(0.5, 0.8)), flown(0.6, seconds=2.5)
    assert found.gain == 1.0
    assert lost.gain == pytest.approx(0.6, abs=0.05)


def mean_lag(likelihood):
    """Mean of the delays that are thought of, each by its likelihood [s]."""
    lags = np.linspace(-0.03, 0.06, 10)
    weights = likelihood(lags)
    return weights @ lags / weights.sum()


def test_before_motion_delays_are_as_likely_as_what_was_measured_of_the_line_says():
    found = flown(1.0, size=0.0, model=replace(MODEL, line_sd=0.04), late=0.06, stamped=0.06)
    assert found.lag == pytest.approx(mean_lag(lambda lags: np.exp(-0.5 * (lags / 0.04) ** 2)), abs=2e-4)


def test_a_delay_is_as_likely_as_its_share_of_what_the_best_leaves_over():
    """A swing of frequency w leaves over sin2(w lag) of its mean square, and each delay 0.15 degrees; 20 residuals."""
    frequency, mean_square, least = 3.0, math.radians(0.15) ** 2, math.radians(0.15) ** 2
    size = math.sqrt(mean_square) / abs(believed(MODEL, frequency))
    found = swung(size, model=replace(MODEL, line_sd=9.0), frequencies=(frequency, frequency))
    expected = mean_lag(lambda lags: (1.0 + mean_square * np.sin(frequency * lags) ** 2 / least) ** -20.0)
    assert found.lag == pytest.approx(expected, abs=5e-4)


def test_a_first_report_that_is_as_old_as_the_beginning_weighs_nothing_and_breaks_nothing():
    """No time has passed then: a logarithm of zero, and warnings are errors in flight code."""
    found = StickResponse(MODEL, 10.0)
    found.sent(9.0, np.array([0.1, 0.0]))
    for at in (10.0, 10.0, 10.04):
        found.attitude_received(at, np.zeros(2))
    assert (found.lag, found.gain, found.has_other_filter) == (pytest.approx(0.0, abs=0.01), 1.0, False)
