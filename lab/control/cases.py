"""The cases of `python -m lab control`: what is flown, how often, and what is measured of it."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Final

import numpy as np

from lab.campaign import Row
from lab.control.camera import CameraModel
from lab.control.corerig import TakeOffRig
from lab.control.flights import Flight, Record
from lab.control.rig import Rig, believed_model
from mkdaemon.control.regulator.autopilot import Goal
from mksim.config import WindClass
from mksim.physics.attitude_loop import EASY, LEAK_SLOW, AttitudeGains

SETTLED: Final = 12.0
"""Figures of a hover are taken after this [s]."""
STEP_AT: Final = 15.0
"""[s]."""
STEP_FROM: Final = 0.5
"""A step begins so far before the middle of the target [m]."""
STICK_GAINS: Final = (0.67, 0.75, 1.33, 1.49)
"""Stick gains of an aircraft over those of the model it is flown by."""
GONE: Final = (20.0, 21.0)
"""The target is out of sight [s]."""
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
    """One group of flights.

    Attributes:
        measure: figures of a record; `why`, where it did not do what it was flown for.
        goals: which share of the flights does not exceed what, by figure.
        rig: what flies it; by default a camera that is a noise model, and no flight core.
        finishing: share of the flights that must do what they are flown for; none may be lost.
    """

    flight: Callable[[int], Flight]
    flights: int
    measure: Callable[[Record], Row]
    goals: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    rig: type[Rig] = Rig
    finishing: float = 1.0


def hover_figures(record: Record) -> Row:
    """Horizontal RMS of a hover [cm]."""
    errors = np.array(record.errors)[np.array(record.times) > SETTLED]
    return {"rms_cm": 100 * math.sqrt(float((errors[:, :2] ** 2).sum(axis=1).mean()))} if len(errors) else {}


def step_figures(record: Record) -> Row:
    """Time to nine tenths [s] and overshoot [%] of a step of 1 m along x."""
    times, east = np.array(record.times), np.array(record.positions)[:, 0] + STEP_FROM
    after, moved = times[times >= STEP_AT] - STEP_AT, east[times >= STEP_AT]
    reached = np.flatnonzero(moved > 0.9)
    if not len(reached):
        return {"why": "it never came to nine tenths"}
    return {"t90_s": float(after[reached[0]]), "overshoot_percent": 100 * max(0.0, float(moved.max()) - 1.0)}


def landing_figures(record: Record) -> Row:
    """Distance from the middle [cm] and sink [m/s] at the touch."""
    stands = record.stands and record.touch_error <= PAD_RADIUS
    why = {} if stands else {"why": "it does not stand on the pad"}
    return {"touch_cm": 100 * record.touch_error, "sink": record.touch_sink} | why


def gone_figures(record: Record) -> Row:
    """Largest horizontal error while the target is out of sight, and 4 s after [cm]."""
    times = np.array(record.times)
    errors = np.array(record.errors)[(times >= GONE[0]) & (times < GONE[1] + 4.0)]
    return {"farthest_cm": 100 * float(np.hypot(errors[:, 0], errors[:, 1]).max())} if len(errors) else {}


def takeoff_figures(record: Record) -> Row:
    """How far it was from the middle [cm]; it has taken off where the last seconds are over the target at height."""
    places, times = np.array(record.positions), np.array(record.times)
    last = places[times > TAKEN_OFF]
    holds = bool(len(last)) and bool((np.linalg.norm(last - [0.0, 0.0, 2.0], axis=1) < NEAR).all())
    why = {} if holds else {"why": "it does not hold over the target"}
    return {"farthest_cm": 100.0 * float(np.hypot(places[:, 0], places[:, 1]).max())} | why


def step_goal(t: float) -> Goal:
    """1 m along x, once, across the target: half a metre to a side it is still in sight while the aircraft leans."""
    return Goal(position=np.array([1.0 - STEP_FROM if t >= STEP_AT else -STEP_FROM, 0.0, 2.0]))


def _hover(wind: WindClass, goal: float) -> Case:
    """A hover at 2 m, and the largest RMS that is good [cm]."""
    return Case(lambda seed: Flight(seed=seed, wind=wind), 40, hover_figures, {"rms_cm": (0.5, goal)})


def _landing(goal: float, pad: tuple[float, float] = (0.0, 0.0)) -> Case:
    """A landing, and how far from the middle of a target with some velocity [m/s] a good one may be [cm]."""
    goals = {"touch_cm": (0.9, goal), "sink": (0.9, 0.6)}
    flight = partial(Flight, wind=WindClass.LIGHT, pad=pad, land_at=15.0, seconds=60.0)
    return Case(lambda seed: flight(seed=seed), 60, landing_figures, goals, finishing=0.98)


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
    "hover_indoor": _hover(WindClass.INDOOR, 4.0),
    "hover_light": _hover(WindClass.LIGHT, 10.0),
    "hover_moderate": _hover(WindClass.MODERATE, 18.0),
    "step": Case(
        lambda seed: Flight(seed=seed, wind=WindClass.INDOOR, goal=step_goal, seconds=25.0),
        *(20, step_figures, {"t90_s": (0.5, 1.8), "overshoot_percent": (0.9, 10.0)}),
    ),
    "land_light": _landing(9.0),
    "land_moving": _landing(10.0, pad=(0.4, 0.3)),
    "tag_gone": Case(
        lambda seed: Flight(seed=seed, wind=WindClass.LIGHT, camera=CameraModel(gone=(GONE,)), seconds=30.0),
        *(40, gone_figures, {"farthest_cm": (0.5, 50.0)}),
    ),
    "wrong_model": Case(_wrong, 110, lambda record: {}),
    "takeoff_light": Case(_take_off, 40, takeoff_figures, rig=TakeOffRig, finishing=0.98),
}
"""By name."""
