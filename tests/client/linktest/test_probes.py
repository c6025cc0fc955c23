"""What became of every frame that wants an answer, and measurements as CSV."""

from __future__ import annotations

import pytest

from mkdaemon.client.linktest.measures import LoadRun
from mkdaemon.client.linktest.probefile import HEADER, read_csv, to_csv
from mkdaemon.client.linktest.probes import Ledger, Probe, ProbeKind
from mkdaemon.errors import ConfigError
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


RUNS = [
    LoadRun('XBee, "attic"', "light", 0.0, (Probe(ProbeKind.ECHO, 0.0, 0.0423), Probe(ProbeKind.ECHO, 0.2, None))),
    LoadRun('XBee, "attic"', "full", 15.0, (Probe(ProbeKind.CONTROL, 0.5, 0.0101), Probe(ProbeKind.ECHO, 0.6, 0.05))),
]


def test_what_was_written_is_read_again(tmp_path):
    file = tmp_path / "radio.csv"
    file.write_text(to_csv(RUNS))
    assert read_csv(file) == RUNS


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"", "its first line is"),
        (b"a,b\n", "its first line is"),
        (b"\xff\xfe", "no CSV of"),
        (",".join(HEADER).encode() + b"\n", "no measurement"),
        (",".join(HEADER).encode() + b"\nx,light,0,link test,0.1\n", "line 2: not enough values"),
        (",".join(HEADER).encode() + b"\nx,light,0,telepathy,0.1,5\n", "line 2: 'telepathy'"),
        (",".join(HEADER).encode() + b"\nx,light,0,link test,nan,5\n", "line 2: nan is not a figure"),
        (",".join(HEADER).encode() + b"\nx,light,0,link test,0,-5\n", "line 2: -5 is not a figure"),
    ],
)
def test_another_file_is_refused_by_line(tmp_path, content, complaint):
    file = tmp_path / "other.csv"
    file.write_bytes(content)
    with pytest.raises(ConfigError, match=complaint):
        read_csv(file)
    with pytest.raises(ConfigError, match="No such file"):
        read_csv(tmp_path / "none.csv")
