"""FlightCtrl: menu and labels (docs/protocol.md, section 5)."""

from __future__ import annotations

import pytest

from mkdaemon.protocol.framing import encode_frame
from mksim.boards.labels import FC_LABELS, NC_LABELS
from tests.sim_conformance.bench import fc_bench, nc_bench


@pytest.mark.parametrize("asked", [*range(20), 20, 255])
def test_a_page_has_eighty_characters_and_one_too_high_is_empty_and_falls_back(asked):
    frame = fc_bench().ask(encode_frame(1, "l", bytes([asked])), 2.0).frame
    assert len(frame.raw) == 118
    assert frame.payload[:2] == bytes([asked if asked < 20 else 0, 19])
    text = frame.payload[2:82].decode("latin-1")
    assert f"[{asked}]" in text[:20]
    assert "\0" not in text
    assert (text.replace(f"[{asked}]", "").strip() == "") is (asked >= 20)


def test_keys_turn_pages():
    bench = fc_bench()
    pages = []
    for number, keys in enumerate((0xFF, 0xFD, 0xFD, 0xFE, 0xFC, 0xFE, 0xFF)):
        received = bench.ask(encode_frame(1, "h", bytes([keys, 0])), 2.0 + 0.1 * number, 0.09)
        pages.append(int(received.frame.payload[:20].decode().rpartition("[")[2].rstrip("]")))
    assert pages == [0, 1, 2, 1, 0, 19, 19]


@pytest.mark.parametrize(("bench", "labels"), [(fc_bench, FC_LABELS), (nc_bench, NC_LABELS)])
def test_labels(bench, labels):
    made = bench()
    got = []
    for index in range(33):
        received = made.ask(encode_frame(0, "a", bytes([index])), 2.0 + 0.05 * index, 0.04)
        assert received.frame.payload[0] == min(index, 31)
        got.append(received.frame.payload[1:17].decode("latin-1"))
    assert [text.rstrip() for text in got[:32]] == list(labels)
    assert got[32] == got[31]
    assert {len(text) for text in labels} <= set(range(1, 17))
