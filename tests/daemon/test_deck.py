"""Between the flight core, the line and the bus: what the core is told is recorded, what crosses the line published."""

from __future__ import annotations

import pytest

from mkdaemon.clock import Clock
from mkdaemon.config.control import ControlConfig
from mkdaemon.control.core import FlightCore
from mkdaemon.control.events import ClientGone, GuardChanged
from mkdaemon.daemon.deck import Deck
from mkdaemon.link.session.traffic import Lost, Purpose, Received, Sent
from mkdaemon.protocol.boards import Direction
from mkdaemon.protocol.decoder import Unknown
from mkdaemon.protocol.framing import DropReason, Frame
from mkdaemon.protocol.messages import EchoRequest
from mkdaemon.protocol.wire import Board
from mkdaemon.telemetry.link import LinkCondition
from tests.control.events import link_state
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


def test_what_is_sent_without_a_message_is_published_as_bytes_alone(sink, bus):
    sink.sent(Sent(1.0, b"\x1b\x1b\x55\xaa\x00", None, Purpose.REQUEST))
    assert [key for key, _ in bus.published] == ["raw/tx"]


@pytest.mark.parametrize(("raw", "word"), [(b"#bz\r", "fc"), (b"#", "other"), (b"", "other")])
def test_a_request_is_published_under_the_board_its_bytes_name(sink, bus, raw, word):
    sink.sent(Sent(1.0, raw, EchoRequest(pattern=7), Purpose.BACKGROUND))
    [sample] = bus.values(f"tx/{word}/echo_request")
    assert (sample.purpose, sample.fields) == ("background", EchoRequest(pattern=7))


def test_what_did_not_get_through_is_published_with_the_reason(sink, bus):
    sink.dropped(Lost(1.0, Direction.FROM_BOARD, DropReason.CHECKSUM, b"#cO"))
    sink.dropped(Lost(1.0, Direction.TO_BOARD, DropReason.EXPIRED, b"#bb"))
    assert [(key, value.dropped) for key, value in bus.published] == [("raw/rx", "checksum"), ("raw/tx", "expired")]


def test_only_a_new_condition_of_the_line_is_a_line_in_the_log(sink, bus):
    for state in (
        link_state(LinkCondition.DOWN, "just opened"),
        link_state(LinkCondition.UP),
        link_state(LinkCondition.UP, "with losses"),
        link_state(LinkCondition.CLOSED, "closed by us"),
    ):
        sink.state_changed(state)
    assert len(bus.values("link/state")) == 4
    assert [(event.level, event.text) for event in bus.values("event/log")] == [
        ("warning", "p: down: just opened"),
        ("info", "p: up: all is well"),
        ("info", "p: closed: closed by us"),
    ]
