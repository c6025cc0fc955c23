"""`python -m lab figures`: the picture of docs/figures that is rendered."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

from cyclopts import Parameter

from lab.places import CONFIGS
from mkdaemon.vision.tags import targetfile
from mksim.scene.sheet import contact_sheet

SHEET: Final = "scene_conditions.png"


def main(*, out: Annotated[Path, Parameter(help="Folder for the file.")] = Path("docs/figures")) -> None:
    """Render the scene in 25 conditions. Half a minute."""
    contact_sheet(targetfile.load([CONFIGS / "targets" / "nested.toml"]).targets[0], out / SHEET)
    print(out / SHEET)
