"""Mutants of a tiny module: which there are, which die, and what is said of the others."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from lab.mutants.main import Tree, choose, draw
from lab.mutants.operators import Module, Mutant
from lab.mutants.plugin import Measured
from lab.mutants.results import read_reasons
from mkdaemon.errors import ConfigError
from tests.places import ROOT

TINY = '''
"""A module; 1 + 1 in words is none."""

from dataclasses import dataclass

LIMIT = 2


@dataclass(frozen=True)
class Level:
    height: float = 1.5


def clip(value: int, most: int = LIMIT) -> int:
    """At most `most`."""
    return min(value, most)


def is_high(value: float) -> bool:
    return value > Level().height


def note(notes: list[int], value: int) -> None:
    notes.append(value)
    if value < 0:
        return
    notes.append(f"{value + 1}")


def halve(value: int) -> int:
    """To below 2, in steps."""
    while value >= 2:
        value //= 2
    return value
'''
TESTS = """
import pytest
from tiny.levels import clip, halve, is_high, note

@pytest.fixture(scope="module")
def clipped():
    return clip(1), clip(3), clip(5, most=4)

def test_how_many_are_clipped(clipped):
    assert len(clipped) == 3

def test_clip(clipped):
    assert clipped == (1, 2, 4)

def test_is_high():
    assert is_high(1.6) and not is_high(1.4) and not is_high(1.0)

def test_note():
    notes = []
    note(notes, 3)
    note(notes, -1)
    assert notes == [3, "4", -1]

@pytest.mark.timeout(1)
def test_halve():
    assert halve(6) == 1
"""


@pytest.fixture
def tiny(tmp_path):
    """A source tree with one module and its tests."""
    for path, text in {
        "pytest.ini": "[pytest]\nasyncio_default_fixture_loop_scope = function\n",
        "src/tiny/__init__.py": "",
        "src/tiny/levels.py": TINY,
        "tests/tiny/test_levels.py": TESTS,
    }.items():
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(text, encoding="utf-8")
    return tmp_path


def mutants_of(source):
    return {(m.operator, m.was, m.becomes) for m in Module("a.py", source).mutants.values()}


def run_mutants(root, *options):
    words = [sys.executable, "-m", "lab", "mutants", "src/tiny/levels.py", "--root", str(root), *options]
    return subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False, timeout=300)


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("x = a < b", {("boundary", "a < b", "a <= b"), ("compare", "a < b", "a >= b")}),
        ("x = a is b", {("compare", "a is b", "a is not b")}),
        ("x = a + b * c", {("arithmetic", "a + b * c", "a - b * c"), ("arithmetic", "b * c", "b / c")}),
        ("x = 3", {("constant", "x = 3", "x = 4")}),
        ("x = 0.2", {("constant", "x = 0.2", "x = 0.4")}),
        ("x = True", {("constant", "x = True", "x = False")}),
        ("x = a and b", {("boolean", "a and b", "a or b")}),
        ("x = not a", {("unary", "not a", "a")}),
        ("x = min(a, b)", {("swapped", "min(a, b)", "max(a, b)")}),
        ("x = f(a, b=c)", {("keyword", "f(.., b=c)", "f(..)")}),
        ("f(a)", {("removed", "f(a)", "pass")}),
        ("x = a if b else c", {("negated", "b", "not b")}),
        ("def f() -> float:\n    return x", {("return", "return x", "return 0.0")}),
        ("def f() -> int | None:\n    return x", {("return", "return x", "return None")}),
        ("def f() -> bool:\n    return x", {("return", "return x", "return not x")}),
        ("def f():\n    a.b = c", {("removed", "a.b = c", "pass")}),
        ('"""1 + 1"""', set()),
        ("x: Annotated[int, 3]", set()),
        ("def f(a: Literal[1]) -> Literal[2]: ...", set()),
        ("log.debug('x', a=1)", set()),
        ("@dataclass(frozen=True)\nclass A: ...", set()),
        ("x = f'{a + 1}'", set()),
        ("if TYPE_CHECKING:\n    x = 1", set()),
    ],
)
def test_every_operator_changes_what_it_should_and_no_words(source, expected):
    assert mutants_of(source) == expected


def test_ids_are_places_and_the_tree_is_as_before_afterwards():
    module = Module("a.py", "x = a + b + c\ny = min(a, min(b, c))\n")
    assert [mutant.id for mutant in module.mutants.values()] == [
        "a.py:1:8:arithmetic",
        "a.py:1:12:arithmetic",
        "a.py:2:4:swapped",
        "a.py:2:11:swapped",
    ]
    changed = [module.with_mutant(mutant) for mutant in module.mutants]
    assert changed[0] == "x = a - b + c\ny = min(a, min(b, c))"
    assert len({*changed}) == 4


def test_a_sample_is_the_same_for_the_same_seed():
    mutants = list(Module("a.py", "\n".join(f"x{n} = {n}" for n in range(50))).mutants.values())
    assert draw(mutants, 5, 1) == draw(mutants[:], 5, 1) != draw(mutants, 5, 2)
    assert len(draw(mutants, 5, 1)) == 5
    assert set(draw(mutants, 5, 1)) < set(draw(mutants, 9, 1))
    assert draw(mutants, 0, 1) == draw(mutants, 99, 1) == mutants


def test_a_tiny_module_is_judged_and_a_second_run_knows_the_verdicts(tiny):
    first = run_mutants(tiny, "--json")
    assert first.returncode == 1, first.stderr
    found = json.loads(first.stdout.splitlines()[-1])
    survivors = {(s["was"], s["becomes"]) for s in found["survivors"]}
    assert survivors == {
        ("value > Level().height", "value >= Level().height"),
        ("value < 0", "value < 1"),
        ("value < 0", "value <= 0"),
        ("value >= 2", "value >= 3"),
        ("value >= 2", "value > 2"),
    }
    assert found["timeouts"] > 0
    assert found["mutants"] == found["killed"] + found["survived"]
    again = run_mutants(tiny, "--json")
    assert json.loads(again.stdout.splitlines()[-1]) == found
    assert again.stderr == ""
    assert_reasons_count(tiny)


def assert_reasons_count(tiny):
    """Survivors with a reason do not fail, and equivalent ones do not count."""
    reasons = tiny / "lab/mutants/survivors.toml"
    reasons.parent.mkdir(parents=True)
    entry = '[[survivor]]\npath = "src/tiny/levels.py"\nscope = "{}"\nwas = "{}"\nbecomes = "{}"\nreason = "known"\n'
    height = entry.format("is_high", "value > Level().height", "value >= Level().height") + "is_equivalent = true\n"
    notes = [entry.format("note", "value < 0", becomes) for becomes in ("value < 1", "value <= 0")]
    notes += [entry.format("halve", "value >= 2", becomes) for becomes in ("value >= 3", "value > 2")]
    reasons.write_text("".join([height, *notes]), encoding="utf-8")
    run = run_mutants(tiny)
    assert run.returncode == 0, run.stdout
    assert "0 of 5 survivors without a reason" in run.stdout
    assert "1 equivalent" in run.stdout


def test_tests_that_cannot_be_collected_are_an_error_and_no_verdict(tiny):
    (tiny / "tests/tiny/test_levels.py").write_text("import nothing_like_that\n", encoding="utf-8")
    run = run_mutants(tiny)
    assert run.returncode != 0
    assert "pytest.log" in run.stderr


MUTANT = Mutant("src/a.py", 3, 4, "compare", "f", 3, False, "a < b", "a >= b")
SECONDS = {"tests/test_a.py::own": 2.0, "tests/test_b.py::short": 1.0, "tests/test_b.py::long": 9.0}


@pytest.mark.parametrize(
    ("budget", "fails", "tests"),
    [
        (0.0, (), ["test_a.py::own", "test_b.py::short", "test_b.py::long"]),
        (4.0, (), ["test_a.py::own", "test_b.py::short"]),
        (0.5, (), ["test_a.py::own"]),
        (0.0, ["tests/test_a.py::own"], ["test_b.py::short", "test_b.py::long"]),
    ],
)
def test_tests_that_tell_most_in_the_least_time_come_first_within_a_budget(tmp_path, budget, fails, tests):
    measured = {
        test: Measured(seconds=seconds, taken=seconds, lines={"src/a.py": [3]}, fails=test in fails)
        for test, seconds in SECONDS.items()
    }
    measured["tests/test_c.py::elsewhere"] = Measured(seconds=0.0, taken=0.0, lines={"src/a.py": [4]}, fails=False)
    tree = Tree(tmp_path, {"src/a.py": Module("src/a.py", "a < b")}, measured)
    assert choose(tree, MUTANT, budget) == [f"tests/{test}" for test in tests]


def test_a_reason_with_an_unknown_word_is_refused(tmp_path):
    (tmp_path / "reasons.toml").write_text("[[survivor]]\nfile = 'x'\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"reasons\.toml"):
        read_reasons(tmp_path / "reasons.toml")
