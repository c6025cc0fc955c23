"""The random happenings around the flight core: a core that breaks a promise is found, whichever it breaks."""

from __future__ import annotations

import random
import warnings
from dataclasses import replace

import pytest

from lab.fuzz import core as corefuzz
from lab.fuzz.core import BLOCK, EVENTS, QUICK, Breach, draw, run, run_sequences, shortened
from lab.fuzz.coretoy import Toy
from lab.fuzz.coreworld import HAPPENINGS, Happening, World
from mkdaemon.control.actions import ReleaseAircraft
from mkdaemon.control.core import FlightCore
from mkdaemon.control.flown import Flown
from mkdaemon.control.limiter import StickCounts
from mkdaemon.control.manoeuvres.take_off import IDLE_GAS, TakeOff
from mkdaemon.control.output import StickOutput
from mkdaemon.control.reports import Reports

TICK, STATUS, MAKE = FlightCore.tick, Reports.status, StickOutput.make


def first_seed(*, stands):
    for seed in range(100):
        rng = random.Random(f"{seed} world")
        if World(rng, rng.choice((QUICK,))).toy.stands is stands:
            return seed
    raise LookupError


GROUND, AIR = first_seed(stands=True), first_seed(stands=False)
FLIGHT = [Happening("settle", 4, 4.0)]
"""A client that takes off, or lands, and nothing else."""


@pytest.fixture(autouse=True)
def _quick(monkeypatch):
    monkeypatch.setattr(corefuzz, "CONFIGS", (QUICK,))


def framed(**change):
    """Change every stick frame."""
    return lambda patch: patch.setattr(
        StickOutput, "make", lambda *args, **words: replace(MAKE(*args, **words), **change)
    )


def warned(patch):
    patch.setattr(Flown, "step", lambda *_: warnings.warn("log of zero", RuntimeWarning, stacklevel=1))


def lifted(patch):
    """Feet that stand, whatever images show, and throttle above hover."""
    framed(counts=StickCounts(0, 0, 0, 40))(patch)
    patch.setattr(Toy, "step", lambda self, now, dt: setattr(self, "stood_since", 0.0))


def unreleased(patch):
    def tick(self, now):
        return [action for action in TICK(self, now) if not isinstance(action, ReleaseAircraft)]

    patch.setattr(FlightCore, "tick", tick)


def misreported(patch):
    def status(self, *facts):
        self._authority.aborts += 1
        STATUS(self, *facts)
        self._authority.aborts -= 1

    patch.setattr(Reports, "status", status)


BREAKS = {
    Breach.EXCEPTION: (GROUND, warned),
    Breach.LIMITS: (GROUND, framed(counts=StickCounts(120, 0, 0, 0))),
    Breach.NO_LEASE: (GROUND, framed(epoch=7)),
    Breach.NOT_NEUTRAL: (GROUND, framed(counts=StickCounts(5, 0, 0, 0), age=0.5)),
    Breach.NOT_RELEASED: (GROUND, unreleased),
    Breach.LIFTS: (AIR, lifted),
    Breach.ENDLESS: (GROUND, lambda patch: patch.setattr(TakeOff, "gas", lambda *_: IDLE_GAS)),
    Breach.UNTRUE: (GROUND, misreported),
}
"""How a core breaks each promise, and the seed of a flight that shows it."""


@pytest.mark.parametrize("breach", Breach, ids=lambda breach: breach.name)
def test_a_core_that_breaks_a_promise_is_found(monkeypatch, breach):
    seed, broken = BREAKS[breach]
    happenings = [*FLIGHT, Happening("_release", 1, 0.1)]
    breaches, reached = run(seed, happenings)
    assert not breaches
    assert reached["in flight"]
    broken(monkeypatch)
    assert any(line.startswith(breach.name) for line in run(seed, happenings)[0])


def test_a_sequence_is_the_same_again():
    first, second = run(11, draw(11, 60)), run(11, draw(11, 60))
    assert first == second
    assert not first[0]


def test_everything_that_can_happen_is_drawn():
    drawn = {happening.what for seed in range(60) for happening in draw(seed, EVENTS)}
    assert drawn == {happening.__name__ for happening in HAPPENINGS}


def test_a_found_sequence_is_shortened_to_what_breaks_the_promise(monkeypatch):
    long = [*[Happening("_calm", 1, 0.0)] * 10, *FLIGHT, *[Happening("_renew", 1, 0.05)] * 9]
    monkeypatch.setattr(corefuzz, "draw", lambda seed, events: long)
    framed(epoch=7)(monkeypatch)
    assert shortened(GROUND, len(long)) == FLIGHT


def test_a_second_run_goes_on_where_the_first_ended(monkeypatch, tmp_path):
    monkeypatch.setattr(corefuzz, "BLOCK", 2)
    flown = []
    monkeypatch.setattr(corefuzz, "draw", lambda seed: flown.append(seed) or [Happening("heal", 1, 0.1)])
    file = tmp_path / "results.jsonl"
    first = run_sequences(0, 2, 1, file)
    second = run_sequences(0, 4, 1, file)
    assert flown == [0, 1, 2, 3]
    assert (first["sequences"], second["sequences"]) == (2, 4)
    assert second["reached"]["event ModelKnown"] == 2 * first["reached"]["event ModelKnown"] > 0
    assert BLOCK > 2
