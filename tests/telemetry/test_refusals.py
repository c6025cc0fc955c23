"""The one table of refusals."""

from __future__ import annotations

import re

import pytest

from mkdaemon.telemetry.refusals import REFUSALS, Status, Token, refuse


@pytest.mark.parametrize("token", sorted(REFUSALS))
def test_every_refusal_says_why_and_what_to_do(token):
    words = set(re.findall(r"{(\w+)", REFUSALS[token].reason + REFUSALS[token].fix))
    numbers = {"left": 1.0}
    error = refuse(token, **{word: numbers.get(word, f"<{word}>") for word in words})
    assert error.token == token
    assert all(f"<{word}>" in error.reason + error.fix for word in words - set(numbers))
    assert error.reason.endswith(".")
    assert error.fix.strip().endswith((".", ">"))
    assert REFUSALS[token].status not in {Status.ACCEPTED, Status.NOT_OBSERVABLE}


def test_every_token_is_in_the_table():
    assert set(REFUSALS) == set(Token)


def test_a_refusal_never_fails_for_a_missing_word():
    assert "(detail)" in refuse(Token.BUSY).reason
