"""The random events for the flight core: that all holds, and that a core that breaks a promise is found."""

from __future__ import annotations

from dataclasses import replace

import pytest

from lab.control.corefuzz import Breach, Fuzz, run_sequence
from mkdaemon.control.actions import SendSticks
from mkdaemon.control.flown import Flown
from mkdaemon.control.limiter import StickCounts
from mkdaemon.control.output import StickOutput


def test_a_sequence_is_the_same_again_and_flies():
    first, second = run_sequence(11, 60), run_sequence(11, 60)
    assert first == second
    assert not first.breaches
    assert sum(sum(run_sequence(seed, 60).flown.values()) for seed in range(4)) > 2.0


def broken(monkeypatch, **change):
    """A core whose every stick frame is changed."""
    made = StickOutput.make
    monkeypatch.setattr(StickOutput, "make", lambda *args, **words: replace(made(*args, **words), **change))


@pytest.mark.parametrize(
    ("change", "breach"),
    [
        ({"counts": StickCounts(120, 0, 0, 0)}, Breach.LIMITS),
        ({"epoch": 7}, Breach.NO_LEASE),
        ({"counts": StickCounts(5, 0, 0, 0), "age": 0.5}, Breach.NOT_NEUTRAL),
    ],
    ids=str,
)
def test_a_frame_that_must_not_be_is_found(monkeypatch, change, breach):
    broken(monkeypatch, **change)
    found = [line for seed in range(3) for line in run_sequence(seed, 60).breaches]
    assert any(line.startswith(breach.name) for line in found)


def test_an_exception_is_found(monkeypatch):
    def fail(*_):
        raise ZeroDivisionError

    monkeypatch.setattr(Flown, "step", fail)
    found = [line for seed in range(3) for line in run_sequence(seed, 60).breaches]
    assert any(line.startswith(Breach.EXCEPTION.name) and "ZeroDivisionError" in line for line in found)


def test_throttle_that_lifts_standing_feet_is_found():
    fuzz = Fuzz(0)
    fuzz.now, fuzz.up_at, fuzz.heard = 5.0, 0.0, 5.0
    frames = []
    fuzz._breach = lambda what, seen: frames.append(what)
    fuzz.toy.place[2] = 0.1
    fuzz._look_at_sticks(SendSticks(StickCounts(0, 0, 0, 40), 6.0, 0, 1, 0.0, False))
    assert Breach.LIFTS in frames
