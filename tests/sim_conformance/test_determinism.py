"""Same seed, same bytes: the whole simulated aircraft, flying by hand beside a busy line."""

from __future__ import annotations

import hashlib

import pytest

from mkdaemon.protocol.framing import Frame, FrameDecoder, encode_frame
from mksim.config import ChannelConfig, PilotPlan, RadioConfig, RadioKind, SimConfig
from mksim.simulation import Simulation

XBEE = RadioConfig(
    to_board=ChannelConfig(kind=RadioKind.XBEE, loss=0.03), to_host=ChannelConfig(kind=RadioKind.XBEE, loss=0.03)
)


def record(config, *, tick=1e-3, seconds=9.0):
    """Everything the host hears, with its times, as one digest, and the number of frames."""
    simulation = Simulation(config)
    digest = hashlib.sha256()
    decoder = FrameDecoder()
    frames = 0
    requests = [
        (1.0 + 1.7 * number, encode_frame(0, letter, bytes([interval])))
        for number in range(5)
        for letter, interval in (("c", 5), ("d", 20), ("o", 10), ("v", 0))
    ]
    requests += [(2.0 + 0.05 * n, encode_frame(1, "b", bytes([n & 31, 0, 0, 0, 1 + n, 1, 0]))) for n in range(100)]
    requests.sort()
    steps = round(seconds / tick)
    for step in range(1, steps + 1):
        now = step * tick
        if step - 1 == steps // 2:  # the simulation stands at the same time, whatever the step
            simulation.world.faults.start("wind_gust")
            simulation.world.faults.start("imu_bias", duration=1.0)
        while requests and requests[0][0] < now:
            at, raw = requests.pop(0)
            simulation.write(raw, at)
        for at, data in simulation.advance(now):
            digest.update(f"{at:.9f}".encode() + data)
            frames += sum(isinstance(item, Frame) for item in decoder.feed(data))
    truth = simulation.world.truth
    digest.update(truth.position_enu.tobytes() + truth.enu_from_flu.tobytes())
    return digest.hexdigest(), frames


@pytest.mark.parametrize(("board", "radio"), [("nc", XBEE), ("fc", RadioConfig())], ids=["nc-xbee", "fc-wired"])
def test_two_runs_are_identical(board, radio):
    config = SimConfig(seed=5, board=board, radio=radio, pilot_plan=PilotPlan.HOVER, pilot_wait=0.0)
    first, second = record(config), record(config)
    assert first == second
    assert first[1] > 50


def test_another_seed_is_another_flight():
    assert record(SimConfig(seed=5))[0] != record(SimConfig(seed=6))[0]


def test_the_size_of_the_time_step_does_not_matter_on_a_wire():
    """Virtual time is exact: one millisecond at a time or seven, the same bytes at the same times."""
    config = SimConfig(seed=5, radio=RadioConfig(to_host=ChannelConfig()))
    assert record(config, tick=1e-3, seconds=7.0) == record(config, tick=7e-3, seconds=7.0)
