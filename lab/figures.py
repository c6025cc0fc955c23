"""`python -m lab figures`: the pictures of docs/figures that are rendered."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

from cyclopts import Parameter

from lab.places import CONFIGS
from lab.vision.camerascreen import camera_screen
from mkdaemon.vision.tags import tagmap
from mksim.scene.sheet import contact_sheet

PICTURES: Final = {"scene_conditions.png": contact_sheet, "camera_screen.svg": camera_screen}
"""By file: what renders it of a target."""


def main(*, out: Annotated[Path, Parameter(help="Folder for the files.")] = Path("docs/figures")) -> None:
    """Render the scene in 25 conditions, and what `mkctl camera` shows of a view. Half a minute."""
    shown = tagmap.load([CONFIGS / "targets" / "nested.toml"]).targets[0]
    for name, render in PICTURES.items():
        render(shown, out / name)
        print(out / name)
