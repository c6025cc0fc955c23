"""Branches that were taken are counted, where a tracer would count them too."""

from __future__ import annotations

import importlib
import json
import sys
from types import SimpleNamespace

import pytest

from tools.branches import PACKAGES, Finder, Measurement, missing_branches, shares

MODULE = '''\
"""A docstring stays in front."""
from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import nothing


def sign(number: Unknown) -> str:
    """Return a word."""
    if number > 0:
        return "positive"
    elif number < 0:
        return "negative"
    return "zero"


def total(numbers):
    result = 0
    for number in numbers:
        if number is None:
            break
        result += number
    else:
        result += 100
    while result > 1000:
        result -= 1000
    return result


def kind(value):
    while True:
        match value:
            case int() if value > 9:
                return "large"
            case int():
                return "small"
        return "none"
'''


@pytest.fixture
def finder(tmp_path, monkeypatch):
    """A package whose modules get probes, and another one beside it."""
    for package in ("flying", "other"):
        (tmp_path / package).mkdir()
        (tmp_path / package / "__init__.py").touch()
        (tmp_path / package / "module.py").write_text(MODULE, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    made = Finder(["flying"])
    monkeypatch.setattr(sys, "meta_path", [made, *sys.meta_path])
    yield made
    for name in [name for name in sys.modules if name.partition(".")[0] in {"flying", "other"}]:
        del sys.modules[name]


def missing(finder, path):
    return missing_branches(finder.taken, path)


def test_what_nobody_imported_has_no_branch_taken(finder, tmp_path):
    count, left = missing(finder, tmp_path / "flying" / "module.py")
    assert count == len(left) == 13


def test_branches_are_taken_as_the_module_runs(finder, tmp_path):
    path = tmp_path / "flying" / "module.py"
    module = importlib.import_module("flying.module")
    assert len(missing(finder, path)[1]) == 13
    assert (module.sign(1), module.sign(-1)) == ("positive", "negative")
    assert missing(finder, path)[1][0] == (14, 0)
    assert module.sign(0) == "zero"
    assert module.total([1, 2]) == 103
    assert missing(finder, path)[1][:2] == [(22, 23), (27, 28)]
    assert module.total([999, 999, None]) == 998
    assert (module.kind(10), module.kind(1)) == ("large", "small")
    assert missing(finder, path)[1] == [(34, 0)]
    assert module.kind("word") == "none"
    assert missing(finder, path)[1] == []


def test_a_module_of_another_package_is_left_alone(finder):
    importlib.import_module("other.module")
    assert finder.taken == {}


def test_what_worker_processes_took_is_added(finder, tmp_path):
    path = tmp_path / "flying" / "module.py"
    module = importlib.import_module("flying.module")
    here = Measurement(Finder(["flying"]))
    for number in (1, -1):
        module.sign(number)
        worker = SimpleNamespace(workeroutput={})
        Measurement(finder).pytest_sessionfinish(SimpleNamespace(config=worker))
        here.pytest_testnodedown(SimpleNamespace(workeroutput=json.loads(json.dumps(worker.workeroutput))), None)
        finder.taken[str(path)][:] = bytes(13)
    assert missing(here.finder, path)[1][0] == (14, 0)


def test_a_package_below_the_floor_names_its_lines(tmp_path):
    for package in PACKAGES:
        (tmp_path / package).mkdir()
        (tmp_path / package / "a.py").write_text("for a in b:\n    if a:\n        c()\n", encoding="utf-8")
    whole = {str(tmp_path / package / "a.py"): bytearray([1, 1, 1, 1]) for package in PACKAGES}
    assert all(holds for holds, _ in shares(whole, tmp_path))
    whole[str(tmp_path / "link" / "a.py")][2:] = bytes(2)
    (words,) = [words for holds, words in shares(whole, tmp_path) if not holds]
    assert words == "link        50.0 % of 4 branches, 95 % are needed; missing: link/a.py [(2, 0), (2, 3)]"


def test_a_run_below_the_floor_fails(monkeypatch):
    config = SimpleNamespace(getoption=lambda _: True)
    session = SimpleNamespace(config=config, exitstatus=0)
    monkeypatch.setattr("tools.branches.shares", lambda taken: [(True, "link"), (False, "bus")])
    measurement = Measurement(Finder([]))
    measurement.pytest_sessionfinish(session)
    written = []
    measurement.pytest_terminal_summary(SimpleNamespace(write_line=written.append))
    assert (session.exitstatus, written) == (1, ["link", "bus"])
