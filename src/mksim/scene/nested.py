"""The nested target that simulator and rehearsal use where no target file is given: configs/targets/nested.toml."""

from __future__ import annotations

from typing import Final

from mkdaemon.config.vision import TagPlacement, TargetSection
from mkdaemon.vision.tags.tagmap import TagMap, build

NESTED: Final = TargetSection(name="pad", tags=(TagPlacement(id=48, size=0.3048), TagPlacement(id=1, size=0.048)))
"""A 12 inch tag with four black cells in its middle, and a tag of 48 mm there; why: docs/lab/vision-cases.md."""


def nested_map() -> TagMap:
    """Make a map of this target alone."""
    return build([NESTED], origin="built-in target")
