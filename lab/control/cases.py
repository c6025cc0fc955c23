"""The cases of `python -m lab control`: what is flown, how often, and what is measured of it."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np

from lab.control.camera import CameraModel
from lab.control.corerig import HandoverRig, TakeOffRig
from lab.control.flights import Flight, Record
from lab.control.rig import Rig, believed_model
from mkdaemon.control.linear import Array
from mkdaemon.control.regulator.autopilot import Goal
from mksim.config import WindClass
from mksim.physics.attitude_loop import EASY, LEAK_SLOW, AttitudeGains

SETTLED: Final = 12.0
"""Figures of a hover are taken after this [s]."""
HELD: Final = 8.0
"""After a hand-over they are taken after this [s]."""
LAST_TICK: Final = 39.5
"""Who is flown to the end is flown until then, of 40 s [s]."""
STEP_AT: Final = 15.0
"""[s]."""
STEP_FROM: Final = 0.5
"""A step begins so far before the middle of the target [m]."""
STICK_GAINS: Final = (0.67, 0.75, 1.33, 1.49)
"""Stick gains of an aircraft over those of the model it is flown by."""
TAKEN_OFF: Final = 22.0
"""A take-off has come to its end by then [s]."""
NEAR: Final = 0.6
"""Who is nearer than this to the place over the middle holds it [m]."""
PAD_RADIUS: Final = 0.25
"""A touch farther from the middle is beside the pad [m]: the nested target's print is 0.6 m wide."""
REPORTING: Final = 50_000_000
"""First seed of reported figures; tuning uses seeds below 1000."""

NEWER_NAVICTRL: Final = AttitudeGains.from_parameters(**EASY, ta=LEAK_SLOW)
"""A NaviCtrl newer than 0.24 slows the leak."""


@dataclass(frozen=True, slots=True)
class Case:
    """One row of figures.

    Attributes:
        measure: key of each figure and its value from a record: infinite where what was to happen never did, not a
            number where nothing was to be measured.
        goals: largest median (or for `_p90` keys, 90th percentile) that meets the goal, by key.
        rig: what flies it; by default a camera that is a noise model, and no flight core.
    """

    flight: Callable[[int], Flight]
    flights: int
    measure: Callable[[Record], dict[str, float]]
    goals: dict[str, float]
    rig: type[Rig] = Rig


def level_rms_cm(errors: Array) -> float:
    """Horizontal RMS of errors (n, 3) [m]; not a number for none."""
    return 100 * math.sqrt(float((errors[:, :2] ** 2).sum(axis=1).mean())) if len(errors) else math.nan


def hover_rms(key: str, record: Record) -> dict[str, float]:
    """Horizontal RMS of a hover [cm]."""
    return {key: level_rms_cm(np.array(record.errors)[np.array(record.times) > SETTLED])}


def handover_figures(prefix: str, record: Record) -> dict[str, float]:
    """Horizontal RMS from `HELD` after the hand-over on [cm], and whether it was flown to the end [%]."""
    times = np.array(record.times)
    errors = np.array(record.errors)[times > times[0] + HELD] if len(times) else np.empty((0, 3))
    is_held = bool(len(errors)) and times[-1] > LAST_TICK
    return {f"{prefix}_rms_cm": level_rms_cm(errors), f"{prefix}_success_percent": 100.0 * is_held}


def step_figures(record: Record) -> dict[str, float]:
    """Time to nine tenths [s] and overshoot [%] of a step of 1 m along x; infinite where it does not get there."""
    times, east = np.array(record.times), np.array(record.positions)[:, 0] + STEP_FROM
    after, moved = times[times >= STEP_AT] - STEP_AT, east[times >= STEP_AT]
    reached = np.flatnonzero(moved > 0.9)
    return {
        "step_1m_t90_s": float(after[reached[0]]) if len(reached) else math.inf,
        "step_overshoot_percent": 100 * max(0.0, float(moved.max()) - 1.0) if len(reached) else math.inf,
    }


def landing_figures(prefix: str, record: Record) -> dict[str, float]:
    """Distance at the touch [cm], sink [m/s], and whether it stands on the pad [%]."""
    stands = record.stands and not record.lost and record.touch_error <= PAD_RADIUS
    return {
        f"{prefix}_p90_cm": 100 * record.touch_error,
        f"{prefix}_sink": record.touch_sink,
        f"{prefix}_success_percent": 100.0 * stands,
    }


def furthest(key: str, start: float, end: float, record: Record) -> dict[str, float]:
    """Largest horizontal error in a time [cm]."""
    times = np.array(record.times)
    errors = np.array(record.errors)[(times >= start) & (times < end)]
    return {key: 100 * float(np.hypot(errors[:, 0], errors[:, 1]).max()) if len(errors) else math.nan}


def survival(key: str, record: Record) -> dict[str, float]:
    """Whether the aircraft was lost [%]."""
    return {key: 100.0 * bool(record.lost)}


def step_goal(t: float) -> Goal:
    """1 m along x, once, across the target: half a metre to a side it is still in sight while the aircraft leans."""
    return Goal(position=np.array([1.0 - STEP_FROM if t >= STEP_AT else -STEP_FROM, 0.0, 2.0]))


def takeoff_figures(prefix: str, record: Record) -> dict[str, float]:
    """Whether the last seconds are spent over the target at height [%], and how far it was from the middle [cm]."""
    places, times = np.array(record.positions), np.array(record.times)
    last = places[times > TAKEN_OFF]
    stands = bool(len(last)) and bool((np.linalg.norm(last - [0.0, 0.0, 2.0], axis=1) < NEAR).all())
    return {
        f"{prefix}_success_percent": 100.0 * (stands and not record.lost),
        f"{prefix}_farthest_cm": 100.0 * float(np.hypot(places[:, 0], places[:, 1]).max()),
    }


def _hover(name: str, wind: WindClass, goal: float, rig: type[Rig] = Rig) -> Case:
    """A hover at 2 m, and the largest RMS that is good [cm]."""
    key = f"{name}_rms_cm"
    return Case(lambda seed: Flight(seed=seed, wind=wind), 40, partial(hover_rms, key), {key: goal}, rig)


def _landing(name: str, goal: float, pad: tuple[float, float] = (0.0, 0.0)) -> Case:
    """A landing, and how far from the middle of a target with some velocity [m/s] a good one may be [cm]."""
    goals = {f"{name}_p90_cm": goal, f"{name}_sink": 0.6, f"{name}_success_percent": 98.0}
    flight = partial(Flight, wind=WindClass.LIGHT, pad=pad, land_at=15.0, seconds=60.0)
    return Case(lambda seed: flight(seed=seed), 60, partial(landing_figures, name), goals)


def _take_off(seed: int) -> Flight:
    """A take-off, standing up to 14 cm beside the middle."""
    rng = random.Random(f"{seed} place")
    place = (rng.uniform(-0.1, 0.1), rng.uniform(-0.1, 0.1))
    return Flight(seed=seed, wind=WindClass.LIGHT, start=0.0, place=place, seconds=25.0)


def _wrong(seed: int) -> Flight:
    """A model that is wrong in one way, drawn from the seed: the aircraft's stick gain over the model's first."""
    true = believed_model(AttitudeGains.from_parameters(**EASY))
    flight = Flight(seed=seed, wind=WindClass.LIGHT)
    kinds: Sequence[Flight] = (
        *(replace(flight, model=replace(true, rad_per_count=true.rad_per_count / gain)) for gain in STICK_GAINS),
        replace(flight, mass=1.0),
        replace(flight, mass=1.5),
        replace(flight, camera=CameraModel(stamp_error=0.020)),
        replace(flight, camera=CameraModel(stamp_error=-0.020)),
        replace(flight, gains=NEWER_NAVICTRL, model=true),
        replace(flight, attitude_scale=0.89),
        replace(flight, attitude_scale=1.13),
    )
    return kinds[seed % len(kinds)]


CASES: Final = {
    "hover_indoor": _hover("hover_indoor", WindClass.INDOOR, 4.0),
    "hover_light": _hover("hover_light", WindClass.LIGHT, 10.0),
    "hover_moderate": _hover("hover_moderate", WindClass.MODERATE, 18.0),
    "step": Case(
        lambda seed: Flight(seed=seed, wind=WindClass.INDOOR, goal=step_goal, seconds=25.0),
        *(20, step_figures, {"step_1m_t90_s": 1.8, "step_overshoot_percent": 10.0}),
    ),
    "land_light": _landing("land_static_light", 9.0),
    "land_moving": _landing("land_moving_light", 10.0, pad=(0.4, 0.3)),
    "tag_gone": Case(
        lambda seed: Flight(seed=seed, wind=WindClass.LIGHT, camera=CameraModel(gone=((20.0, 21.0),)), seconds=30.0),
        *(40, partial(furthest, "tag_gone_1s_max_cm", 20.0, 25.0), {"tag_gone_1s_max_cm": 50.0}),
    ),
    "wrong_model": Case(_wrong, 110, partial(survival, "wrong_model_lost_percent"), {"wrong_model_lost_percent": 0.0}),
    "handover_moderate": replace(
        _hover("handover_moderate", WindClass.MODERATE, 18.0, HandoverRig),
        measure=partial(handover_figures, "handover_moderate"),
    ),
    "takeoff_light": Case(
        *(_take_off, 40, partial(takeoff_figures, "takeoff_light"), {"takeoff_light_success_percent": 98.0}),
        rig=TakeOffRig,
    ),
}
"""By name."""
