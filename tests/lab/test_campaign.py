"""Parts in one process or several: the same figures in the same order, and what is said meanwhile."""

from __future__ import annotations

import json
import os
from unittest.mock import ANY

import pytest

from lab import compare
from lab.campaign import Campaign, CampaignError, Ending, Results, carried_out, endings, in_order
from lab.vision.main import CASES, main, run_case
from lab.vision.parts import Part, in_parts, run_parts
from lab.vision.stills import SeedSet
from lab.vision.tagfree import _tag_free
from mkdaemon.errors import ConfigError


def test_results_come_in_the_order_of_the_plan_and_images_do_not_depend_on_the_number_of_processes():
    parts = [Part(pow, (k, 2), 1) for k in range(4)]
    parts.insert(2, Part(_tag_free, (600, 4, 1), 1))
    here, elsewhere = run_parts("mixed", parts, 1), run_parts("mixed", parts, 2)
    assert here == elsewhere
    assert here.pop(2)[0].total() == 1
    assert here == [k * k for k in range(4)]


def test_a_process_that_dies_is_named():
    with pytest.raises(CampaignError, match="a process of the campaign died"):
        run_parts("doomed", [Part(os._exit, (3,), 1)] * 2, 2)


def test_an_error_in_a_part_is_the_caller_s():
    with pytest.raises(ZeroDivisionError):
        run_parts("failing", [Part(divmod, (1, 0), 1)] * 2, 2)


@pytest.mark.parametrize(("count", "size", "sizes"), [(10, 4, [4, 4, 2]), (8, 4, [4, 4]), (3, 4, [3])])
def test_parts_hold_every_image_once(count, size, sizes):
    assert in_parts(count, size) == list(enumerate(sizes))


@pytest.mark.parametrize("name", sorted(set(CASES) - {"stages", "photographs"}))
def test_plans_have_distinct_parts_of_the_asked_seeds(name):
    quick, full = (CASES[name].plan(q, SeedSet.REPORTING) for q in (True, False))
    assert len({part.args for part in full}) == len(full)
    assert sum(part.images for part in full) > sum(part.images for part in quick)
    development = CASES[name].plan(False, SeedSet.DEVELOPMENT)
    assert not {part.args for part in full} & {part.args for part in development}


def test_the_full_campaign_asks_often_enough():
    asked = {name: sum(p.images for p in CASES[name].plan(False, SeedSet.REPORTING)) for name in CASES}
    assert asked["false_positives"] >= 10_000
    assert asked["leaving"] >= 50_000


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


# -- campaigns of rows ------------------------------------------------------------------------------------------------


def land(seed):
    if seed == 3:
        raise TimeoutError("no tag")
    is_lost = seed == 2
    return {
        "ending": Ending.LOST if is_lost else Ending.FINISHED,
        "why": "a gust" if is_lost else "",
        "touch": seed / 3,
    }


LANDINGS = Campaign("landings", land, lambda seed: {"seed": seed})


def test_rows_come_in_the_order_asked_with_their_keys_and_one_that_fails_costs_no_other(capsys):
    rows = LANDINGS.rows([4, 3, 2])
    assert [(row["seed"], row["ending"]) for row in rows] == [(4, "finished"), (3, "failed"), (2, "lost")]
    assert rows[0]["touch"] == 1.3333
    assert rows[1]["why"].startswith("TimeoutError: no tag (test_campaign.py:")
    assert [row["seed"] for row in carried_out(rows)] == [4, 2]
    assert "landings: 2 of 3, 0:00 left: 3 failed TimeoutError: no tag" in capsys.readouterr().err


def test_rows_do_not_depend_on_the_number_of_processes():
    asked = [1, 2, 4, 5]
    here, elsewhere = LANDINGS.rows(asked), LANDINGS.rows(asked, 2)
    assert [{**row, "processor_s": 0} for row in here] == [{**row, "processor_s": 0} for row in elsewhere]


def test_a_second_run_goes_on_with_the_file_and_tries_again_what_failed(tmp_path, capsys):
    kept = tmp_path / "kept.jsonl"
    LANDINGS.rows([1, 3], 1, kept)
    capsys.readouterr()
    assert [row["seed"] for row in LANDINGS.rows([3, 2, 1], 1, kept)] == [3, 2, 1]
    assert len(capsys.readouterr().err.splitlines()) == 2
    assert [json.loads(line)["key"]["seed"] for line in kept.read_text().splitlines()] == [1, 2]


def test_a_last_line_that_was_not_written_to_its_end_costs_its_row_only(tmp_path, capsys):
    kept = tmp_path / "kept.jsonl"
    LANDINGS.rows([1, 4], 1, kept)
    kept.write_text(kept.read_text()[:-9])
    assert [row["seed"] for row in LANDINGS.rows([1, 4], 1, kept)] == [1, 4]
    assert "its last line is not whole" in capsys.readouterr().err
    assert [json.loads(line)["key"]["seed"] for line in kept.read_text().splitlines()] == [1, 4]


def test_a_file_that_is_none_of_results_is_named_with_its_line(tmp_path):
    kept = tmp_path / "kept.jsonl"
    kept.write_text("[]\n")
    with pytest.raises(ConfigError, match=r"kept.jsonl:1: no row of a campaign"):
        LANDINGS.rows([1], 1, kept)


def work_for_ever(seed):
    while True:
        sum(range(1000))


def test_one_that_computes_for_too_long_has_failed():
    [row] = Campaign("endless", work_for_ever, lambda seed: {"seed": seed}, limit=0.2).rows([1])
    assert row["ending"] == "failed"
    assert row["why"].startswith("LimitReached: not within 0.2 s of processor time")


def process(seed):
    return os.getpid()


def test_each_that_leaves_something_behind_has_a_process_of_its_own():
    assert len({*in_order(process, [1, 2], is_alone=True), os.getpid()}) == 3


def test_the_sum_says_how_many_finished_and_why_the_others_did_not():
    found = endings(LANDINGS.rows([1, 2, 3]))
    assert found.pop("unfinished") == ["2: lost: a gust", ANY]
    assert found == {"flights": 3, "finished": 1, "released": 0, "lost": 1, "failed": 1}


# -- two results ------------------------------------------------------------------------------------------------------


def kept_in(path, endings):
    results = Results(path)
    for seed, (ending, touch) in endings.items():
        results.add("landings", {"seed": seed}, {"ending": ending, "touch_cm": touch})
    return path


def test_flights_of_two_results_are_compared_pair_by_pair(tmp_path, capsys):
    before = kept_in(tmp_path / "a", {1: ("finished", 3.0), 2: ("lost", None), 3: ("finished", 5.0), 9: ("lost", 1.0)})
    after = kept_in(tmp_path / "b", {1: ("finished", 2.0), 2: ("finished", 4.0), 3: ("released", 4.5)})
    assert compare.main(before, after, as_json=True) == 1
    assert json.loads(capsys.readouterr().out)["landings"] == {
        "pairs": 3,
        "endings": {"finished -> finished": 1, "finished -> released": 1, "lost -> finished": 1},
        "worse": ["seed=3"],
        "better": ["seed=2"],
        "figures": {"touch_cm": {"before": 4.0, "after": 3.25, "difference": -0.75}},
    }
    assert compare.main(before, before) == 0
    assert "4 pairs" in capsys.readouterr().out


def test_a_campaign_is_carried_out_in_two_trees(tmp_path, capsys):
    trees = []
    for name, ending in (("old", "lost"), ("new", "finished")):
        (tmp_path / name / "lab").mkdir(parents=True)
        (tmp_path / name / "lab" / "__init__.py").touch()
        row = json.dumps({"campaign": "landings", "key": {"seed": 1}, "row": {"ending": ending}}) + "\n"
        (tmp_path / name / "lab" / "__main__.py").write_text(f"import sys; open(sys.argv[-1], 'w').write({row!r})")
        trees.append(tmp_path / name)
    assert compare.main(*trees, "landings") == 0
    assert "better: seed=1" in capsys.readouterr().out


@pytest.mark.parametrize("campaign", [(), ("demo",)])
def test_what_cannot_be_compared_is_refused(tmp_path, campaign):
    file = kept_in(tmp_path / "a", {1: ("finished", 3.0)})
    other = kept_in(tmp_path / "b", {2: ("finished", 3.0)})
    with pytest.raises(ConfigError, match="two files of --results, or two source trees"):
        compare.main(tmp_path, file, *campaign)
    with pytest.raises(ConfigError, match="no flight in common"):
        compare.main(file, other, *campaign)
