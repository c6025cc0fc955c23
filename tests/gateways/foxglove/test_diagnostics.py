"""What is well and what is not."""

from __future__ import annotations

import json

import pytest

from mkdaemon.gateways.foxglove.diagnostics import Diagnostics, schema
from mkdaemon.gateways.foxglove.names import Names
from mkdaemon.reading.diagnoses import DiagnosticLevel
from mkdaemon.reading.known import key_of
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.link import LinkCondition
from mkdaemon.telemetry.preflight import Blocks, CheckState, ControlPreflight, Finding
from mkdaemon.telemetry.record import RecorderState, RecordStatus
from mkdaemon.telemetry.state import Battery
from tests.gateways.foxglove.viewer import complaints
from tests.view.page import flights

NAMES = Names("mk1")


def link(condition):
    health = flights.link_health(1.0)
    return health.model_copy(update={"state": flights.link_state(1.0, condition)})


def battery(*, is_low):
    return Battery(stamp=flights.stamp(1.0), source="fc", **(flights.BATTERY | {"is_low": is_low}))


def recorder(state, lost=0):
    numbers = dict.fromkeys(("file_bytes", "total_bytes", "entries", "queue_bytes", "queue_limit_bytes"), 1)
    return RecordStatus(
        stamp=flights.stamp(1.0), state=state, reason="", file="a.mcap", free_bytes=None, lost=lost, **numbers
    )


ROWS = [
    (flights.alive(1.0), "vehicle", DiagnosticLevel.OK),
    (flights.alive(1.0, is_alive=False, reason="silent"), "vehicle", DiagnosticLevel.ERROR),
    (flights.alive(1.0, error="no GPS"), "vehicle", DiagnosticLevel.ERROR),
    (link(LinkCondition.UP), "link", DiagnosticLevel.OK),
    (link(LinkCondition.DEGRADED), "link", DiagnosticLevel.WARN),
    (link(LinkCondition.ABSENT), "link", DiagnosticLevel.ERROR),
    (flights.status(1.0), "control", DiagnosticLevel.OK),
    (flights.status(1.0, phase=Phase.STALE), "control", DiagnosticLevel.ERROR),
    (flights.status(1.0, phase=Phase.LANDING), "control", DiagnosticLevel.WARN),
    (battery(is_low=False), "battery", DiagnosticLevel.OK),
    (battery(is_low=True), "battery", DiagnosticLevel.ERROR),
    (recorder(RecorderState.RECORDING), "recording", DiagnosticLevel.OK),
    (recorder(RecorderState.RECORDING, lost=3), "recording", DiagnosticLevel.WARN),
    (recorder(RecorderState.FULL), "recording", DiagnosticLevel.ERROR),
]


def shown(value):
    return json.loads(Diagnostics(NAMES)(key_of(value), value))


def line_of(value, name):
    return next(line for line in shown(value)["status"] if line["name"] == name)


@pytest.mark.parametrize(("value", "name", "level"), ROWS)
def test_each_part_says_how_it_is(value, name, level):
    status = line_of(value, name)
    assert (status["level"], status["hardware_id"]) == (level, "mk1")
    assert all(isinstance(one["value"], str) for one in status["values"])
    assert not [one["key"] for one in status["values"] if "stamp" in one["key"] or "since" in one["key"]]


def test_what_it_stands_on_is_there():
    status = line_of(flights.link_health(1.0), "link")
    assert {"key": "echo.p99_ms", "value": "44"} in status["values"]
    assert {"key": "state.condition", "value": "up"} in status["values"]


def test_every_check_before_a_flight_is_a_line():
    def found(name, state, blocks, token=None):
        return Finding(name=name, state=state, blocks=blocks, token=token, reason="why.", fix="do.")

    findings = (
        found("gate", CheckState.STANDS, Blocks.LEASE, "gate_shut"),
        found("advice", CheckState.STANDS, Blocks.NOTHING),
        found("disk", CheckState.PASSED, Blocks.AUTONOMY),
        found("eye", CheckState.UNKNOWN, Blocks.AUTONOMY),
    )
    report = shown(ControlPreflight(stamp=flights.stamp(1.0), is_ready=False, findings=findings))
    assert [one["level"] for one in report["status"]] == [
        DiagnosticLevel.ERROR,
        DiagnosticLevel.WARN,
        DiagnosticLevel.OK,
        DiagnosticLevel.WARN,
    ]
    assert report["status"][0]["message"] == "why. do."


def test_the_time_is_the_values_and_other_values_say_nothing():
    assert shown(flights.status(1.5))["header"]["stamp"] == {"sec": 1700000001, "nsec": 500000000}
    assert Diagnostics(NAMES)("state/attitude", flights.attitude(1.0)) is None


def test_the_schema_has_the_name_that_panels_look_for_and_viewers_can_read_it():
    assert (schema().name, schema().encoding) == ("diagnostic_msgs/DiagnosticArray", "jsonschema")
    assert list(complaints(json.loads(schema().data))) == []


def test_what_stays_as_it_is_is_shown_once_a_second_and_what_changes_at_once():
    show, shown_at = Diagnostics(NAMES), []
    for n in range(100):  # 4.95 s at 20 Hz, low from 2.5 s on; the voltage is another each time
        at, is_low = n * 0.05, n >= 50
        numbers = flights.BATTERY | {"is_low": is_low, "voltage": 15.0 + n * 0.01}
        message = show("state/battery", Battery(stamp=flights.stamp(at), source="fc", **numbers))
        if message is not None:
            line = next(line for line in json.loads(message)["status"] if line["name"] == "battery")
            shown_at.append((at, line["level"]))
    assert [level for _, level in shown_at] == [0, 0, 0, 2, 2, 2]
    assert [at for at, _ in shown_at] == pytest.approx([0.0, 1.0, 2.0, 2.5, 3.5, 4.5])


def test_the_verdict_comes_first_and_a_part_that_falls_silent_is_stale():
    show = Diagnostics(NAMES)
    lines = json.loads(show("control/status", flights.status(1.0)))["status"]
    assert [line["name"] for line in lines] == ["verdict", "control"]
    show("state/battery", battery(is_low=False))
    later = battery(is_low=False).model_copy(update={"stamp": flights.stamp(9.0)})
    lines = {line["name"]: line for line in json.loads(show("state/battery", later))["status"]}
    assert {name: line["level"] for name, line in lines.items()} == {"verdict": 1, "control": 3, "battery": 0}
    assert lines["verdict"]["message"] == "control silent for 8.0 s"
