"""Figures of a measurement of the line, and measurements as CSV."""

from __future__ import annotations

import pytest

from mkdaemon.client.linktest.measures import (
    LoadRun,
    histogram,
    losses_over_time,
    measure,
    percentile,
    runs_of_losses,
    weighted_averages,
)
from mkdaemon.client.linktest.probefile import HEADER, read_csv, to_csv
from mkdaemon.client.linktest.probes import Probe, ProbeKind
from mkdaemon.errors import ConfigError
from mkdaemon.link.session.evidence import RoundTrips


def probes(*trips, every=0.1):
    return [Probe(ProbeKind.ECHO, every * number, trip) for number, trip in enumerate(trips)]


def test_figures_of_a_short_measurement_and_of_none():
    found = measure(probes(0.010, None, None, 0.020, None, 0.060))
    assert (found.sent, found.lost, found.loss_percent) == (6, 3, 50.0)
    assert (found.least_ms, found.p50_ms, found.most_ms) == (10.0, 20.0, 60.0)
    assert found.mean_ms == pytest.approx(30.0)
    assert found.weighted_ms == pytest.approx(11.25 + (60 - 11.25) / 8)
    assert (found.mean_run, found.longest_run) == (1.5, 2)
    assert found.silence == pytest.approx(0.3)
    found = measure(probes(None))
    assert (found.p50_ms, found.weighted_ms, found.silence, found.loss_percent) == (None, None, 0.0, 100.0)
    assert measure([]).loss_percent == 0.0


def test_average_and_percentiles_are_those_of_the_daemon():
    trips = [0.01 * ((7 * number) % 23 + 1) for number in range(200)]
    daemon = RoundTrips(window=1e9, timeout=10.0)
    for number, trip in enumerate(trips):
        daemon.sent(number, float(number))
        daemon.answered(number, number + trip)
    theirs, ours = daemon.statistics(300.0), measure(probes(*trips))
    assert ours.weighted_ms == pytest.approx(theirs.mean_ms)
    assert (ours.p50_ms, ours.p95_ms, ours.p99_ms) == pytest.approx((theirs.p50_ms, theirs.p95_ms, theirs.p99_ms))
    assert weighted_averages([8.0, 16.0]) == [8.0, 9.0]
    assert percentile([], 0.5) is None


def test_histogram_and_losses_over_time_keep_what_is_longer_and_parts_without_probes():
    assert histogram([0.0, 4.9, 5.0, 14.9, 99.0], 5.0, 3) == [2, 1, 2]
    sent = [Probe(ProbeKind.ECHO, at, trip) for at, trip in ((0.0, 0.01), (1.0, None), (1.5, 0.01), (4.0, None))]
    assert losses_over_time(sent, 4.0, 4) == [0.0, 0.5, None, 1.0]
    assert runs_of_losses(sent) == [1, 1]


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
