from __future__ import annotations

import string

import pytest

from mkdaemon.protocol.procedures.failures import FAILURES, fail
from tests.places import DOCS


@pytest.mark.parametrize("token", FAILURES)
def test_every_failure_is_two_sentences_and_documented(token: str) -> None:
    failure = FAILURES[token]
    words = {name for part in failure for _, name, _, _ in string.Formatter().parse(part) if name}
    error = fail(token, **dict.fromkeys(words, 7))
    assert (error.token, error.reason[-1], error.fix[-1]) == (token, ".", ".")
    pages = "".join((DOCS / page).read_text(encoding="utf-8") for page in ("settings.md", "waypoints.md"))
    assert f"`{token}`" in pages


def test_a_word_that_is_missing_is_our_mistake() -> None:
    with pytest.raises(KeyError):
        fail("too_many_points", count=3)
