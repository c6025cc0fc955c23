"""Values that a stranger may put: whole by their schema, with numbers and words that no aircraft has."""

from __future__ import annotations

import random
from contextlib import suppress

from pydantic import ValidationError

from tests import samples
from tools.top_picture import KNOWN

ODD = (
    *(0.0, -0.0, 1e308, -1e308, 1e-320, 1e18, -1, 2**31, 2**63, 2**64, -(2**63), None, True),
    *("", "x" * 3000, "\n\x1b[31mü{}", b"", b"\xff\xd8\xff", [], [0.0] * 4, {}),
)
"""What takes the place of a part of a value."""


def known():
    """A value of each key."""
    return dict(samples.hovering(1.0)) | dict(samples.EVERY) | KNOWN


def strange(count, seed=1):
    """Odd values of any key, each with its key.

    Args:
        count: how many.
        seed: of the draws.
    """
    draw, values = random.Random(seed), sorted(known().items())
    while count:
        key, value = draw.choice(values)
        fields = value.model_dump()
        for _ in range(draw.choice((1, 1, 2, 3))):
            fields = _with(fields, draw)
        with suppress(ValidationError):
            yield key, type(value).model_validate(fields)
            count -= 1


def _with(part, draw):
    """A value with one part of it replaced."""
    if isinstance(part, dict) and part:
        name = draw.choice(sorted(part, key=str))
        return part | {name: _with(part[name], draw)}
    if isinstance(part, list | tuple) and part and draw.random() < 0.8:
        place = draw.randrange(len(part))
        return [*part[:place], _with(part[place], draw), *part[place + 1 :]]
    return draw.choice(ODD)
