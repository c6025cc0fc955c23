"""The measurement of gateways: what is made of what came."""

from __future__ import annotations

import pytest

from lab.gateways import Part, figures_of
from lab.rigs.gatewaypeers import Arrivals

START = 1_700_000_000.0


def arrivals(late, keep=lambda place: True):
    """Attitudes, 40 a second for 10 s."""
    found = Arrivals()
    for place in filter(keep, range(400)):
        at = START + place / 40
        found.late.append((at, late))
        found.counts[int(at)] += 1
    return found


def figures(late=0.002, keep=lambda place: True, daemon=0.22, gateway=0.1):
    parts = [Part(START + 3 * place, START + 3 * place + 3, gateway, daemon, 0.2) for place in range(3)]
    return figures_of("foxglove", parts, arrivals(0.0005), arrivals(late, keep))


def test_what_is_added_is_beside_the_bus():
    found = figures()
    assert found["holds"]
    assert (found["came"], found["added_p50_ms"], found["late_p99_ms"]) == (1.0, 1.5, 2.0)
    assert found["messages_per_s"] == pytest.approx(40, abs=1)
    assert found["daemon_ratio"] == pytest.approx(1.1)


@pytest.mark.parametrize("worse", [{"keep": lambda place: place % 20}, {"daemon": 0.23}, {"gateway": 0.16}])
def test_what_misses_a_goal_or_loses_values_does_not_hold(worse):
    assert not figures(**worse)["holds"]
