"""The vision campaign's own arithmetic: seeds, truth, flips; the figures belong to `python -m lab vision`."""

from __future__ import annotations

import json
from itertools import pairwise

import numpy as np
import pytest

from lab.vision.flight import VGA, fly, share_in_view
from lab.vision.main import CASES, main, run_case
from lab.vision.stills import SeedSet, Studio, error_of, look_once, target_named
from lab.vision.truth import labelled_tags
from mkdaemon.errors import ConfigError
from mkdaemon.vision.pose.pose import turn


def test_seed_sets_never_meet():
    bases = sorted(seeds.base for seeds in SeedSet)
    assert all(later - earlier >= 1_000_000 for earlier, later in pairwise(bases))


def test_equal_seeds_give_equal_flights_and_others_do_not():
    def first(seed):
        return next(iter(fly(target_named("nested"), seed, seconds=0.2)))

    a, b, c = first(5), first(5), first(6)
    assert np.array_equal(a.image.pixels, b.image.pixels)
    assert np.array_equal(a.position, b.position)
    assert not np.array_equal(a.position, c.position)


def test_the_truth_of_a_still_is_where_the_tracker_finds_it():
    studio = Studio(target_named("nested"), 3, fine=False)
    still = studio.shoot(1.5, 0.4, off=0.05)
    found = look_once(still, studio.target, VGA, with_attitude=True).pose_of("pad")
    assert found is not None
    error = error_of(found.pose.rotation, found.pose.position, still.rotation, still.position)
    assert error.distance < 0.002
    assert not error.is_wrong


def test_the_share_of_a_target_in_view_counts_its_corners():
    target = target_named("single")
    facing = np.diag([1.0, -1.0, -1.0])
    shares = [share_in_view(target, facing, np.array([x, 0.0, 1.0]), VGA) for x in (0.0, 0.5, 2.0)]
    assert shares == [1.0, 0.5, 0.0]


def test_a_pose_off_by_six_centimetres_or_turned_is_wrong():
    true, position = np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, 3.0])
    assert error_of(turn(true, np.radians([0, 0, 20.0])), position, true, position).is_wrong
    assert error_of(true, position + np.array([0, 0, 0.06]), true, position).is_wrong
    assert error_of(true, position, true, position).distance == 0.0


def test_an_unknown_case_names_the_known_ones():
    with pytest.raises(ConfigError, match="flights"):
        run_case("flight", True, SeedSet.DEVELOPMENT)
    assert {"cold", "accuracy", "view_angle", "conditions", "flights", "hardships", "false_positives"} <= set(CASES)


def test_photographs_case_prints_one_object_on_its_last_line(capsys, shared):
    main(case="photographs", quick=True, as_json=True)
    figures = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert figures["seeds"] == "reporting"
    assert figures["photographs"]["labelled"]["found"] >= 45


def test_photographs_of_real_tags(shared):
    labelled = labelled_tags(shared / "images" / "apriltag")
    assert labelled["labels"] == 47
    assert labelled["found"] >= 45
    assert labelled["corners_within_half_px"] >= 40  # the labels are without edge refinement, the corners are not
