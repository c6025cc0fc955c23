"""Parts in one process or several: the same figures in the same order, and what is said meanwhile."""

from __future__ import annotations

import os

import pytest

from lab.campaign import Part, Progress, in_parts, run_parts
from lab.vision.main import CASES, main, run_case
from lab.vision.never import Tally, all_flips
from lab.vision.stills import SeedSet
from lab.vision.tagfree import _tag_free
from mkdaemon.errors import ConfigError, VisionError


def test_results_come_in_the_order_of_the_plan_and_images_do_not_depend_on_the_number_of_processes():
    parts = [Part(pow, (k, 2), 1) for k in range(4)]
    parts.insert(2, Part(_tag_free, (600, 4, 1), 1))
    here, elsewhere = run_parts("mixed", parts, 1), run_parts("mixed", parts, 2)
    assert here == elsewhere
    assert sum(here.pop(2)["images"].values()) == 1
    assert here == [k * k for k in range(4)]


def test_a_process_that_dies_is_named():
    with pytest.raises(VisionError, match="case 'doomed' died"):
        run_parts("doomed", [Part(os._exit, (3,), 1)] * 2, 2)


def test_an_error_in_a_part_is_the_caller_s():
    with pytest.raises(ZeroDivisionError):
        run_parts("failing", [Part(divmod, (1, 0), 1)] * 2, 2)


def test_progress_tells_what_is_left():
    progress = Progress("cold", 400, clock=iter([0.0, 1.0]).__next__)
    progress.add(100)
    assert progress.line(30.0) == "cold: 100 of 400 images, 25 %, 1:30 left"


@pytest.mark.parametrize(("count", "size", "sizes"), [(10, 4, [4, 4, 2]), (8, 4, [4, 4]), (3, 4, [3])])
def test_parts_hold_every_image_once(count, size, sizes):
    assert in_parts(count, size) == list(enumerate(sizes))


@pytest.mark.parametrize("name", sorted(set(CASES) - {"rates", "stages", "photographs"}))
def test_plans_have_distinct_parts_of_the_asked_seeds(name):
    quick, full = (CASES[name].plan(q, SeedSet.REPORTING) for q in (True, False))
    assert len({part.args for part in full}) == len(full)
    assert sum(part.images for part in full) > sum(part.images for part in quick)
    development = CASES[name].plan(False, SeedSet.DEVELOPMENT)
    assert not {part.args for part in full} & {part.args for part in development}


def test_the_full_campaign_asks_often_enough():
    asked = {name: sum(p.images for p in CASES[name].plan(False, SeedSet.REPORTING)) for name in CASES}
    assert asked["false_positives"] >= 10_000
    assert 2 * asked["flips"] >= 10_000


def test_flips_of_flights_and_views_are_counted_together():
    one = {"frames": 10, "published": 8, "flips": 1}
    both = {"with_attitude": one, "without_attitude": one}
    results = {"flips": both, "flights": {"nested": both, "single": both}}
    assert all_flips(results) == {"asked": 60, "published": 48, "flipped": 6}
    assert all_flips({"flips": both}) == {"asked": 20, "published": 16, "flipped": 2}


def test_tallies_of_parts_add_up():
    parts = [Tally(), Tally()]
    parts[0].frames["none"], parts[1].frames["dim"], parts[1].wrong = 3, 2, 1
    whole = Tally.together(parts).summary()
    assert (whole["frames"], whole["published"], whole["wrong"]) == (5, 0, 1)


def test_results_that_a_page_quotes_are_whole_campaigns_on_reporting_seeds(tmp_path):
    file = tmp_path / "vision.json"
    for less in ({"quick": True}, {"seeds": SeedSet.DEVELOPMENT}):
        with pytest.raises(ConfigError, match="--into"):
            main(case="cold", into=file, **less)
    assert not file.exists()


def test_no_job_at_all_is_refused():
    with pytest.raises(ConfigError, match="--jobs 0"):
        main(case="cold", jobs=0)
    with pytest.raises(ConfigError, match="no case"):
        run_case("flight", True, SeedSet.DEVELOPMENT, 2)
