"""Questions between the callers and the scheduler: every one ends with exactly one outcome."""

from __future__ import annotations

import pytest

from mkdaemon.errors import CommandRejectedError
from mkdaemon.link.session.health import HealthMonitor
from mkdaemon.link.session.line import LineRules
from mkdaemon.link.session.peers import Peers
from mkdaemon.link.session.questions import Answered, Questions, Unanswered
from mkdaemon.link.session.requests import Pending
from mkdaemon.link.session.scheduler import QUEUE_LIMIT, TransmitScheduler
from mkdaemon.link.session.traffic import Purpose
from mkdaemon.protocol.messages import Label, LabelRequest, VersionRequest, VersionRequestWhich
from mkdaemon.protocol.wire import Board


class Bench:
    """Questions on a line to a NaviCtrl."""

    def __init__(self) -> None:
        self.peers = Peers()
        self.peers.note_sender(Board.NC)
        self.scheduler = TransmitScheduler(LineRules(direct=Board.NC))
        self.health = HealthMonitor(window=10.0, max_loss_percent=5.0, now=0.0)
        self.questions = Questions(self.scheduler, self.peers, self.health)
        self.now = 0.0
        self.sent: list[tuple[float, Purpose]] = []

    def run(self, seconds: float) -> None:
        end = self.now + seconds
        while self.now < end:
            self.questions.step(self.now)
            while (entry := self.scheduler.take(self.now)) is not None:
                self.sent.append((self.now, entry.purpose))
                assert isinstance(entry.tag, Pending)
                self.questions.sent(entry.tag, self.now)
            self.now += 0.001


def test_an_answer_ends_a_question():
    bench = Bench()
    pending = bench.questions.ask(LabelRequest(index=3), Board.NC, bench.now, token="mine")
    bench.run(0.01)
    answer = Label(index=3, text="Voltage")
    assert bench.questions.received(Label(index=4, text="Current"), Board.NC, bench.now) is None
    assert bench.questions.received(answer, Board.NC, bench.now) is pending
    assert bench.questions.take_finished() == [Answered(pending, answer)]
    assert bench.questions.take_finished() == []
    bench.run(5.0)
    assert len(bench.sent) == 1


def test_silence_is_asked_again_more_patiently_and_then_given_up_in_words():
    bench = Bench()
    pending = bench.questions.ask(LabelRequest(index=3), Board.NC, bench.now, timeout=0.2, retries=2)
    bench.run(3.0)
    assert [purpose for _, purpose in bench.sent] == [Purpose.REQUEST, Purpose.RETRY, Purpose.RETRY]
    first, second, third = [at for at, _ in bench.sent]
    assert second - first == pytest.approx(0.2, abs=0.02)
    assert third - second == pytest.approx(0.3, abs=0.02)
    assert bench.questions.take_finished() == [Unanswered(pending, "nc did not answer, asked 3 times")]
    assert bench.questions.book.unanswered == 1


def test_too_much_waiting_is_refused_and_leaves_nothing_behind():
    bench = Bench()
    for _ in range(QUEUE_LIMIT):
        bench.questions.ask(LabelRequest(index=1), Board.NC, bench.now)
    with pytest.raises(CommandRejectedError, match="wait for the line already") as caught:
        bench.questions.ask(LabelRequest(index=1), Board.NC, bench.now)
    assert caught.value.token == "busy"
    assert len(bench.questions.book.pending) == QUEUE_LIMIT


def test_who_does_not_wait_any_more_is_not_asked_for():
    bench = Bench()
    pending = bench.questions.ask(LabelRequest(index=1), Board.NC, bench.now)
    bench.questions.withdraw(pending, bench.now)
    bench.run(1.0)
    assert bench.sent == []
    assert bench.questions.take_finished() == []


def test_the_loss_of_the_port_and_a_line_never_free_are_outcomes_too():
    bench = Bench()
    lost = bench.questions.ask(LabelRequest(index=1), Board.NC, bench.now)
    bench.questions.port_lost("unplugged")
    late = bench.questions.ask(LabelRequest(index=2), Board.NC, bench.now)
    bench.questions.never_sent(late, bench.now)
    assert bench.questions.take_finished() == [
        Unanswered(lost, "unplugged"),
        Unanswered(late, "the line was never free for it"),
    ]


def test_what_a_board_says_about_another_proves_nothing():
    bench = Bench()
    bench.peers.redirected = Board.FC
    asked = bench.questions.ask(VersionRequest(), Board.FC, bench.now)
    about_another = bench.questions.ask(VersionRequestWhich(which=2), Board.FC, bench.now)
    assert bench.questions.proves_sender(None)
    assert bench.questions.proves_sender(asked)
    assert not bench.questions.proves_sender(about_another)
