"""What is well and what is not."""

from __future__ import annotations

import json

from mkdaemon.gateways.foxglove.diagnostics import LOOK_PERIOD, Diagnostics, schema
from mkdaemon.gateways.foxglove.names import Names
from mkdaemon.reading.diagnoses import DiagnosticLevel
from mkdaemon.reading.known import key_of
from mkdaemon.telemetry.preflight import Blocks, CheckState, ControlPreflight, Finding
from tests import samples
from tests.gateways.foxglove.viewer import complaints
from tests.values import made

NAMES = Names("mk1")


def shown(value):
    return json.loads(Diagnostics(NAMES)(key_of(value), value))


def line_of(value, name):
    return next(line for line in shown(value)["status"] if line["name"] == name)


def test_what_it_stands_on_and_its_time_are_there():
    status = line_of(samples.link_health(1.0), "link")
    assert {"key": "echo.p99_ms", "value": "44"} in status["values"]
    assert {"key": "state.condition", "value": "up"} in status["values"]
    assert (status["level"], status["hardware_id"]) == (DiagnosticLevel.OK, "mk1")
    assert all(isinstance(one["value"], str) for one in status["values"])
    assert not [one["key"] for one in status["values"] if "stamp" in one["key"] or "since" in one["key"]]
    assert shown(samples.status(1.5))["header"]["stamp"] == {"sec": 1700000001, "nsec": 500000000}
    assert Diagnostics(NAMES)("state/attitude", samples.attitude(1.0)) is None


def test_a_check_before_a_flight_is_a_line():
    checks = dict.fromkeys(("name", "reason", "fix"), "x.") | {"state": CheckState.STANDS, "blocks": Blocks.LEASE}
    report = shown(made(ControlPreflight, samples.stamp(1.0), findings=(made(Finding, **checks),)))
    assert [(one["level"], one["message"]) for one in report["status"]] == [(DiagnosticLevel.ERROR, "x. x.")]


def test_the_schema_has_the_name_that_panels_look_for_and_viewers_can_read_it():
    assert (schema().name, schema().encoding) == ("diagnostic_msgs/DiagnosticArray", "jsonschema")
    assert list(complaints(json.loads(schema().data))) == []


def test_what_stays_as_it_is_is_shown_once_a_second_and_what_changes_with_the_next_look():
    show, shown_at = Diagnostics(NAMES), []
    for n in range(80):  # 4.94 s at 16 Hz, low from 2.56 s on; the voltage is another each time
        at, is_low = n / 16, n > 40
        message = show("state/battery", samples.battery(at, is_low=is_low, voltage=15.0 + n * 0.01))
        if message is not None:
            line = next(line for line in json.loads(message)["status"] if line["name"] == "battery")
            shown_at.append((at, line["level"]))
    assert shown_at == [(0.0, 0), (1.0, 0), (2.0, 0), (2.75, 2), (3.75, 2), (4.75, 2)]
    assert shown_at[3][0] <= 41 / 16 + LOOK_PERIOD


def test_the_verdict_comes_first_and_a_part_that_falls_silent_is_stale():
    show = Diagnostics(NAMES)
    lines = json.loads(show("control/status", samples.status(1.0)))["status"]
    assert [line["name"] for line in lines] == ["verdict", "control"]
    show("state/battery", samples.battery(1.0))
    lines = {line["name"]: line for line in json.loads(show("state/battery", samples.battery(9.0)))["status"]}
    assert {name: line["level"] for name, line in lines.items()} == {"verdict": 1, "control": 3, "battery": 0}
    assert lines["verdict"]["message"] == "control silent for 8.0 s"
