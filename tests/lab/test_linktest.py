"""What `mkctl linktest` finds is what happened on the simulated line, in virtual time."""

from __future__ import annotations

import pytest

from lab.link.cases import FULL, Case
from lab.link.fates import Fate
from lab.linktest import LIMIT, case_of, happened, measure_link
from mkdaemon.client.linktest.advice import judge
from mkdaemon.client.linktest.measures import measure
from mkdaemon.client.linktest.probes import ProbeKind


def test_losses_and_latencies_put_into_the_radio_are_found_within_a_tenth():
    """Under full load: link tests and stick frames, each against what became of every single one."""
    channel = {"kind": "xbee", "loss": 0.08, "mean_burst": 1.2}
    radio = {"to_board": channel, "to_host": {**channel, "usb_timer": 0.001}}
    case = Case("full", 20, FULL, setpoint_hz=15, sim={"board": "nc", "nc": "2.14", "fc": "2.14", "radio": radio})
    measured = measure_link(case, 12.0)
    for kind, fates in ((ProbeKind.ECHO, measured.echoes), (ProbeKind.CONTROL, measured.sticks)):
        found = measure(measured.run.of(kind))
        loss, mean_ms = happened(fates)
        assert found.lost >= 10, kind
        assert found.loss_percent == pytest.approx(100 * loss, rel=LIMIT), kind
        assert found.mean_ms == pytest.approx(mean_ms, rel=LIMIT), kind


def test_what_a_line_adds_is_found_and_a_timer_is_named():
    wire, timer = (measure_link(case_of(name), 8.0).run for name in ("wire", "timer"))
    assert measure(wire.of(ProbeKind.ECHO)).lost == 0
    added = measure(timer.of(ProbeKind.ECHO)).mean_ms - measure(wire.of(ProbeKind.ECHO)).mean_ms
    # Tests 100 ms apart find a timer of 16 ms in four phases, 4 ms apart: their mean is that of all within half of it.
    assert added == pytest.approx(8.0, abs=2.0)
    assert not any("timer" in advice for advice in judge([wire]).advice)
    assert any(advice.startswith("Latency timer") for advice in judge([timer]).advice)


def test_what_happened_is_a_share_lost_and_a_mean():
    assert happened([Fate(0.0, heard=0.01), Fate(0.0), Fate(0.0, heard=0.3), Fate(0.0, heard=0.03)]) == (0.5, 20.0)
