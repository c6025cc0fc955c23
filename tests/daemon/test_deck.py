"""What stands between the flight core and the rest: what the core is told is recorded, even where it fails on it."""

from __future__ import annotations

import pytest

from mkdaemon.clock import Clock
from mkdaemon.config.control import ControlConfig
from mkdaemon.control.core import FlightCore
from mkdaemon.control.events import ClientGone, GuardChanged
from mkdaemon.daemon.deck import Deck
from tests.daemon.procedures.procedure_rig import Bus


class Tap:
    """Keeps what the core was told."""

    def __init__(self):
        self.told = []

    def fed(self, event, at, reply):
        self.told.append((event, at, reply))

    def ticked(self, at, slept):
        self.told.append(("tick", at, slept))


def deck(tap=None):
    return Deck(ControlConfig(), Bus(), Clock(monotonic=lambda: 5.0, wall=lambda: 1e9), first_epoch=1, tap=tap)


def test_events_and_ticks_are_recorded_in_order_with_their_answers():
    tap = Tap()
    made = deck(tap)
    noted = made.feed(GuardChanged(True), 1.0)
    made.core.tick(1.5, slept=0.25)
    due = made.feed(ClientGone("pilot"), 2.0)
    assert tap.told == [(GuardChanged(True), 1.0, noted), ("tick", 1.5, 0.25), (ClientGone("pilot"), 2.0, due)]


def test_an_event_on_which_the_core_fails_is_recorded_without_an_answer(monkeypatch):
    def fail(self, event, now):
        raise ZeroDivisionError

    tap = Tap()
    made = deck(tap)
    monkeypatch.setattr(FlightCore, "feed", fail)
    with pytest.raises(ZeroDivisionError):
        made.feed(GuardChanged(True), 1.0)
    assert tap.told == [(GuardChanged(True), 1.0, None)]


def test_without_a_tap_the_core_is_the_plain_one():
    assert type(deck().core) is FlightCore


def test_whoever_ticks_is_woken_by_what_must_be_judged_at_once():
    made = deck()
    made.feed(GuardChanged(True), 1.0)
    assert not made.news.is_set()
    made.feed(ClientGone("pilot"), 1.1)
    assert made.news.is_set()


def test_what_a_tick_wants_published_has_the_time_of_the_tick():
    bus = Bus()
    made = Deck(ControlConfig(), bus, Clock(monotonic=lambda: 5.0, wall=lambda: 1e9), first_epoch=1)
    for action in made.core.tick(3.25):
        made.publish(action, 3.25)
    assert [value.stamp.monotonic for value in bus.values("control/status")] == [3.25]
    made.publish_preflight(3.5)
    assert [value.stamp.monotonic for value in bus.values("control/preflight")] == [3.5]
