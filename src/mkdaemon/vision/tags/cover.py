"""What smaller tags of a target cover of its larger ones."""

from __future__ import annotations

import numpy as np

from mkdaemon.vision.arrays import Array, Bools
from mkdaemon.vision.tags.tagmap import Tag, TagMap

COVER_CELLS = 0.3
"""How far beyond its paper a tag hides what lies below [cells]: its rim casts a shadow and blurs."""


def covered(points: Array, tag: Tag) -> Bools:
    """Which points `(n, 3)` [m; target] lie under the paper of a tag in the same plane."""
    local = (points - tag.position) @ tag.rotation
    half = tag.paper / 2 + COVER_CELLS * tag.module
    under: Bools = (np.abs(local[:, 2]) < tag.module) & (np.abs(local[:, :2]).max(axis=1) <= half)
    return under


def covered_cells(tagmap: TagMap) -> dict[tuple[str, int], Bools]:
    """Cells `(n, n)` of each tag, by family and id, that lie under the paper of a later one of its target.

    An inner tag is mostly white: where a tone curve or a highlight spreads white, black cells below it read as white.
    """
    return {
        (tag.family.name, tag.tag_id): _under(tag, target.tags[k + 1 :])
        for target in tagmap.targets
        for k, tag in enumerate(target.tags)
    }


def _under(tag: Tag, later: tuple[Tag, ...]) -> Bools:
    """Cells `(n, n)` of a tag whose middles lie under the paper of others."""
    n = len(tag.bitmap)
    row, column = (index.ravel() for index in np.indices((n, n)))
    middles = tag.place(np.column_stack([column - n / 2 + 0.5, n / 2 - 0.5 - row]) * tag.module)
    under = np.zeros(n * n, dtype=np.bool_)
    for other in later:
        under |= covered(middles, other)
    return under.reshape(n, n)
