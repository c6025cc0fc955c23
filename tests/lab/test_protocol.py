"""The benchmark itself, in small: its figures are made by `python -m lab protocol`."""

from __future__ import annotations

import json

import pytest

from lab.protocol import default_recording, main, measure_speed, recording_of
from mkdaemon.errors import MkError
from tests.places import CAPTURES

EXCERPT = CAPTURES / "nc_mixed_60s.jsonl"


def test_the_figures_of_decoding(capsys):
    assert main(recording=EXCERPT, rounds=1, as_json=True) == 0
    [report] = json.loads(capsys.readouterr().out)["rows"]
    assert {"frames_per_s", "us_per_frame", "mb_per_s", "peer_frames_per_s", "ratio"} <= set(report)
    assert report["frames_per_s"] * report["us_per_frame"] == pytest.approx(1e6, rel=0.01)
    assert report["ratio"] == pytest.approx(report["frames_per_s"] / report["peer_frames_per_s"], rel=0.01)


def test_every_frame_of_the_recording_is_counted():
    stream = recording_of(EXCERPT)
    frames = stream.count(b"\r")
    assert measure_speed(stream, "x", rounds=1)["frames"] == frames * (100_000 // len(stream))


def test_a_missing_recording_is_named(tmp_path):
    with pytest.raises(MkError, match=r"nowhere\.jsonl is missing"):
        recording_of(tmp_path / "nowhere.jsonl")
    assert default_recording().is_file()
