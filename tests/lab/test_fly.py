"""The whole daemon, as a process, flies the simulated aircraft over a target it sees through the rendered camera."""

from __future__ import annotations

import pytest

from lab.fly import fly


@pytest.mark.flight
@pytest.mark.real_time(tolerance=0.1)
async def test_a_client_streams_a_position_and_the_aircraft_holds_over_the_target():
    figures = await fly(seconds=16.5, fps=15.0, wind="indoor", seed=3)
    assert not figures["lost"], figures
    assert figures["held_s"] >= 10.0
    assert figures["hover_max_cm"] < 50.0
    assert [words.partition(":")[0] for words in figures["phases"]] == ["free", "leased", "flying", "releasing", "free"]
