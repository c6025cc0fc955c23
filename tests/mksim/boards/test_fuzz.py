"""Nothing a host can send makes a board raise or hang, and two carriage returns bring it back."""

from __future__ import annotations

import random

import pytest

from mkdaemon.protocol.framing import encode_frame
from mksim.boards.navictrl_state import ESCAPE
from mksim.config import GasLaw
from tests.sim_conformance.bench import fc_bench, nc_bench

LETTERS = "abcdefghijklmnopqstuvwxyzKVZ?!"  # without R: it resets
"""Every letter but the resets, which are tested elsewhere."""


@pytest.mark.parametrize("word", ["early", "2.08", "2.12a", "2.14"])
@pytest.mark.parametrize("law", list(GasLaw))
def test_any_frame_to_a_flightctrl(word, law):
    rng = random.Random(f"{word} {law}")
    bench = fc_bench(word, gas_law=law)
    at = 1.1
    for _ in range(150):
        letter = rng.choice(LETTERS.replace("j", "").replace("o", ""))  # both can be deaf until power-off
        payload = rng.randbytes(rng.choice((0, 1, 2, 3, 7, 9, 11, 16, 30, 78, 145)))
        bench.send(encode_frame(rng.randrange(4), letter, payload), at)
        at += rng.uniform(0.005, 0.4)
    bench.run(at + 12.0)
    before = len(bench.received)
    bench.send(b"\r\r" + encode_frame(1, "v"), at + 12.0)
    bench.run(at + 14.0)
    assert "V" in bench.ids(bench.received[before:])


@pytest.mark.parametrize("fc", ["early", "2.08", "2.12a", "2.14"])
@pytest.mark.parametrize("word", ["0.24", "2.14"])
def test_any_frame_to_a_navictrl(word, fc):
    rng = random.Random(word)
    bench = nc_bench(word, fc=fc)
    at = 1.1
    for _ in range(150):
        letter = rng.choice(LETTERS)
        payload = rng.randbytes(rng.choice((0, 1, 2, 3, 4, 7, 9, 12, 30, 60)))
        bench.send(encode_frame(rng.randrange(4), letter, payload), at)
        if rng.random() < 0.1:
            bench.send(ESCAPE, at + 0.05)
        at += rng.uniform(0.005, 0.2)
    bench.send(ESCAPE, at)
    bench.run(at + 5.0)
    before = len(bench.received)
    bench.send(b"\r" + encode_frame(2, "v"), at + 5.0)
    bench.run(at + 6.0)
    assert "V" in bench.ids(bench.received[before:])
