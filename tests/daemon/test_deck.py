"""Between the flight core, the line and the bus: what the core is told is recorded, what crosses the line published."""

from __future__ import annotations

import pytest

from mkdaemon.clock import Clock
from mkdaemon.config.control import ControlConfig
from mkdaemon.control.events import ClientGone, GuardChanged
from mkdaemon.daemon.deck import Deck
from mkdaemon.link.session.traffic import Received
from mkdaemon.protocol.decoder import Unknown
from mkdaemon.protocol.framing import Frame
from mkdaemon.protocol.wire import Board
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


def test_whoever_ticks_is_woken_by_what_must_be_judged_at_once():
    made = deck()
    made.feed(GuardChanged(True), 1.0)
    assert not made.news.is_set()
    made.feed(ClientGone("pilot"), 1.1)
    assert made.news.is_set()


@pytest.fixture
def bus():
    return Bus()


@pytest.fixture
def sink(bus):
    clock = Clock(monotonic=lambda: 0.0)
    return Deck(ControlConfig(), bus, clock, first_epoch=1).sink


@pytest.mark.parametrize(
    ("address", "board", "word"), [(2, Board.NC, "nc"), (9, None, "other")], ids=["known board", "foreign address"]
)
def test_a_frame_that_no_message_fits_is_published_with_its_bytes_and_the_reason(sink, bus, address, board, word):
    raw = b"#c!?\r"
    sink.received(Received(1.0, Frame(address, "!", b"abc", raw), Unknown(board, "!", b"abc", "no such command")))
    [bytes_] = bus.values("raw/rx")
    [sample] = bus.values(f"rx/{word}/unknown")
    assert (bytes_.raw, bytes_.dropped) == (raw, None)
    assert (sample.board, sample.id, sample.message, sample.layout) == (word, "!", "unknown", None)
    assert sample.fields == {"payload": b"abc", "reason": "no such command"}
    assert not [key for key, _ in bus.published if key.startswith("state/")]
