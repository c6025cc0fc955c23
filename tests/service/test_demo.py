"""The demo, end to end: what a first user sees, and what its exit code means."""

from __future__ import annotations

import json

import pytest

from mkdaemon.cli.session import Sample
from mkdaemon.service.demo import ENOUGH, Tally, summarise
from tests.daemon.processes import run_mkdaemon


@pytest.mark.flight
def test_the_demo_flies_shows_and_ends_with_a_summary():
    code, out, err = run_mkdaemon("demo", "--seconds", "2.5")
    assert code == 0, out + err
    assert "telemetry flowed" in out
    for word in ("rx/nc/osd", "rx/nc/attitude", "echo", "battery", "position", "p50"):
        assert word in out


@pytest.mark.flight
def test_the_summary_as_json():
    code, out, err = run_mkdaemon("demo", "--seconds", "2", "--json")
    summary = json.loads(out.splitlines()[-1])
    assert code == 0, err
    assert summary["telemetry_flowed"] is True
    assert summary["frames"]["rx/nc/osd"] > 5
    assert summary["rates_hz"]["rx/nc/attitude"] > 2
    assert summary["echo_ms"]["p50"] > 3.4  # two frames of ten characters at 57600 baud
    assert 10 < summary["battery_v"] < 18
    assert -90 < summary["latitude"] < 90


def test_telemetry_has_flowed_only_when_all_of_it_has():
    tally = Tally()
    for n, suffix in enumerate(ENOUGH):
        assert not tally.has_flowed
        assert not summarise(tally)["telemetry_flowed"]
        tally.take(Sample(suffix, {}, ""), float(n))
    assert tally.has_flowed
    tally.take(Sample("rx/nc/osd", {}, ""), 10.0)
    tally.take(Sample("rx/nc/osd", {}, ""), 10.0)
    assert summarise(tally)["rates_hz"] == {"rx/nc/osd": 0.2}
