"""The system clock is set while the whole daemon runs on a recording."""

from __future__ import annotations

import asyncio
import time

import msgpack
import pytest
import zenoh

from lab.rigs.waiting import wait_until
from mkdaemon.clock import Clock
from mkdaemon.config.root import Config
from mkdaemon.daemon.program import run
from tests.bus.support import PATIENCE, bus_config, client, free_endpoint
from tests.places import DATA

RECORDING = DATA / "captures" / "nc_mixed_60s.jsonl"
SETTLED = 2.0
"""Stamps are right again so long after the step [s]."""
TOLERANCE = 0.1
"""How right [s]."""
REGULAR = {"mk/t/raw/rx", "mk/t/rx/nc/osd", "mk/t/state/attitude", "mk/t/link/health", "mk/t/health"}


@pytest.mark.parametrize("step", [3600.0, -3600.0])
async def test_after_a_step_of_an_hour_stamps_are_right_within_2_s_and_an_event_says_so(step):
    shift = 0.0
    clock = Clock(wall=lambda: time.time() + shift)
    endpoint = free_endpoint()
    cfg = Config.model_validate(
        {"link": {"port": f"replay:{RECORDING}"}, "bus": bus_config(endpoint), "vehicle": {"name": "t"}}
    )
    stop = asyncio.Event()
    daemon = asyncio.create_task(run(cfg, stop, clock))
    heard: list[tuple[str, dict]] = []

    def on_sample(sample: zenoh.Sample) -> None:
        heard.append((str(sample.key_expr), msgpack.unpackb(sample.payload.to_bytes())))

    def has_all(since: float) -> bool:
        """Whether whatever comes regularly, once a second at least, was stamped after a time."""
        return {key for key, value in heard if value["stamp"]["monotonic"] > since} >= REGULAR

    session = client(endpoint)
    with await asyncio.to_thread(session.__enter__) as opened:
        opened.declare_subscriber("mk/t/**", on_sample)
        await wait_until(lambda: has_all(0.0), PATIENCE, 0.05)
        shift, stepped_at = step, time.monotonic()
        await wait_until(lambda: has_all(stepped_at + SETTLED), PATIENCE, 0.05)
        offset = time.time() + shift - time.monotonic()
    stop.set()
    await asyncio.wait_for(daemon, PATIENCE)

    [event] = [value for key, value in heard if key == "mk/t/event/clock"]
    assert event["step"] == pytest.approx(step, abs=TOLERANCE)
    assert 0 <= event["stamp"]["monotonic"] - stepped_at <= SETTLED
    stamps = {}
    for key, value in heard:
        stamp = value["stamp"]
        if stamp["monotonic"] - stepped_at > SETTLED:
            stamps[key] = abs(stamp["wall"] - stamp["monotonic"] - offset)
    assert max(stamps.values()) < TOLERANCE
