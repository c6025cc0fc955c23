"""Requests as queries: which message is built, what the gate asks of the line, and what the client is told."""

from __future__ import annotations

import asyncio
from contextlib import asynccontextmanager
from unittest.mock import ANY

import msgpack
import pytest

from mkdaemon.clock import Clock
from mkdaemon.config.commands import CommandsConfig
from mkdaemon.control.events import MotorTestSent
from mkdaemon.control.vehicle import VehicleMemory
from mkdaemon.daemon import requests
from mkdaemon.daemon.procedures import Interlock
from mkdaemon.daemon.requests import BoardRequests
from mkdaemon.errors import LinkLostError, RequestTimeoutError
from mkdaemon.link.session.peers import Peers
from mkdaemon.protocol.dialect import Dialect, Evidence, decide
from mkdaemon.protocol.messages import Echo, EchoRequest, MotorTest, VersionFc210, VersionRequest
from mkdaemon.protocol.wire import Board
from mkdaemon.telemetry.command import CommandResult
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.link import LinkCondition
from tests.control.admission.situations import situation_of
from tests.control.events import link_state

TURNING = [30] + [0] * 15
FC_212 = VersionFc210.decode(bytes([2, 12, 11, 0xBA, 0, 0, 0, 22, 103, 1]))


class Line:
    """A link that answers from a list and remembers what it was asked."""

    def __init__(self):
        self.dialect = Dialect(read_only_reason=None)
        self.asked = []
        self.answers = {}
        self.who_answers = Board.FC
        self.direct_board = Board.FC
        self.boards = {Board.FC}
        self.is_up, self.doubt = True, None
        self.is_discovering = False
        self.offered_memory = lambda: None
        self.when_asked = lambda: None
        self._peers = Peers()

    @property
    def proof(self):
        return self._peers.proof

    def is_proven(self, board):
        return self._peers.is_proven(board, STILL.now())

    async def request(self, message, *, board=None):
        self.asked.append((board, message))
        self.when_asked()
        if isinstance(message, VersionRequest) and VersionRequest not in self.answers:
            self._peers.version_received(self.who_answers, FC_212, STILL.now())
            return VersionFc210.decode(bytes(12))
        answer = self.answers.get(type(message), Echo(pattern=7))
        if isinstance(answer, Exception):
            raise answer
        return answer

    async def send(self, message, *, board=None):
        self.asked.append((board, message))


STILL = Clock(monotonic=lambda: 100.0, wall=lambda: 1.7e9)
"""Time stands still: nothing known becomes old because the machine is slow."""


class Desk:
    """Requests with everything around them."""

    def __init__(self, cfg=None):
        self.events = []
        self.facts = VehicleMemory()
        self.facts.link_changed(link_state())
        self.facts.motors_reported(False, STILL.now())
        self.line = Line()
        self.interlock = Interlock(lambda: situation_of(self.facts, STILL.now(), self.phase))
        self.phase = Phase.FREE
        allowed = cfg or CommandsConfig()
        self._requests = BoardRequests(allowed, self.line, self.facts, self.feed, self, STILL, self.interlock)

    def feed(self, event, now):
        """Take what the flight core is told of a motor test."""
        assert isinstance(event, MotorTestSent)
        self.facts.motor_test_sent(now)

    def command(self, key, fields, result):
        self.events.append((key, fields, result))

    async def ask(self, place, fields=None) -> CommandResult:
        payload = fields if isinstance(fields, bytes) else msgpack.packb(fields or {})
        result = await self._requests.answer(f"cmd/{place}", payload)
        assert self.events[-1][0] == f"cmd/{place}"
        assert self.events[-1][2] is result, "every command is mirrored with its end"
        return result


@pytest.fixture
def desk():
    return Desk()


@pytest.mark.parametrize(("duration", "count", "token"), [(30_000, 200, "deaf_too_long"), (500, 2, None)])
async def test_a_beep_that_leaves_the_board_deaf_is_refused(duration, count, token):
    desk = Desk(CommandsConfig(allow_fork_arming=True))
    result = await desk.ask("fc/beep", {"duration": duration, "count": count, "confirm": True})
    assert result.token == token
    assert token is None or "12456 s" in result.reason


def fall_silent(desk):
    desk.facts = desk._requests._facts = VehicleMemory()
    desk.facts.link_changed(link_state(LinkCondition.MUTE, "nothing arrives"))


def speak(**fields):
    """Let the boards speak a dialect."""
    return lambda desk: setattr(desk.line, "dialect", Dialect(**{"read_only_reason": None, **fields}))


def answer_version(answer):
    return lambda desk: desk.line.answers.update({VersionRequest: answer})


MOTORS = ("fc/motor_test", {"motors": TURNING, "confirm": True})
SETTINGS = ("fc/write_settings", {"index": 3, "parameters": bytes(100), "confirm": True})
TIME = ("nc/time_request", {})


@pytest.mark.parametrize(
    ("prepare", "asked", "token", "words"),
    [
        (fall_silent, MOTORS, "link_down", "nothing arrives"),
        (lambda desk: None, TIME, "board_unproven", "fc answered it"),
        (answer_version(RequestTimeoutError("no answer in 3 tries")), MOTORS, "board_unproven", "no answer in 3"),
        (answer_version(LinkLostError("unplugged")), MOTORS, "board_unproven", "unplugged"),
        (speak(read_only_reason="release 9.99 is not known"), MOTORS, "read_only", "9.99"),
        (speak(settings_read_only_reason="revision 200 is not known"), SETTINGS, "read_only", "revision 200"),
        (speak(unsupported={(Board.NC, "time_request"): "from 0.30g on"}), TIME, "unsupported", "0.30g"),
        (lambda desk: desk.facts.motors_reported(False, STILL.now() - 10.0), MOTORS, "motors_unknown", ""),
    ],
    ids=[
        *("silent line", "wrong board", "no proof", "port lost", "read only", "unknown revision", "unknown message"),
        "motors known long ago",
    ],
)
async def test_what_the_aircraft_must_not_or_cannot_take_is_refused_and_not_sent(desk, prepare, asked, token, words):
    prepare(desk)
    result = await asyncio.wait_for(desk.ask(*asked), requests.MOTORS_WAIT)
    assert (result.token, words in result.reason) == (token, True)
    assert {type(message) for _, message in desk.line.asked} <= {VersionRequest}
    assert (await desk.ask("nc/echo_request", {"pattern": 1})).status == "accepted", "questions are answered"


@pytest.mark.parametrize(
    ("place", "fields", "token", "words"),
    [
        ("nc/echo", {}, "unknown_message", "echo_request"),
        ("fc/echo_request", {"pattern": 1}, "unknown_message", "cmd/nc/echo_request"),
        ("moon/echo_request", {}, "unknown_message", "cmd/fc/"),
        ("nc/echo_request/more", {}, "unknown_message", "cmd/fc/"),
        ("nc/echo_request", {"pattern": 70_000}, "bad_field", "pattern"),
        ("nc/echo_request", {"pattern": "7"}, "bad_field", "pattern"),
        ("nc/echo_request", {"pattern": 1.5}, "bad_field", "pattern"),
        ("nc/echo_request", {"pattern": 1, "extra": 2}, "bad_field", "extra is not a field"),
        ("nc/echo_request", {}, "bad_field", "pattern"),
        ("nc/echo_request", {"pattern": 1, "layout": "99"}, "bad_field", "layout '99'"),
        ("nc/echo_request", b"\xc1", "malformed", "msgpack"),
        ("nc/echo_request", b"\x93\x01\x02\x03", "malformed", "map"),
    ],
)
async def test_what_cannot_be_built_is_refused_with_what_is_wrong(desk, place, fields, token, words):
    result = await desk.ask(place, fields)
    assert result.token == token
    assert words in f"{result.reason} {result.fix}"
    assert desk.line.asked == []


async def test_a_dangerous_request_is_sent_only_to_a_board_that_proved_itself(desk):
    fields = {"motors": TURNING, "confirm": True}
    assert (await desk.ask("fc/motor_test", fields)).status == "accepted"
    assert [type(message) for _, message in desk.line.asked] == [VersionRequest, MotorTest]
    desk.line.asked.clear()
    await desk.ask("fc/motor_test", fields)
    assert [type(message) for _, message in desk.line.asked] == [MotorTest], "the proof is fresh"


async def test_the_way_through_a_navictrl_is_opened_once_more_where_the_flightctrl_did_not_hear_us(desk, monkeypatch):
    desk.line.direct_board, desk.line.who_answers = Board.NC, Board.NC
    passages = []

    @asynccontextmanager
    async def passed(link, board, message, admit):
        passages.append(board)
        if len(passages) == 2:
            desk.line.who_answers = Board.FC
        yield

    monkeypatch.setattr(requests, "way_to", passed)
    fields = {"motors": TURNING, "confirm": True}
    assert (await desk.ask("fc/motor_test", fields)).status == "accepted"
    assert passages == [Board.FC] * 2
    assert [type(message) for _, message in desk.line.asked] == [VersionRequest, VersionRequest, MotorTest]


@pytest.mark.parametrize(
    ("name", "fields"),
    [
        ("arm_motors", {}),
        ("disarm_motors", {}),
        ("recalibrate", {"what": 1}),
        ("beep", {"duration": 100, "count": 1}),
    ],
)
async def test_commands_of_the_fork_wait_for_somebody_who_says_that_it_is_one(name, fields):
    missing = decide(Evidence().with_message(Board.FC, FC_212)).unsupported
    assert (Board.FC, name) in missing, "the release alone cannot tell"
    for is_allowed in (False, True):
        desk = Desk(CommandsConfig(allow_fork_arming=is_allowed))
        desk.line.dialect = Dialect(read_only_reason=None, unsupported=missing)
        result = await desk.ask(f"fc/{name}", {**fields, "confirm": True})
        assert (result.status, result.token) == (("not_observable", None) if is_allowed else ("denied", "not_enabled"))
        assert desk.line.asked[1:] == ([(Board.FC, ANY)] if is_allowed else [])


@pytest.mark.parametrize(
    ("error", "status", "token"),
    [
        (RequestTimeoutError("no answer in 3 tries"), "timeout", "timeout"),
        (LinkLostError("the adapter is gone"), "denied", "link_down"),
        (RuntimeError("wires crossed"), "denied", "internal"),
    ],
)
async def test_silence_is_a_timeout_and_a_defect_is_answered_and_mirrored_like_everything_else(
    desk, error, status, token
):
    desk.line.answers[EchoRequest] = error
    result = await desk.ask("nc/echo_request", {"pattern": 1})
    assert (result.status, result.token) == (status, token)
    assert token != "internal" or "RuntimeError: wires crossed" in result.reason


@pytest.mark.parametrize(("port", "end"), [(0, Board.FC), (1, Board.MAG), (2, Board.ANY)])
async def test_a_bare_redirection_comes_back_by_itself(desk, monkeypatch, port, end):
    """Left to the client, the line would lead elsewhere for ever: the NaviCtrl hears nothing but the escape."""
    seen = []

    @asynccontextmanager
    async def passed(link, board, admit):
        seen.append(("to", board))
        yield
        seen.append(("back", board))

    monkeypatch.setattr(requests, "redirection", passed)
    monkeypatch.setattr(requests, "PASSAGE", 0.0)
    desk.line.who_answers = Board.NC
    result = await desk.ask("nc/redirect", {"port": port, "confirm": True})
    assert seen == [("to", end), ("back", end)]
    assert result.status == "not_observable"
    assert "is back" in result.reason


async def test_confirm_must_be_true_and_nothing_like_it(desk):
    for confirm in (1, "yes", None, False):
        result = await desk.ask("fc/motor_test", {"motors": TURNING, "confirm": confirm})
        assert result.token == "not_confirmed"


@pytest.mark.parametrize(
    ("place", "fields"),
    [
        ("fc/beep", {"duration": 500, "count": 1}),
        ("fc/select_settings", {"index": 2}),
        ("fc/settings_request", {"index": 2}),
        ("fc/recalibrate", {"what": 1}),
        ("fc/motor_test", {"motors": TURNING}),
    ],
)
async def test_a_request_that_makes_the_board_deaf_is_refused_while_someone_may_fly(place, fields):
    desk = Desk(CommandsConfig(allow_fork_arming=True))
    for phase in (Phase.LEASED, Phase.FLYING, Phase.STALE, Phase.RELEASING):
        desk.phase = phase
        result = await desk.ask(place, {**fields, "confirm": True})
        assert (result.status, result.token) == ("denied", "flying"), result
        assert phase.value in result.reason
        assert result.fix
    assert desk.line.asked == []
    desk.phase = Phase.FREE
    assert (await desk.ask(place, {**fields, "confirm": True})).token is None


@pytest.mark.parametrize("change", ["lease", "motors"])
async def test_what_changes_while_a_board_proves_itself_still_counts(desk, change):
    def when_asked():
        if change == "lease":
            desk.phase = Phase.LEASED
        else:
            desk.facts.motors_reported(True, STILL.now())

    desk.line.when_asked = when_asked
    result = await desk.ask("fc/motor_test", {"motors": TURNING, "confirm": True})
    assert result.token == {"lease": "flying", "motors": "motors_running"}[change]
    assert [type(message) for _, message in desk.line.asked] == [VersionRequest]


async def test_a_request_behind_a_navictrl_is_refused_while_someone_may_fly(desk):
    """The NaviCtrl passes the line through for it, and no stick frame gets through meanwhile."""
    desk.line.direct_board, desk.phase = Board.NC, Phase.FLYING
    assert (await desk.ask("fc/receiver_request")).token == "flying"
    assert (await desk.ask("nc/echo_request", {"pattern": 7})).token is None


async def test_what_telemetry_said_about_the_motors_a_second_ago_lets_nothing_pass(desk, monkeypatch):
    monkeypatch.setattr(requests, "MOTORS_WAIT", 0.05)
    desk.facts.motors_reported(False, STILL.now() - 1.0)
    assert (await desk.ask("fc/motor_test", {"motors": TURNING, "confirm": True})).token == "motors_unknown"
    desk.facts.motors_reported(False, STILL.now() - 0.4)
    assert (await desk.ask("fc/motor_test", {"motors": TURNING, "confirm": True})).token is None
