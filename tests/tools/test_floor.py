"""Coverage has a floor for every package, and what is below it names its files."""

from __future__ import annotations

import json

import pytest

from mkdaemon.errors import ConfigError, MkError
from tools.floor import floor, read_covers


def report(**files):
    """A report of `tools.branches` with (branches, covered) of each file."""
    return {
        "files": {
            f"src/mkdaemon/{name.replace('__', '/')}.py": {
                "summary": {"num_branches": branches, "covered_branches": covered}
            }
            for name, (branches, covered) in files.items()
        }
    }


def test_branches_are_summed_over_a_package():
    link, protocol = read_covers(report(link__a=(10, 9), link__session__b=(30, 30), protocol__c=(0, 0)))
    assert (link.package, link.branches, link.covered, link.missing) == ("link", 40, 39, {"a.py": 1})
    assert (protocol.share, protocol.missing) == (1.0, {})


def test_a_package_below_the_floor_fails_and_names_its_files(tmp_path, capsys):
    path = tmp_path / "branches.json"
    path.write_text(json.dumps(report(link__a=(100, 94), translate__b=(100, 95))), encoding="utf-8")
    with pytest.raises(MkError, match=r"^link: 94\.0 % of the branches, 95 % are needed; missing in a\.py \(6\)$"):
        floor(path)
    assert "translate   95.0 % of 100 branches" in capsys.readouterr().out


def test_a_missing_report_says_what_writes_it(tmp_path):
    with pytest.raises(ConfigError, match="`make test` writes it"):
        floor(tmp_path / "none.json")
