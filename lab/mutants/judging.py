"""Judges mutants: each by one pytest, before which stands a copy of `src` that has the mutant in it.

The copy is links to the tree, one file apart. So everything runs the mutant: what is computed at import, every name
that was bound to it, and programs that the tests start.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, NamedTuple

from lab.campaign import Row
from lab.mutants.operators import Module, Mutant
from lab.mutants.plugin import PLAN, Measured, Plan
from lab.places import ROOT
from mkdaemon.errors import MkError

WAITING_LIMIT: Final = 20.0
"""Time that a test with a mutant may take [s], and `WAITING_FACTOR` times that of the slowest."""
WAITING_FACTOR: Final = 5.0
COLLECTING_LIMIT: Final = 300.0
"""Time of importing and collecting with a mutant [s]."""
PATIENT: Final = 4.0
"""A mutant is tried again, with this many times its limits, before it counts as killed by time or by a test that
waits."""
WAITS: Final = 0.1
"""A test that takes so much longer than it computes waits for something, and a loaded machine can make it fail [s]."""
OPTIONS: Final = (
    *("-q", "-p", "no:cacheprovider", "-p", "lab.mutants.plugin", "-o", "timeout_method=thread"),
    *("-W", "ignore::pytest.PytestAssertRewriteWarning", "-m", "not flight and not real_time"),
)
"""Of pytest. What runs in real time says nothing on a loaded machine."""
_RIGHT, _FAILED, _NONE_COLLECTED = 0, 1, 5
"""Exit codes of pytest."""


class Trial(NamedTuple):
    """A mutant, and the tests that judge it.

    Attributes:
        root: of the tree.
        mutant: one of its modules'.
        tests: in their order.
        measured: all tests.
    """

    root: Path
    mutant: Mutant
    tests: Sequence[str]
    measured: Mapping[str, Measured]


def measure(root: Path, files: Sequence[str], tests: Sequence[str], log: Path) -> dict[str, Measured]:
    """Run tests without a mutant.

    Args:
        root: of the tree.
        files: whose lines are noted, from the root.
        tests: files and folders, from the root.
        log: takes what pytest prints.

    Raises:
        MkError: the tests cannot be collected.
    """
    ended, printed, found = _pytest(root, root / "src", Plan(files={str(root / file): file for file in files}), tests)
    log.parent.mkdir(parents=True, exist_ok=True)
    log.write_text(printed, encoding="utf-8")
    if ended not in (_RIGHT, _FAILED):
        raise MkError(f"the tests could not be run; {log} says why")
    measured: dict[str, Measured] = found["measured"]
    return measured


def judge(trial: Trial) -> Row:
    """Run the tests of a mutant until one fails; `outcome` is `killed`, `timeout` or `survived`."""
    row: Row = {"outcome": "survived", "by": "", "seconds": 0.0}
    if trial.tests:
        row = _tried(trial, 1.0)
        waits = trial.measured.get(row["by"])
        if row["outcome"] == "timeout" or (waits is not None and waits["taken"] - waits["seconds"] >= WAITS):
            row = _tried(trial, PATIENT)
    return row


def _tried(trial: Trial, patience: float) -> Row:
    path, tests = trial.mutant.path, trial.tests
    limit = patience * (WAITING_LIMIT + WAITING_FACTOR * max(trial.measured[test]["taken"] for test in tests))
    files = dict.fromkeys(test.partition("::")[0] for test in tests)
    with tempfile.TemporaryDirectory(prefix="mutant-") as folder:
        source = Path(folder) / "src"
        shutil.copytree(trial.root / "src", source, copy_function=os.symlink)
        changed = Path(folder) / path
        changed.unlink()
        changed.write_text(Module.read(trial.root, path).with_mutant(trial.mutant.id), encoding="utf-8")
        before = _of_children()
        whole = patience * (COLLECTING_LIMIT + sum(trial.measured[test]["taken"] for test in tests)) + limit
        plan = Plan(tests=list(tests), known=list(trial.measured))
        ended, _, found = _pytest(trial.root, source, plan, ("-x", "-o", f"timeout={limit:g}", *files), whole)
        seconds = round(_of_children() - before, 1)
    if ended in (_RIGHT, _NONE_COLLECTED):
        return {"outcome": "survived", "by": "", "seconds": seconds}
    if ended == -signal.SIGKILL or (ended == _FAILED and "killer" not in found):  # pytest-timeout ends the process
        return {"outcome": "timeout", "by": "", "seconds": seconds}
    return {"outcome": "killed", "by": found.get("killer", ""), "seconds": seconds}


def _pytest(
    root: Path, source: Path, plan: Plan, words: Sequence[str], limit: float | None = None
) -> tuple[int, str, dict[str, Any]]:
    """Exit code of a pytest with its sources in a folder, what it prints, and what its plugin found."""
    with tempfile.TemporaryDirectory(prefix="tests-") as folder:
        file = Path(folder) / "plan.json"
        file.write_text(json.dumps(plan), encoding="utf-8")
        path = os.pathsep.join(map(str, (source, root, ROOT)))
        names = {PLAN: str(file), "PYTHONPATH": path, "TMPDIR": folder, "PYTEST_DEBUG_TEMPROOT": folder}
        printed = Path(folder) / "printed"
        with printed.open("wb") as output:
            process = subprocess.Popen(
                [sys.executable, "-m", "pytest", *OPTIONS, *words],
                cwd=root,
                env={name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"} | names,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
            try:
                with suppress(subprocess.TimeoutExpired):
                    process.wait(limit)
            finally:
                with suppress(ProcessLookupError):  # also what its tests have started
                    os.killpg(process.pid, signal.SIGKILL)
                process.wait()
        return process.returncode, printed.read_text(errors="replace"), json.loads(file.read_text(encoding="utf-8"))


def _of_children() -> float:
    """Computing time of all processes that this one has started and that have ended [s]."""
    times = os.times()
    return times.children_user + times.children_system
