"""One place for thresholds: no other file of the eyes compares with a number of its own."""

from __future__ import annotations

import ast
from dataclasses import fields, is_dataclass
from pathlib import Path

import mkdaemon.vision
from mkdaemon.vision.limits import LIMITS

ROOT = Path(mkdaemon.vision.__file__).parent
STRUCTURAL = range(5)
"""Signs, emptiness, dimensions, channels, corners; everything else is a threshold or deserves a name."""


def literals(source: Path) -> list[str]:
    """Comparisons with a numeric literal, named constants excepted."""
    found = []
    for node in ast.walk(ast.parse(source.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.Compare):
            continue
        for part in ast.walk(node):
            if not isinstance(part, ast.Constant) or type(part.value) not in (int, float):
                continue
            if part.value not in (STRUCTURAL if isinstance(part.value, int) else range(3)):
                found.append(f"{source.name}:{node.lineno}: {ast.unparse(node)}")
                break
    return found


def test_no_file_compares_with_a_number_of_its_own():
    assert [(source, found) for source in sorted(ROOT.rglob("*.py")) if (found := literals(source))] == []


def test_every_limit_says_unit_meaning_and_source():
    for group in fields(LIMITS):
        limits = getattr(LIMITS, group.name)
        assert is_dataclass(limits)
        for limit in fields(limits):
            assert set(limit.metadata) == {"unit", "meaning", "source"}, limit.name
            assert limit.metadata["meaning"], limit.name
            assert limit.metadata["source"], limit.name


def test_one_quantity_has_one_place():
    """Cell sizes, shares of agreement, likenesses and widths of edges each rise from one use to the next."""
    cells = LIMITS.cells
    assert cells.readable_px < cells.photometric_px < cells.small_px < cells.perspective_px
    assert 0.0 < LIMITS.agreement.blind < LIMITS.agreement.whole
    assert LIMITS.likeness.alike < LIMITS.likeness.clear < LIMITS.likeness.explained
    assert LIMITS.blur.sharp_px < LIMITS.blur.smeared_px < LIMITS.blur.alarm_px
