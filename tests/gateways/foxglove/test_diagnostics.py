"""What is well and what is not."""

from __future__ import annotations

import json

from mkdaemon.gateways.foxglove.diagnostics import LOOK_PERIOD, Diagnostics
from mkdaemon.gateways.foxglove.names import Names
from mkdaemon.reading.diagnoses import DiagnosticLevel
from mkdaemon.reading.known import key_of
from mkdaemon.telemetry.preflight import Blocks, CheckState, ControlPreflight, Finding
from tests import samples
from tests.values import made

NAMES = Names("mk1")


def shown(value):
    return json.loads(Diagnostics(NAMES)(key_of(value), value))


def test_a_check_before_a_flight_is_a_line():
    checks = dict.fromkeys(("name", "reason", "fix"), "x.") | {"state": CheckState.STANDS, "blocks": Blocks.LEASE}
    report = shown(made(ControlPreflight, samples.stamp(1.0), findings=(made(Finding, **checks),)))
    assert [(one["level"], one["message"]) for one in report["status"]] == [(DiagnosticLevel.ERROR, "x. x.")]


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
