"""What a stranger's value says: numbers and texts, or nothing."""

from __future__ import annotations

import pytest

from mkdaemon.view.report.said import LONGEST, number_of, numbers_of, short, text_of

FIELDS = {
    "a": 1.5, "b": {"c": [1, 2.5, -3]}, "nan": float("nan"), "inf": float("inf"), "huge": 1e300, "big": 10**400,
    "yes": True, "word": "w", "bytes": b"\x00", "none": None, "long": "x" * 999,
}  # fmt: skip


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ("a", 1.5), ("b.c.1", 2.5), ("b.c.3", None), ("b.c.x", None), ("b.c.-1", None), ("b", None), ("a.b", None),
        ("nan", None), ("inf", None), ("huge", None), ("big", None), ("yes", None), ("word", None), ("none", None),
        ("", None), ("word.0", None),
    ],
)  # fmt: skip
def test_only_finite_numbers_of_a_likely_size_are_numbers(path, expected):
    assert number_of(FIELDS, path) == expected
    assert number_of(None, path) is None


@pytest.mark.parametrize(("count", "expected"), [(3, [1.0, 2.5, -3.0]), (2, [1.0, 2.5]), (4, [])])
def test_lists_have_as_many_numbers_as_are_asked_for(count, expected):
    assert numbers_of(FIELDS, "b.c", count) == expected


def test_texts_are_short():
    assert text_of(FIELDS, "word") == "w"
    assert text_of(FIELDS, "none") == text_of(FIELDS, "nothing") == ""
    assert text_of(FIELDS, "long") == "x" * LONGEST + " ..."
    assert text_of(FIELDS, "bytes") == r"b'\x00'"
    assert len(short({"many": list(range(9999))})) <= LONGEST + 5
