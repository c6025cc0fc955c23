"""Closed sets have one table: no code lists their members by hand, and every table that is looked up knows all of them.

The question that was not asked when a phase was added: who else reads this set? `mkctl view` died with a KeyError at
the phase in which the aircraft ignores its sticks, and two lists of "phases in flight" did not have it.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import mkdaemon
from mkdaemon.control.manoeuvres.manoeuvre import ended
from mkdaemon.control.modes import ROWS, Trigger
from mkdaemon.telemetry.control import Outcome, Phase
from mkdaemon.telemetry.link import LinkCondition
from mkdaemon.telemetry.tone import Tone
from mkdaemon.telemetry.vision import Alarm, EyeState
from mkdaemon.vision.pipeline import MAYBE_POSED, NEVER_POSED

ROOT = Path(mkdaemon.__file__).parent
CLOSED = {kind.__name__: kind for kind in (Phase, LinkCondition, EyeState, Outcome, Alarm, Tone)}
PARTIAL = {
    "figures": "the words that an alarm adds to its advice; it is asked with a default",
    "_PATIENCE": "the conditions of an unusable line; the others end no lease, however long they last",
    "ALARM_ADVICE": "what is found in images; the self-check and the attitude say what they found in their own words",
}
"""Tables that leave members out, and why none of them is missed."""


def members(keys: list[ast.expr | None]) -> tuple[str, set[str]] | None:
    """Set and members that keys name; None where they are something else, or fewer than two."""
    found = [key for key in keys if isinstance(key, ast.Attribute) and isinstance(key.value, ast.Name)]
    names = {key.value.id for key in found if isinstance(key.value, ast.Name)}
    if len(found) < 2 or len(found) != len(keys) or len(names) != 1 or not names <= set(CLOSED):
        return None
    return names.pop(), {key.attr for key in found}


def tables(tree: ast.AST) -> Iterator[tuple[str, str, set[str]]]:
    """Every dictionary by members of a closed set that is looked up by `[]`: its name, the set, the members."""
    looked_up = [node.value for node in ast.walk(tree) if isinstance(node, ast.Subscript)]
    subscripted = {id(table) for table in looked_up} | {
        name for table in looked_up for name in (getattr(table, "id", None), getattr(table, "attr", None)) if name
    }
    named = {
        id(node.value): target.id
        for node in ast.walk(tree)
        if isinstance(node, (ast.Assign, ast.AnnAssign))
        for target in (node.targets if isinstance(node, ast.Assign) else [node.target])
        if isinstance(target, ast.Name)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Dict) and (found := members(node.keys)) is not None:
            name = named.get(id(node), "a table without a name")
            if subscripted & {id(node), name}:
                yield name, *found


@pytest.fixture(scope="module")
def sources() -> list[tuple[Path, ast.Module]]:
    """Files that name a member of a closed set."""
    texts = [(path, path.read_text(encoding="utf-8")) for path in sorted(ROOT.rglob("*.py"))]
    return [(path, ast.parse(text)) for path, text in texts if any(f"{name}." in text for name in CLOSED)]


def test_every_table_by_a_closed_set_has_all_its_members(sources):
    missing, found = [], 0
    for path, tree in sources:
        for name, kind, known in tables(tree):
            found += 1
            left_out = {member.name for member in CLOSED[kind]} - known
            if left_out and name not in PARTIAL:
                missing.append(f"{path.relative_to(ROOT)}: {name} knows nothing of {sorted(left_out)}")
    assert found >= 6
    assert not missing


def test_no_code_lists_phases_by_hand(sources):
    lists = [
        f"{path.relative_to(ROOT)}:{node.lineno}"
        for path, tree in sources
        for node in ast.walk(tree)
        if isinstance(node, (ast.Set, ast.Tuple, ast.List))
        if (found := members(list(node.elts))) is not None and found[0] == "Phase"
    ]
    assert not lists


def test_an_abort_can_be_asked_for_in_exactly_the_phases_that_say_so():
    sources = {phase for row in ROWS if row.event is Trigger.ABORT_REQUESTED for phase in row.sources}
    assert sources == {phase for phase in Phase if phase.may_be_aborted}
    assert all(phase.is_in_flight for phase in sources)


def test_every_alarm_that_prevents_poses_is_a_state_of_the_eyes():
    assert {alarm.value for alarm in (*NEVER_POSED, *MAYBE_POSED)} <= {state.value for state in EyeState}


@pytest.mark.parametrize("outcome", Outcome)
def test_every_outcome_is_one_sentence(outcome):
    assert ended(outcome, target="pad", age=1.0).words
