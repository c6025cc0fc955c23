"""Recorded traffic of genuine boards, replayed: fed the host's side, the simulated boards answer with the same frames.

Equal are the kinds, addresses, lengths and order of all frames, and every byte of those that carry no measurement and
no text of ours.
"""

from __future__ import annotations

import json
from collections import Counter

import pytest

from mkdaemon.protocol.framing import Frame, FrameDecoder
from mksim.boards.flightctrl import FlightCtrl
from mksim.boards.generations import FC_GENERATIONS, NC_GENERATIONS
from mksim.boards.navictrl import NaviCtrl
from mksim.config import GasLaw
from tests.sim_conformance.bench import Bench, StillAircraft

START_TIME = 1.0
SAME_BYTES = "BGJNPQTUWXZ"
"""Replies without measurement or text: equal to the last bit."""
LABEL_SUM_AT = 3
"""Byte of a FlightCtrl's V that sums up its label texts."""


def genuine_pilot(aircraft):
    """The transmitter as it stood when the FlightCtrl was recorded."""
    pilot = aircraft.pilot
    pilot.gas, pilot.pitch, pilot.roll, pilot.yaw = -121, -5, -5, -5
    pilot.gate, pilot.switches = 6, {2: 6, 3: 6, 4: 6}


def boards(name):
    aircraft = StillAircraft()
    genuine_pilot(aircraft)
    flight = FlightCtrl(FC_GENERATIONS["2.12a"], aircraft, seed=3, gas_law=GasLaw.FORK)
    if name.startswith("fc"):
        return Bench(flight, aircraft)
    return Bench(NaviCtrl(NC_GENERATIONS["0.24"], flight, seed=3), aircraft)


def replay(path):
    """Return what the genuine and what the simulated board answered."""
    entries = [json.loads(line) for line in path.read_text().splitlines()]
    bench = boards(path.name)
    decoder = FrameDecoder()
    genuine = []
    for entry in entries:
        raw = bytes.fromhex(entry["hex"])
        if entry["dir"] == "tx":
            bench.send(raw, START_TIME + entry["t"])
        else:
            genuine += [item for item in decoder.feed(raw) if isinstance(item, Frame)]
    bench.run(START_TIME + entries[-1]["t"] + 0.5)
    return genuine, [received.frame for received in bench.received]


def kinds(frames):
    return [(frame.address, frame.id, len(frame.raw)) for frame in frames]


@pytest.mark.parametrize("name", ["fc_commands.jsonl", "nc_commands.jsonl"])
def test_every_request_gets_the_recorded_reply(fixtures, name):
    genuine, simulated = replay(fixtures / "captures" / name)
    assert len(genuine) > 40
    assert kinds(simulated) == kinds(genuine)
    for ours, theirs in zip(simulated, genuine, strict=True):
        if ours.id in SAME_BYTES:
            assert ours.raw == theirs.raw
        if ours.id == "V":
            skipped = LABEL_SUM_AT if ours.address == 1 else 12
            assert ours.payload[:skipped] == theirs.payload[:skipped]
            assert ours.payload[skipped + 1 :] == theirs.payload[skipped + 1 :]
        if ours.id in "AL":
            assert ours.payload[0] == theirs.payload[0], "number of the label or page"


def test_a_minute_of_mixed_traffic_has_the_recorded_counts(shared):
    genuine, simulated = replay(shared / "captures" / "nc_mixed_60s.jsonl")
    expected, got = Counter(frame.id for frame in genuine), Counter(frame.id for frame in simulated)
    assert expected["O"] == 611
    assert got.keys() == expected.keys()
    for kind, count in expected.items():
        # streams run on for half a second after the recording ends; one-shot replies are exact
        assert abs(got[kind] - count) <= (12 if kind in "OCD" else 1 if kind == "Z" else 0)


def test_the_order_of_replies_on_a_loaded_line_is_the_recorded_one(fixtures):
    genuine, simulated = replay(fixtures / "captures" / "nc_mixed_60s.jsonl")
    streams = [frame.id for frame in genuine if frame.id in "OCD"]
    ours = [frame.id for frame in simulated if frame.id in "OCD"]
    # one-shot replies meet the streams at another phase of the loop; the streams keep their places
    assert ours[: len(streams)] == streams
