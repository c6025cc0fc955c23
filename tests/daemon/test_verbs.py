"""What the daemon itself can be asked for, and what it answers to nonsense."""

from __future__ import annotations

import msgpack
import pytest

from mkdaemon.config.control import ControlConfig
from mkdaemon.control.estimator.model import AircraftModel
from mkdaemon.control.regulator.margins import gains_of
from mkdaemon.daemon.procedures import Interlock, ProcedureRunner
from mkdaemon.daemon.verbs import Verbs
from mkdaemon.errors import CommandRejectedError
from mkdaemon.link.session.traffic import ReleaseResult
from mkdaemon.telemetry.control import ReleaseOutcome
from mkdaemon.telemetry.preflight import PreflightReport
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.verbs import VERBS
from tests.control.admission.situations import GOOD


class Line:
    """A link with two streams and a small line."""

    def __init__(self):
        self.intervals = {"osd": 0.1, "attitude": 0.05}
        self.doubted = ["another one"]

    def accept_aircraft(self):
        if not self.doubted:
            raise refuse(Token.NO_OTHER_AIRCRAFT)
        self.doubted.pop()

    def rates(self):
        return dict(self.intervals)

    def set_rate(self, stream, interval):
        if stream not in self.intervals:
            raise CommandRejectedError("no_such_stream", f"nc has no stream {stream!r}.", "It has osd.")
        if 0 < interval < 0.02:
            raise refuse(Token.LINE_BUDGET, terms="O at 10 ms needs 184 %", limit=85, factor=2.2)
        self.intervals[stream] = interval


class Desk:
    """Verbs with everything around them: it stands for control and for the audit as well."""

    def __init__(self):
        self.events, self.marks = [], []
        self.released = ReleaseResult(ReleaseOutcome.CONFIRMED, 5, 5, "test")
        self._verbs = Verbs(self, Line(), self, Interlock(lambda: GOOD), {})

    async def lease(self, raw):
        raise refuse(Token.NOT_LEASED)

    async def release(self, raw):
        if isinstance(self.released, Exception):
            raise self.released
        return self.released

    def gains(self):
        return gains_of(AircraftModel(), ControlConfig())

    def mark(self, text, holder):
        self.marks.append((text, holder))

    async def preflight(self):
        return PreflightReport(is_ready=True, findings=())

    def abort(self, request):
        raise refuse(Token.NOTHING_FLOWN, phase=request.reason)

    def command(self, key, fields, result):
        self.events.append((key, fields, result))

    async def ask(self, verb, fields=None):
        payload = fields if isinstance(fields, bytes) else msgpack.packb(fields or {})
        result = await self._verbs.answer(f"do/{verb}", payload)
        assert self.events[-1][0] == f"do/{verb}"
        assert self.events[-1][2] is result
        return result


@pytest.fixture
def desk():
    return Desk()


def test_every_verb_of_the_table_is_answered(desk):
    procedures = ProcedureRunner.verbs.fget(object.__new__(ProcedureRunner))
    assert {*desk._verbs._handlers, *procedures} == {verb.name for verb in VERBS}


@pytest.mark.parametrize(
    ("verb", "fields", "token", "words"),
    [
        ("rates", {"stream": "osd", "interval": 0.01}, "line_budget", "184 %"),
        ("rates", {"stream": "sod", "interval": 0.1}, "no_such_stream", "'sod'"),
        ("rates", {"stream": "osd", "interval": 3.0}, "bad_field", "interval"),
        ("rates", {"stream": "osd", "interval": float("nan")}, "bad_field", "interval"),
        ("rates", {"kind": "osd"}, "bad_field", "kind is not a field"),
        ("lease", {"action": "renew"}, "not_leased", "no client holds"),
        ("abort", {"reason": "enough"}, "nothing_flown", "enough"),
        ("relase", {}, "unknown_verb", "release"),
        ("fly", {}, "unknown_verb", "lease or release or gains or preflight"),
        ("rates", b"\xc1", "malformed", "msgpack"),
    ],
)
async def test_refusals_say_what_is_wrong_and_are_mirrored(desk, verb, fields, token, words):
    result = await desk.ask(verb, fields)
    assert result.token == token
    assert words in f"{result.reason} {result.fix}"


@pytest.mark.parametrize(
    ("released", "status", "token"),
    [
        (ReleaseResult(ReleaseOutcome.CONFIRMED, 5, 5, "test"), "accepted", None),
        (ReleaseResult(ReleaseOutcome.UNCONFIRMED, 5, 5, "test"), "not_observable", None),
        (None, "timeout", "timeout"),
        (RuntimeError("wires crossed"), "denied", "internal"),
    ],
    ids=["confirmed", "unconfirmed", "without end", "a defect"],
)
async def test_release_says_how_it_went(desk, released, status, token):
    desk.released = released
    result = await desk.ask("release", {"reason": "test"})
    assert (result.status, result.token) == (status, token)
    if isinstance(released, ReleaseResult):
        assert (result.reply["status"], result.reply["sent"]) == (released.status, 5)
    assert token != "internal" or "RuntimeError: wires crossed" in result.reason
