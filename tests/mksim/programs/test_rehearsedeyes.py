"""The eyes of the demonstration: what they refuse and what is wrong with their images is published."""

from __future__ import annotations

import asyncio
from collections import Counter

from lab.rigs.waiting import running
from mkdaemon.telemetry.vision import Alarm, EyeState, PoseRefused, VisionPose, VisionStats
from mkdaemon.virtualtime import run_virtually
from mksim.programs.rehearsal import Rehearsal, simulated_aircraft
from mksim.simulation import Simulation


def looked(calibrated, seconds=6.0):
    """All values of a flight that stands on its pad, seen by eyes that take their lens for another one."""
    values = []

    async def look():
        config = simulated_aircraft(1, "none", 5.0)
        rehearsal = Rehearsal(config, Simulation(config), lambda moment, status: None, calibrated=calibrated)
        rehearsal.watch(lambda suffix, value: values.append(value))
        async with running(rehearsal.fly()):
            await asyncio.sleep(seconds)

    run_virtually(look())
    return values


def of(kind, values):
    return [value for value in values if isinstance(value, kind)]


def test_refusals_are_counted_and_published_by_image():
    values = looked(lambda lens: lens.model_copy(update={"fx": 0.7 * lens.fx}))
    refused, stats = of(PoseRefused, values), of(VisionStats, values)[-1]
    counted = Counter(one.refusal.value for one in refused if one.sequence <= stats.processed)
    assert counted == stats.refused != {}
    assert stats.posed < 1.0


def test_a_lens_of_another_size_is_an_alarm():
    values = looked(lambda lens: lens.model_copy(update={"width": lens.width // 2}), 2.0)
    stats = of(VisionStats, values)[-1]
    assert not of(VisionPose, values)
    assert stats.state is EyeState.WRONG_SIZE
    assert set(stats.alarms) == {Alarm.WRONG_SIZE}
