"""`python -m lab mutants`: change the code that decides, one place at a time, and see whether a test notices."""

from __future__ import annotations

import hashlib
import json
import random
import re
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final

from cyclopts import Parameter

from lab.campaign import Jobs, Results, Row, each_result, minutes
from lab.mutants.judging import Trial, judge, measure
from lab.mutants.operators import Module, Mutant
from lab.mutants.plugin import Measured
from lab.mutants.results import REASONS, read_reasons, sum_up
from lab.places import ROOT
from mkdaemon.cli.arguments import AsJson
from mkdaemon.errors import ConfigError

SUBJECTS: Final[Mapping[str, tuple[str, ...]]] = {
    "src/mkdaemon/control": ("tests/control", "tests/translate"),
    "src/mkdaemon/client/teleop": ("tests/client/teleop",),
    "src/mkdaemon/link/session/release.py": ("tests/link/test_release.py", "tests/link/test_steering.py"),
    "src/mkdaemon/guard.py": ("tests/guard", "tests/daemon/test_guard.py"),
}
"""What is mutated when nobody says what, and the tests that judge it."""


@dataclass(frozen=True, slots=True)
class Tree:
    """A source tree under test.

    Attributes:
        root: its folder.
        modules: to mutate, by their paths from the root.
        measured: what each test does without a mutant.
    """

    root: Path
    modules: Mapping[str, Module]
    measured: Mapping[str, Measured]


def main(
    *files: Annotated[Path, Parameter(help="Files or folders; without any: control/, the release and the guard.")],
    sample: Annotated[int, Parameter(help="Mutants of each subject to try, drawn with the seed; 0: all.")] = 0,
    seed: int = 29,
    jobs: Jobs = 1,
    budget: Annotated[
        float, Parameter(help="Computing time of the tests of one mutant at most [s]; 0: no limit.")
    ] = 0.0,
    root: Annotated[Path, Parameter(help="Root of the source tree.")] = ROOT,
    as_json: AsJson = False,
) -> int:
    """Mutate the code that decides, and run the tests that come by; exit code 1 if a survivor has no reason.

    A mutant is killed when a test fails or takes too long. Reasons stand in `lab/mutants/survivors.toml`. A run that
    was stopped goes on where it was: verdicts are kept in `build/mutants`.
    """
    root = root.resolve()
    modules = {path: Module.read(root, path) for path in _paths(root, files)}
    by_subject: dict[str, list[Mutant]] = {}
    for path, module in modules.items():
        by_subject.setdefault(_subject_of(path), []).extend(module.mutants.values())
    mutants = [mutant for every in by_subject.values() for mutant in draw(every, sample, seed)]
    verdicts = judge_all(root, modules, mutants, jobs, budget)
    summary = {
        "seed": seed,
        "sample": sample,
        "budget": budget,
        "of": {name: len(every) for name, every in by_subject.items()},
        **sum_up(mutants, verdicts, read_reasons(root / REASONS), _subject_of),
    }
    unexplained = [survivor for survivor in summary["survivors"] if not survivor["reason"]]
    if as_json:
        print(json.dumps(summary))
    else:
        for survivor in unexplained:
            print("{id} {scope}: {was} -> {becomes}".format(**survivor))
        shares = "{killed} of {mutants} killed ({timeouts} by time), {equivalent} equivalent: {share:.1%}"
        for name, counts in {**summary["subjects"], "all": summary}.items():
            print(f"{name}: {shares.format(**counts)}")
        print(f"{len(unexplained)} of {len(summary['survivors'])} survivors without a reason")
    return 1 if unexplained else 0


def _paths(root: Path, files: Sequence[Path]) -> list[str]:
    """The modules to mutate, from the root.

    Raises:
        ConfigError: nothing is there.
    """
    places = [(root / path).resolve() for path in (files or map(Path, SUBJECTS))]
    found = {path for place in places for path in ([place] if place.is_file() else place.rglob("*.py"))}
    if not found:
        raise ConfigError(f"no Python file in {', '.join(map(str, places))}")
    return sorted(path.relative_to(root).as_posix() for path in found)


def _subject_of(path: str) -> str:
    """What of `SUBJECTS` a file belongs to; itself, where it is none of them."""
    return next((name for name in SUBJECTS if path == name or path.startswith(f"{name}/")), path)


def _tests_of(path: str) -> tuple[str, ...]:
    if (subject := _subject_of(path)) in SUBJECTS:
        return SUBJECTS[subject]
    package = path.removeprefix("src/").split("/")
    return (f"tests/{package[1].removesuffix('.py')}" if package[0] == "mkdaemon" else f"tests/{package[0]}",)


def draw(mutants: Sequence[Mutant], sample: int, seed: int) -> list[Mutant]:
    """Return all, or a sample that is the same for the same code; a larger one holds the smaller one."""
    if not 0 < sample < len(mutants):
        return list(mutants)
    names = sorted(mutant.id for mutant in mutants)
    random.Random(seed).shuffle(names)
    chosen = set(names[:sample])
    return [mutant for mutant in mutants if mutant.id in chosen]


def judge_all(
    root: Path, modules: Mapping[str, Module], mutants: Sequence[Mutant], jobs: int, budget: float
) -> dict[str, Row]:
    """Judge every mutant that has no verdict yet.

    A verdict holds while all files are the same; that of a killed one while its own file and that of the test that
    killed it are.

    Args:
        root: of the tree.
        modules: to mutate, by their paths from the root.
        mutants: of theirs, to judge.
        jobs: processes.
        budget: computing time of the tests of one mutant at most [s]; 0 for no limit.

    Returns:
        Verdicts by the mutants' ids.

    Raises:
        MkError: the tests cannot be collected.
    """
    keep = root / "build" / "mutants"
    prints = _fingerprints(root)
    everything = _fingerprint("".join(sorted(prints.values())))
    keep.mkdir(parents=True, exist_ok=True)
    kept, verdicts = Results(keep / "verdicts.jsonl"), dict[str, Row]()
    keys: dict[str, Row] = {mutant.id: {"mutant": mutant.id, "source": prints[mutant.path]} for mutant in mutants}
    for name, key in keys.items():
        row = kept.find("mutants", key)
        if row and (row["all"] == everything or (row["by"] and row["test"] == prints.get(_file_of(row["by"])))):
            verdicts[name] = row
    waiting = [mutant for mutant in mutants if mutant.id not in verdicts]
    if waiting:
        tests = sorted({test for path in modules for test in _tests_of(path)})
        measured = Results(keep / "measured.jsonl")
        asked: Row = {"all": everything, "modules": sorted(modules), "tests": tests}
        if (row := measured.find("tests", asked)) is None:
            row = measure(root, list(modules), tests, keep / "pytest.log")
            measured.add("tests", asked, row)
        tree, began = Tree(root, modules, row), time.monotonic()
        trials = [Trial(root, mutant, choose(tree, mutant, budget), tree.measured) for mutant in waiting]
        for count, (number, row) in enumerate(each_result(judge, trials, jobs), 1):
            row |= {"all": everything, "test": prints.get(_file_of(row["by"]), "")}
            mutant = waiting[number].id
            verdicts[mutant] = row
            kept.add("mutants", keys[mutant], row)
            left = minutes((time.monotonic() - began) / count * (len(waiting) - count))
            print(f"{mutant}: {row['outcome']}; {count} of {len(waiting)}, {left} left", file=sys.stderr, flush=True)
    return verdicts


def choose(tree: Tree, mutant: Mutant, budget: float) -> list[str]:
    """Return the tests that come by a mutant, those that tell most in the least time first.

    Args:
        tree: under test.
        mutant: of one of its modules.
        budget: their computing time at most [s]; 0 for no limit.
    """
    chosen: list[str] = []
    spent = 0.0
    for test in sorted(_coming_by(tree, mutant), key=lambda test: _cost(test, mutant, tree.measured[test])):
        seconds = tree.measured[test]["seconds"]
        if not tree.measured[test]["fails"] and not (chosen and 0.0 < budget < spent + seconds):
            spent += seconds
            chosen.append(test)
    return chosen


def _cost(test: str, mutant: Mutant, measured: Measured) -> tuple[float, str]:
    """Time of a test over a guess how likely it notices: whether it is the test of this file, or of its package."""
    folder = "/".join(["tests", *Path(mutant.path).parts[2:-1], ""])
    likely = 0.1 + (1.0 if _is_own(test, mutant) else 0.3 * test.startswith(folder))
    return max(measured["taken"], 0.002) / likely, test


def _coming_by(tree: Tree, mutant: Mutant) -> set[str]:
    """Tests that run the mutated line.

    What runs at import only is judged by the tests that run a line with one of its names, and by its own file's; what
    tests start as a program by all that belong to it.
    """
    if tree.modules[mutant.path].is_program and not mutant.at_import:
        return {test for test in tree.measured if test.startswith(_tests_of(mutant.path))}
    if mutant.at_import:
        return {test for test in tree.measured if _is_own(test, mutant)} | _tests_with_names(tree, mutant)
    statement = range(mutant.statement, mutant.line + 1)
    return {
        test
        for test, found in tree.measured.items()
        if not set(statement).isdisjoint(found["lines"].get(mutant.path, ()))
    }


def _tests_with_names(tree: Tree, mutant: Mutant) -> set[str]:
    """Tests that run a line in which a name of the mutant's statement stands, or whose file has it."""
    source = (tree.root / mutant.path).read_text(encoding="utf-8").splitlines()
    names = set(re.findall(r"[A-Za-z_]\w{2,}", source[mutant.statement - 1])[:1]) | set(mutant.scope.split(".")[-1:])
    pattern = re.compile(rf"\b({'|'.join(map(re.escape, names - {''}))})\b")

    def lines_with(path: str) -> set[int]:
        text = (tree.root / path).read_text(encoding="utf-8")
        return {number for number, line in enumerate(text.splitlines(), 1) if pattern.search(line)}

    naming = {file for file in set(map(_file_of, tree.measured)) if lines_with(file)}
    wanted = {path: lines_with(path) for path in tree.modules}
    return {
        test
        for test, found in tree.measured.items()
        if _file_of(test) in naming
        or any(not wanted[path].isdisjoint(numbers) for path, numbers in found["lines"].items())
    }


def _is_own(test: str, mutant: Mutant) -> bool:
    return f"/test_{Path(mutant.path).stem}.py::" in test


def _file_of(test: str) -> str:
    return test.partition("::")[0]


def _fingerprints(root: Path) -> dict[str, str]:
    files = (path for folder in ("src", "tests", "lab") for path in (root / folder).rglob("*.py"))
    return {path.relative_to(root).as_posix(): _fingerprint(path.read_text(encoding="utf-8")) for path in files}


def _fingerprint(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]
