"""Figures of eight: the path is the one that is named; what was kept is summed up, and the goal is asked."""

from __future__ import annotations

import json

import numpy as np
import pytest

from lab import paths
from mkdaemon.config.autopilot import AutopilotConfig
from mkdaemon.control.estimator.model import AircraftModel
from mkdaemon.control.path.stored import StoredPaths
from mksim.programs.rehearsal import EIGHT, HEIGHT, ROOM_FENCE
from mksim.scene.room import LAP, figure_of_eight


@pytest.mark.parametrize(("speed", "limits"), [(EIGHT, {}), (paths.SPEED, paths.LIMITS)])
def test_the_figure_is_two_metres_by_one_at_its_mean_speed_and_within_the_limits(speed, limits):
    stored = StoredPaths(AutopilotConfig(fence_radius=ROOM_FENCE, **limits))
    found = stored.find(stored.upload(figure_of_eight(speed, 3, HEIGHT), AircraftModel()).id)
    place = np.array(found.drawn)
    assert np.ptp(place, axis=0) == pytest.approx((2.0, 1.0, 0.0), abs=0.02)
    lap = found.curve.duration / 2.0 + np.linspace(-0.5, 0.5, 400) * LAP / speed
    velocity = found.curve.at(lap).velocity
    assert np.hypot(*velocity[:, :2].T).mean() == pytest.approx(speed, rel=0.02)


@pytest.mark.parametrize(
    ("away", "ending", "found"),
    [([0.03, 0.04], "finished", "finished"), ([], "finished", "held"), ([], "lost", "lost"), ([0.1], "lost", "lost")],
)
def test_only_a_flight_that_finished_can_have_missed_its_path(away, ending, found):
    row = paths.Followed(away, [1.0]).judged({"ending": ending, "why": "because"})
    assert row["ending"] == found
    assert row["rms_cm"] == ({2: 3.5, 1: 10.0}[len(away)] if away else None)


def test_kept_flights_are_summed_up_and_the_goal_is_asked(tmp_path, capsys):
    kept = tmp_path / "paths.jsonl"
    row = {"ending": "finished", "why": "", "most_cm": 20.0, "touch_cm": 2.0, "slowed": 0.1, "seconds": 50.0}
    for worst, code in ((9.9, 0), (10.1, 1)):
        keys = [{"seed": seed, "wind": "light", "speed": 1.0} for seed in (1, 2)]
        lines = [
            {"campaign": "paths", "key": key, "row": row | {"rms_cm": rms}}
            for key, rms in zip(keys, (7.0, worst), strict=True)
        ]
        kept.write_text("".join(json.dumps(line) + "\n" for line in lines))
        assert paths.main(seeds=2, jobs=1, results=kept, as_json=True) == code
        [found] = json.loads(capsys.readouterr().out)["rows"]
        assert (found["flights"], found["finished"], found["rms_cm"]["1.0"]) == (2, 2, worst)
