"""Questions and their answers: which belongs to which, what is late or double, what is asked again."""

from __future__ import annotations

from functools import partial

import pytest

from mkdaemon.errors import CommandRejectedError
from mkdaemon.link.session.health import HealthMonitor
from mkdaemon.link.session.line import LineRules
from mkdaemon.link.session.peers import Peers
from mkdaemon.link.session.questions import Pending, QuestionAnswered, Questions, RequestBook, Unanswered, answers
from mkdaemon.link.session.scheduler import QUEUE_LIMIT, TransmitScheduler
from mkdaemon.link.session.traffic import Purpose
from mkdaemon.protocol.messages import (
    ACTIVE_SET,
    DebugDataNc,
    DebugRequest,
    Echo,
    EchoRequest,
    Label,
    LabelRequest,
    Menu,
    MenuRequest,
    SettingsRequest,
    SettingsReset,
    VersionRequest,
    VersionRequestWhich,
)
from mkdaemon.protocol.wire import MESSAGES, Board, WireMessage

DEBUG = DebugDataNc(status_green=0, status_red=0, analog=(0,) * 32)


def label(index: int) -> Label:
    return Label(index=index, text="Voltage [0.1V]")


def menu(page: int, last: int) -> Menu:
    return Menu(page=page, last_page=last, text=" " * 80)


def any_layout(board: Board, letter: str, **fields: object) -> WireMessage:
    """A message of a letter with these fields, whatever else it holds."""
    cls = next(cls for (owner, command, _), cls in MESSAGES.items() if owner is board and command == letter)
    return cls.model_construct(**fields)


fc, nc = partial(any_layout, Board.FC), partial(any_layout, Board.NC)


@pytest.mark.parametrize(
    ("asked", "board", "fit", "others"),
    [
        (LabelRequest(index=3), Board.NC, [label(3)], [label(4)]),
        (EchoRequest(pattern=7), Board.NC, [Echo(pattern=7)], [Echo(pattern=8), label(7)]),
        (MenuRequest(page=2), Board.NC, [menu(2, 15)], [menu(15, 15), menu(3, 15)]),
        (MenuRequest(page=99), Board.NC, [menu(15, 15), menu(0, 15)], []),
        (DebugRequest(interval=0), Board.NC, [DEBUG], []),
        (SettingsRequest(index=ACTIVE_SET), Board.FC, [fc("Q", index=3)], []),
        (SettingsRequest(index=3), Board.FC, [fc("Q", index=3)], [fc("Q", index=4)]),
        (SettingsReset(index=13), Board.FC, [fc("Q", index=3)], [fc("Q", index=2)]),
        (SettingsReset(index=25), Board.FC, [fc("Q", index=5)], []),
        (nc("w", index=4), Board.NC, [nc("W", index=4), nc("W", index=0)], [nc("W", index=5)]),
        (nc("w"), Board.NC, [nc("W", index=5)], []),  # a layout without the field
        (nc("x", index=3), Board.NC, [nc("X", number=3), nc("X", count=0)], [nc("X", number=4)]),
        (nc("j", id=0), Board.NC, [nc("J", id=0)], [nc("J", id=1)]),
    ],
)
def test_answers_are_matched_by_sender_letter_and_content(asked, board, fit, others):
    assert [answers(asked, board, one, board) for one in fit] == [True] * len(fit)
    assert [answers(asked, board, one, board) for one in others] == [False] * len(others)
    assert not answers(asked, board, fit[0], Board.MAG)
    assert answers(asked, Board.ANY, fit[0], board)


def test_what_moves_motors_arms_or_resets_is_never_repeated():
    for letter in "txew":
        cls = next((cls for (owner, i, _), cls in MESSAGES.items() if owner is Board.FC and i == letter), None)
        assert cls is not None
        assert cls.spec.policy(Board.FC).retries == 0
    assert SettingsReset.spec.policy(Board.FC).retries == 0 < SettingsRequest.spec.policy(Board.FC).retries


def ask(book: RequestBook, index: int, now: float, retries: int = 1) -> Pending:
    pending = Pending(LabelRequest(index=index), Board.NC, 1 + retries, 0.3, None)
    book.open(pending)
    book.sent(pending, now)
    return pending


def test_late_and_double_answers_are_counted_once():
    book = RequestBook()
    given_up, answered = ask(book, 1, 0.0), ask(book, 2, 0.0)
    book.timed_out(given_up)
    book.give_up(given_up, 0.3)
    assert book.received(label(1), Board.NC, 0.4) is None
    assert book.received(label(1), Board.NC, 0.5) is None
    assert book.tally.late == 1
    book.sent(answered, 0.3)
    assert book.received(label(2), Board.NC, 0.4) is answered
    assert book.received(label(2), Board.NC, 0.5) is None
    assert book.received(label(2), Board.NC, 0.6) is None
    assert book.duplicate == 1


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


def test_an_answer_ends_its_question_only_and_who_does_not_wait_any_more_is_not_asked_for():
    bench = Bench()
    pending = bench.questions.ask(LabelRequest(index=3), Board.NC, bench.now, token="mine")
    other = bench.questions.ask(LabelRequest(index=4), Board.NC, bench.now)
    bench.questions.withdraw(other, bench.now)
    bench.run(0.01)
    answer = Label(index=3, text="Voltage")
    assert bench.questions.received(Label(index=4, text="Current"), Board.NC, bench.now) is None
    assert bench.questions.received(answer, Board.NC, bench.now) is pending
    assert bench.questions.take_finished() == [QuestionAnswered(pending, answer)]
    assert bench.questions.take_finished() == []
    bench.run(5.0)
    assert len(bench.sent) == 1
    assert bench.questions.book.tally.answered == 1


def test_silence_is_asked_again_more_patiently_and_then_given_up_in_words():
    bench = Bench()
    pending = bench.questions.ask(LabelRequest(index=3), Board.NC, bench.now, timeout=0.2, retries=2)
    bench.run(3.0)
    assert [purpose for _, purpose in bench.sent] == [Purpose.REQUEST, Purpose.RETRY, Purpose.RETRY]
    first, second, third = [at for at, _ in bench.sent]
    assert second - first == pytest.approx(0.2, abs=0.02)
    assert third - second == pytest.approx(0.3, abs=0.02)
    assert bench.questions.take_finished() == [Unanswered(pending, "nc did not answer, asked 3 times")]
    assert bench.questions.book.tally.unanswered == 3


def test_too_much_waiting_is_refused_and_leaves_nothing_behind():
    bench = Bench()
    for _ in range(QUEUE_LIMIT):
        bench.questions.ask(LabelRequest(index=1), Board.NC, bench.now)
    with pytest.raises(CommandRejectedError, match="wait for the line already") as caught:
        bench.questions.ask(LabelRequest(index=1), Board.NC, bench.now)
    assert caught.value.token == "busy"
    assert len(bench.questions.book.pending) == QUEUE_LIMIT


def test_what_a_board_says_about_another_proves_nothing():
    bench = Bench()
    bench.peers.redirected = Board.FC
    asked = bench.questions.ask(VersionRequest(), Board.FC, bench.now)
    about_another = bench.questions.ask(VersionRequestWhich(which=2), Board.FC, bench.now)
    assert bench.questions.proves_sender(None)
    assert bench.questions.proves_sender(asked)
    assert not bench.questions.proves_sender(about_another)
