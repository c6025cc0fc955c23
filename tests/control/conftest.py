"""Fixtures of the tests of flight decisions."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NoReturn

import pytest

from mkdaemon.telemetry import sentences


def _missing(words: object, key: str) -> NoReturn:
    pytest.fail(f"a refusal is made without its word {key!r}")


@pytest.fixture(scope="package", autouse=True)
def no_refusal_lacks_a_word() -> Iterator[None]:
    """In flight a word that is missing is shown by its name; in a test it is a fault."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sentences.KnownWords, "__missing__", _missing)
        yield
