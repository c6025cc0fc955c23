"""The benchmark itself, in small: its figures are made by `python -m lab protocol`."""

from __future__ import annotations

import json

from lab import protocol


def test_the_figures_of_decoding(monkeypatch, capsys):
    monkeypatch.setattr(protocol, "ROUNDS", 1)
    assert protocol.main(as_json=True) == 0
    [report] = json.loads(capsys.readouterr().out)["rows"]
    assert report["frames_per_s"] > 0
    stream = protocol.recorded()
    assert report["frames"] == stream.count(b"\r") * max(1, 100_000 // len(stream))
