"""The benchmark itself, in small: its figures are made by `python -m lab protocol`."""

from __future__ import annotations

import json

import pytest

from lab.protocol import default_recording, main, measure_speed, recording_of, survive
from mkdaemon.errors import MkError
from mkdaemon.protocol.framing import MAX_FRAME_CHARS
from tests.places import CAPTURES

EXCERPT = CAPTURES / "nc_mixed_60s.jsonl"


def test_one_object_on_the_last_line(capsys):
    assert main(recording=EXCERPT, fuzz_bytes=20_000, rounds=1, as_json=True) == 0
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert {"frames_per_s", "us_per_frame", "mb_per_s", "peer_frames_per_s", "ratio"} <= set(report)
    assert report["frames_per_s"] * report["us_per_frame"] == pytest.approx(1e6, rel=0.01)
    assert report["ratio"] == pytest.approx(report["frames_per_s"] / report["peer_frames_per_s"], rel=0.01)


def test_words_without_the_option(capsys):
    assert main(recording=EXCERPT, fuzz_bytes=5_000, rounds=1) == 0
    assert "ratio" in capsys.readouterr().out


def test_every_frame_of_the_recording_is_counted():
    stream = recording_of(EXCERPT)
    frames = stream.count(b"\r")
    assert measure_speed(stream, "x", rounds=1).frames == frames * (100_000 // len(stream))


@pytest.mark.parametrize("seed", range(4))
def test_damaged_bytes_are_survived(seed):
    survival = survive(recording_of(EXCERPT), 250_000, seed=seed)
    assert survival.fuzz_bytes >= 250_000
    assert survival.fuzz_resynchronised == survival.fuzz_blocks > 0
    assert survival.fuzz_pending_max <= MAX_FRAME_CHARS
    assert set(survival.fuzz_dropped) == {"text", "length", "characters", "checksum"}
    assert survival.fuzz_messages > 0
    assert survival.fuzz_unknown > 0


def test_a_missing_recording_is_named(tmp_path):
    with pytest.raises(MkError, match=r"nowhere\.jsonl is missing"):
        recording_of(tmp_path / "nowhere.jsonl")
    assert default_recording().is_file()
