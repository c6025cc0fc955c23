"""The one table of refusals: complete, used, and the only place with words."""

from __future__ import annotations

import ast
import re
import string
from functools import cache

from mkdaemon.telemetry.control import Obstacle
from mkdaemon.telemetry.refusals import TOKENS, Token, refuse
from mkdaemon.telemetry.status import Status
from tests.places import ROOT

SOURCES = sorted((ROOT / "src").rglob("*.py"))
CALLED = r"\b(refuse|CommandRejectedError)\("


def words_of(token: Token) -> set[str]:
    """Words that a refusal fills in."""
    text = token.reason + token.fix
    return {name for _, name, _, _ in string.Formatter().parse(text) if name}


@cache
def all_calls():
    """Every call of a function in the sources that make refusals, with its file."""
    texts = ((source, source.read_text(encoding="utf-8")) for source in SOURCES)
    trees = ((source, ast.parse(text)) for source, text in texts if re.search(CALLED, text))
    nodes = ((source, node) for source, tree in trees for node in ast.walk(tree))
    return [(source, node) for source, node in nodes if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)]


def calls(name: str):
    """Every call of a function of this name in the sources, with its file."""
    return [(source, node) for source, node in all_calls() if node.func.id == name]


def test_every_refusal_says_why_and_what_to_do():
    for token in Token:
        error = refuse(token, **dict.fromkeys(words_of(token), 1))
        assert error.token == token
        assert "{" not in error.reason + error.fix
        assert error.reason.endswith(".")
        assert error.fix.strip().endswith((".", "1"))
        assert token.status not in {Status.ACCEPTED, Status.NOT_OBSERVABLE}


def test_every_token_is_raised_somewhere_and_none_is_built_by_hand():
    raised = set()
    for source, call in calls("refuse"):
        token = call.args[0]
        if isinstance(token, ast.Subscript):  # TOKENS[line.obstacle.value]
            raised |= {TOKENS[obstacle.value] for obstacle in Obstacle}
            continue
        assert isinstance(token, ast.Attribute), f"{source.name}:{call.lineno}"
        raised.add(Token[token.attr])
        if all(keyword.arg for keyword in call.keywords):
            given = {keyword.arg for keyword in call.keywords}
            assert words_of(Token[token.attr]) == given, f"{source.name}:{call.lineno}"
    assert set(Token) - raised == set()


def test_no_other_place_has_words_of_its_own():
    built = {source.relative_to(ROOT / "src" / "mkdaemon").as_posix() for source, _ in calls("CommandRejectedError")}
    # A client gives back the words that the daemon sent it, a replay those that were recorded, and admission those of a
    # loop that was judged before.
    given_back = {"client/answers.py", "record/events.py", "control/admission/flightrows.py"}
    assert built == {"telemetry/refusals.py"} | given_back
