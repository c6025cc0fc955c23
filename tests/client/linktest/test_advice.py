"""Whether a line will do, and what would make it better."""

from __future__ import annotations

import random

import pytest

from mkdaemon.client.linktest.advice import Grade, judge
from mkdaemon.client.linktest.measures import LoadRun
from mkdaemon.client.linktest.probes import Probe, ProbeKind


def run(trips, load="light", kind=ProbeKind.ECHO, **more):
    found = tuple(Probe(kind, 0.2 * number, trip) for number, trip in enumerate(trips))
    return LoadRun("line", load, 0.0, found, **more)


def both(echo, control):
    probes = (*run(echo).probes, *run(control, kind=ProbeKind.CONTROL).probes)
    return LoadRun("line", "full", 50.0, probes)


WIRE = [0.0055] * 300
RADIO = [0.04 + 0.0002 * (number % 200) for number in range(300)]


def words(*runs):
    return " ".join(judge(runs).advice)


def test_a_wire_and_a_good_radio_need_no_advice_and_the_worst_load_decides():
    for trips in (WIRE, RADIO):
        verdict = judge([run(trips), run(trips, "full")])
        assert (verdict.grade, verdict.advice) == (Grade.GOOD, ())
    assert "0.00 % lost, 99 of 100 round trips within 6 ms" in judge([run(WIRE)]).reason
    verdict = judge([run(RADIO), run(RADIO + [None, 0.04] * 20, "full")])
    assert verdict.grade is Grade.POOR
    assert verdict.reason.startswith("full load")


@pytest.mark.parametrize(
    ("trips", "grade"),
    [
        (RADIO + [None] * 3, Grade.GOOD),
        (RADIO + [None, 0.04] * 4, Grade.USABLE),
        (RADIO + [0.2] * 6, Grade.USABLE),
        (RADIO + [None, 0.04] * 20, Grade.POOR),
        ([0.04] * 300 + [None] * 5 + [0.04] * 300, Grade.POOR),  # 1.2 s without an answer
        ([None] * 10, Grade.POOR),
        ([], Grade.UNKNOWN),
    ],
)
def test_the_grade_follows_losses_latencies_and_silence(trips, grade):
    assert judge([run(trips)]).grade is grade


def test_latencies_and_losses_say_by_their_pattern_what_would_help():
    rng = random.Random(1)
    assert "Latency timer" in words(run([0.0055 + 0.016 * rng.random() for _ in range(300)]))
    assert "Latency timer" not in words(run([0.0245 if number % 5 == 0 else 0.0055 for number in range(300)]))
    assert "Latency timer" not in words(run([0.04 + 0.016 * rng.random() for _ in range(300)]))
    assert "Gap: 3.2 %" in words(run(WIRE), both(WIRE, WIRE + [None] * 10))
    assert "Gap" not in words(run(WIRE), both(WIRE, WIRE))
    assert "Rate: the line is 84 % full" in words(run(WIRE), run(WIRE, "full", line_share=0.84))
    assert "Rate: full load costs +9.0 %" in words(run(RADIO), run(RADIO + [None, 0.05, 0.05] * 37, "full"))
    assert "Interference: losses come 4.0 in a row" in words(run((RADIO + [None] * 4) * 3))
    assert "Range: single packets" in words(run([None, *[0.04] * 19] * 15))
    assert "Wire: answers" in words(run([None, *[0.005] * 19] * 15))


def test_damage_over_a_wire_is_told_and_a_daemon_that_stood_still_is_told_alone():
    assert "Noise: 12 bytes" in words(run(WIRE, damaged=12))
    assert "Noise" not in words(run(RADIO, damaged=12))
    (advice,) = judge([run(RADIO + [None] * 60, stalled=0.2)]).advice
    assert advice.startswith("Machine: the daemon did not run for 20 %")
