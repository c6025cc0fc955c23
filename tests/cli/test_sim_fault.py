"""`mkctl sim faults`."""

from __future__ import annotations

import json

from mkdaemon.cli.mkctl.app import app
from mkdaemon.cli.program import run
from mkdaemon.telemetry.sim_faults import FAULTS


def test_faults_are_told_to_programs_too(capsys):
    assert run(app, ["sim", "faults", "--json"]) == 0
    told = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [fault["name"] for fault in told] == list(FAULTS)
    weak = next(fault for fault in told if fault["name"] == "motor_weak")
    assert weak["effect"].endswith(".")
    assert weak["parameters"]["share"]["high"] == 1.0
