"""Questions and their answers: which belongs to which, what is late or double, what is asked again."""

from __future__ import annotations

import math

import pytest

from mkdaemon.errors import CommandRejectedError
from mkdaemon.link.session.health import HealthMonitor
from mkdaemon.link.session.line import LineRules
from mkdaemon.link.session.peers import Peers
from mkdaemon.link.session.questions import (
    LATE_WINDOW,
    Pending,
    QuestionAnswered,
    Questions,
    RequestBook,
    Unanswered,
    answers,
)
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
from mkdaemon.protocol.spec import Policy
from mkdaemon.protocol.wire import MESSAGES, Board, Direction, WireMessage

DEBUG = DebugDataNc(status_green=0, status_red=0, analog=(0,) * 32)


def label(index: int) -> Label:
    return Label(index=index, text="Voltage [0.1V]")


def menu(page: int, last: int) -> Menu:
    return Menu(page=page, last_page=last, text=" " * 80)


@pytest.mark.parametrize(
    ("asked", "board", "came", "sender", "fits"),
    [
        (LabelRequest(index=3), Board.NC, label(3), Board.NC, True),
        (LabelRequest(index=3), Board.NC, label(4), Board.NC, False),
        (LabelRequest(index=3), Board.NC, label(3), Board.FC, False),
        (LabelRequest(index=3), Board.ANY, label(3), Board.FC, True),
        (EchoRequest(pattern=7), Board.NC, Echo(pattern=7), Board.NC, True),
        (EchoRequest(pattern=7), Board.NC, Echo(pattern=8), Board.NC, False),
        (EchoRequest(pattern=7), Board.NC, label(7), Board.NC, False),
        (MenuRequest(page=2), Board.NC, menu(2, 15), Board.NC, True),
        (MenuRequest(page=99), Board.NC, menu(15, 15), Board.NC, True),
        (MenuRequest(page=99), Board.NC, menu(0, 15), Board.NC, True),
        (MenuRequest(page=2), Board.NC, menu(15, 15), Board.NC, False),
        (MenuRequest(page=2), Board.NC, menu(3, 15), Board.NC, False),
        (DebugRequest(interval=0), Board.NC, DEBUG, Board.NC, True),
    ],
)
def test_answers_are_matched_by_sender_letter_and_content(asked, board, came, sender, fits):
    assert answers(asked, board, came, sender) is fits


def message(board: Board, key: str, **fields: object) -> WireMessage:
    cls = next(
        cls
        for (owner, _, _), cls in MESSAGES.items()
        if owner is board and cls.spec.key == key and cls.spec.direction is Direction.TO_BOARD
    )
    return cls(**fields)


def reply(board: Board, letter: str, **fields: object) -> WireMessage:
    """A reply with these fields, whatever else it holds."""
    cls = next(cls for (owner, command, _), cls in MESSAGES.items() if owner is board and command == letter)
    return cls.model_construct(**fields)


@pytest.mark.parametrize(
    ("asked", "answer", "fits"),
    [
        (SettingsRequest(index=ACTIVE_SET), 3, True),
        (SettingsRequest(index=3), 3, True),
        (SettingsRequest(index=3), 4, False),
        (SettingsReset(index=13), 3, True),
        (SettingsReset(index=13), 2, False),
        (SettingsReset(index=25), 5, True),
    ],
)
def test_settings_answer_by_slot(asked, answer, fits):
    assert answers(asked, Board.FC, reply(Board.FC, "Q", index=answer), Board.FC) is fits


def test_waypoint_answers_carry_their_index_or_zero():
    asked = next(
        cls for (owner, letter, _), cls in MESSAGES.items() if owner is Board.NC and letter == "w"
    ).model_construct(index=4)
    for index, fits in ((4, True), (0, True), (5, False)):
        assert answers(asked, Board.NC, reply(Board.NC, "W", index=index), Board.NC) is fits


def test_points_and_parameters_answer_by_number():
    asked = message(Board.NC, "waypoint_request", index=3)
    for number, fits in ((3, True), (4, False)):
        assert answers(asked, Board.NC, reply(Board.NC, "X", number=number), Board.NC) is fits
    assert answers(asked, Board.NC, reply(Board.NC, "X", count=0), Board.NC)
    asked = message(Board.NC, "navi_parameter_request", id=0)
    for number, fits in ((0, True), (1, False)):
        assert answers(asked, Board.NC, reply(Board.NC, "J", id=number), Board.NC) is fits


def test_a_layout_without_the_field_is_matched_by_its_letter():
    asked = next(
        cls for (owner, letter, _), cls in MESSAGES.items() if owner is Board.NC and letter == "w"
    ).model_construct()
    assert answers(asked, Board.NC, reply(Board.NC, "W", index=5), Board.NC)


def test_writing_settings_waits_longer_and_leaves_the_board_in_peace():
    cls = next(cls for (owner, letter, _), cls in MESSAGES.items() if owner is Board.FC and letter == "s")
    policy = cls.spec.policy(Board.FC)
    assert policy.timeout >= 1.33
    assert policy.deaf == pytest.approx(1.33)


def test_resetting_a_slot_is_never_repeated_and_reading_one_is():
    assert SettingsReset.spec.policy(Board.FC) == Policy(1.5, 0, deaf=0.5)
    assert SettingsRequest.spec.policy(Board.FC).retries > 0


def test_what_moves_motors_or_arms_is_never_repeated():
    for letter in "txew":
        cls = next((cls for (owner, i, _), cls in MESSAGES.items() if owner is Board.FC and i == letter), None)
        assert cls is not None
        assert cls.spec.policy(Board.FC).retries == 0


def ask(book: RequestBook, index: int, now: float, retries: int = 1) -> Pending:
    pending = Pending(LabelRequest(index=index), Board.NC, 1 + retries, 0.3, None)
    book.open(pending)
    book.sent(pending, now)
    return pending


def test_an_answer_closes_its_question_only():
    book = RequestBook()
    first, second = ask(book, 1, 0.0), ask(book, 2, 0.0)
    assert book.received(label(2), Board.NC, 0.1) is second
    assert book.pending == (first,)
    assert book.tally.answered == 1


def test_a_question_not_sent_yet_is_not_answered():
    book = RequestBook()
    pending = Pending(LabelRequest(index=1), Board.NC, 1, 0.3, None)
    book.open(pending)
    assert book.received(label(1), Board.NC, 0.1) is None
    assert book.next_time() == math.inf
    book.withdraw(pending, 0.2)
    assert book.received(label(1), Board.NC, 0.3) is None
    assert (book.tally.late, book.duplicate) == (0, 0)


def test_attempts_time_out_one_by_one():
    book = RequestBook()
    pending = ask(book, 1, 0.0)
    assert book.due(0.2) == []
    assert book.next_time() == pytest.approx(0.3)
    assert book.due(0.3) == [pending]
    book.timed_out(pending)
    book.sent(pending, 0.35)
    assert pending.attempts_left == 0
    assert pending.sent == 2
    book.timed_out(pending)
    book.give_up(pending, 0.7)
    assert (book.tally.unanswered, book.pending) == (2, ())


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


def test_an_old_question_is_forgotten():
    book = RequestBook()
    book.give_up(ask(book, 1, 0.0), 0.3)
    book.received(label(1), Board.NC, 1.0 + LATE_WINDOW)
    assert book.tally.late == 0


def test_one_answer_to_one_sending_is_no_double():
    book = RequestBook()
    ask(book, 1, 0.0)
    book.received(label(1), Board.NC, 0.1)
    book.received(label(1), Board.NC, 0.2)  # somebody else's question
    assert book.duplicate == 0


def test_a_lost_port_takes_every_question_with_it():
    book = RequestBook()
    pending = ask(book, 1, 0.0)
    assert book.drain() == [pending]
    book.withdraw(pending, 0.1)
    assert book.pending == ()


def test_every_request_of_the_table_has_a_policy():
    for (board, _, _), cls in MESSAGES.items():
        if cls.spec.direction is Direction.TO_BOARD:
            policy = cls.spec.policy(board)
            assert 0.1 <= policy.timeout <= 3
            assert 0 <= policy.retries <= 5


def test_version_requests_are_cheap_to_repeat():
    assert VersionRequest().spec.policy(Board.FC).retries >= 3


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
    assert bench.questions.take_finished() == [QuestionAnswered(pending, answer)]
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
    assert bench.questions.book.tally.unanswered == 3


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
        Unanswered(late, "the line was never free for the request"),
    ]


def test_what_a_board_says_about_another_proves_nothing():
    bench = Bench()
    bench.peers.redirected = Board.FC
    asked = bench.questions.ask(VersionRequest(), Board.FC, bench.now)
    about_another = bench.questions.ask(VersionRequestWhich(which=2), Board.FC, bench.now)
    assert bench.questions.proves_sender(None)
    assert bench.questions.proves_sender(asked)
    assert not bench.questions.proves_sender(about_another)
