"""What became of every frame that wants an answer."""

from __future__ import annotations

import pytest

from mkdaemon.client.linktest.probes import TIMEOUT, Ledger, Probe, ProbeKind
from mkdaemon.protocol.messages import ControlConfirm, Echo, EchoRequest, ExternControlV3, VersionRequest
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.traffic import FrameSample

STICKS = {"pitch": 0, "roll": 0, "yaw": 0, "throttle": 0}


def frame(message, at, purpose=None):
    spec, stamp = message.spec, Stamp(monotonic=at, wall=0.0)
    named = {"board": "nc", "id": spec.id, "message": spec.name, "layout": spec.layout}
    return FrameSample(stamp=stamp, sequence=1, fields=message, purpose=purpose, **named)


class Line:
    """A ledger, and frames at its two ends."""

    def __init__(self):
        self.ledger = Ledger()

    def ask(self, pattern, at, purpose="echo"):
        self.ledger.take("tx/nc/echo_request", frame(EchoRequest(pattern=pattern), at, purpose))

    def answer(self, pattern, at):
        self.ledger.take("rx/nc/echo", frame(Echo(pattern=pattern), at))

    def steer(self, number, at):
        self.ledger.take("tx/fc/extern_control", frame(ExternControlV3(**STICKS, frame=number), at, "setpoint"))

    def confirm(self, number, at):
        self.ledger.take("rx/fc/control_confirm", frame(ControlConfirm(frame=number), at))

    def trips(self, kind=ProbeKind.ECHO):
        return [probe.trip for probe in self.ledger.probes() if probe.kind is kind]


@pytest.fixture
def line():
    return Line()


def test_a_link_test_is_answered_lost_or_still_open(line):
    line.ask(1, 10.0)
    line.answer(1, 10.02)
    line.ask(2, 10.1, "request")
    line.ask(3, 10.4)
    assert line.ledger.probes() == [
        Probe(ProbeKind.ECHO, 0.0, pytest.approx(0.02)),
        Probe(ProbeKind.ECHO, pytest.approx(0.1), None),
    ]
    assert line.ledger.counts() == (2, 1)
    assert line.ledger.elapsed == pytest.approx(0.4)


def test_an_answer_after_the_time_out_is_late_and_its_test_lost(line):
    line.ask(1, 0.0)
    line.answer(1, TIMEOUT + 0.001)
    line.answer(1, TIMEOUT + 0.002)
    assert line.trips() == [None]


def test_after_the_end_only_answers_count(line):
    line.ask(1, 0.0)
    line.ledger.end()
    line.ask(2, 0.1)
    line.answer(1, 0.11)
    line.answer(2, 0.12)
    assert line.trips() == [pytest.approx(0.11)]


def test_a_flightctrl_is_tested_by_version_requests_of_the_prober_alone(line):
    for at, purpose in ((0.0, "echo"), (0.5, "request")):
        line.ledger.take("tx/fc/version_request", frame(VersionRequest(), at, purpose))
        line.ledger.take("rx/fc/version", frame(Echo(pattern=0), at + 0.01))
    assert line.trips() == [pytest.approx(0.01)]


def test_stick_frames_count_where_the_board_confirms_any(line):
    for number, at in ((1, 0.0), (2, 0.1), (3, 0.2)):
        line.steer(number, at)
    line.ask(1, 1.0)
    assert line.trips(ProbeKind.CONTROL) == []
    assert line.ledger.stick_frames == 3
    line.confirm(3, 1.01)  # late, and still no proof that it is lost in the air
    assert line.trips(ProbeKind.CONTROL) == []
    line.steer(4, 1.1)
    line.confirm(4, 1.12)
    assert line.trips(ProbeKind.CONTROL) == [None, None, None, pytest.approx(0.02)]


def test_a_confirmation_that_a_newer_one_replaced_is_lost_with_that_reason(line):
    line.ledger.take_replaced(7)
    for number, at in ((1, 0.0), (2, 0.02), (3, 0.04)):
        line.steer(number, at)
    line.confirm(3, 0.05)
    line.ask(1, 1.0)
    line.answer(1, 1.01)
    assert line.trips(ProbeKind.CONTROL) == [None, None, pytest.approx(0.01)]
    line.ledger.take_replaced(8)
    assert line.trips(ProbeKind.CONTROL) == [None, None, pytest.approx(0.01)]
    sticks = [probe for probe in line.ledger.probes() if probe.kind is ProbeKind.CONTROL]
    assert [probe.is_replaced for probe in sticks] == [False, True, False]
