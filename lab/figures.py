"""Every picture of docs/figures, drawn again from the results kept in docs/results.

A result is what a benchmark printed: `python -m lab link --json > docs/results/link.json`. Pictures that need no
measurement, like the scene in 25 conditions, are rendered.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Final, NamedTuple

from cyclopts import Parameter

from lab.link import figures as link_figures
from lab.vision import figures as vision_figures
from lab.vision.camerascreen import camera_screen
from mkdaemon.errors import ConfigError, MkError
from mkdaemon.vision.tags import tagmap
from mksim.scene.sheet import contact_sheet


class Plot(NamedTuple):
    """Pictures made from one benchmark's results.

    Attributes:
        benchmark: its name after `python -m lab`; the results are in `<name>.json`.
        draw: from the results and a folder to the files drawn.
    """

    benchmark: str
    draw: Callable[[dict[str, Any], Path], list[Path]]


PLOTS: Final = (Plot("link", link_figures.draw), Plot("vision", vision_figures.draw))


def main(
    *,
    results: Annotated[Path, Parameter(help="Folder of results, one JSON object a benchmark.")] = Path("docs/results"),
    out: Annotated[Path, Parameter(help="Folder for the PNG files.")] = Path("docs/figures"),
    target: Annotated[Path, Parameter(help="Target shown in the scene's contact sheet.")] = Path(
        "configs/targets/nested.toml"
    ),
) -> None:
    """Draw every picture of the documentation.

    It reads the results that the campaigns left in docs/results, and renders one sheet of the scene. Half a minute.

    Raises:
        ConfigError: a result or the target cannot be read, or matplotlib is not installed.
        MkError: results are missing; the others were drawn.
    """
    missing, known = [], []
    for plot in PLOTS:
        source = results / f"{plot.benchmark}.json"
        if source.is_file():
            known.append((plot, _read(source)))
        else:
            missing.append(f"python -m lab {plot.benchmark} --json > {source}")
    out.mkdir(parents=True, exist_ok=True)
    for plot, content in known:
        for path in plot.draw(content, out):
            print(path)
    shown = tagmap.load([target]).targets[0]
    for path, render in ((out / "scene_conditions.png", contact_sheet), (out / "camera_screen.svg", camera_screen)):
        render(shown, path)
        print(path)
    if missing:
        msg = f"no results to draw from yet; measure first: {'; '.join(missing)}"
        raise MkError(msg)


def _read(source: Path) -> dict[str, Any]:
    try:
        content = json.loads(source.read_text(encoding="utf-8").splitlines()[-1])
    except (OSError, IndexError, json.JSONDecodeError) as error:
        raise ConfigError(f"results {source}: {error}; write them again with `python -m lab {source.stem}`") from None
    if not isinstance(content, dict):
        raise ConfigError(f"results {source}: no JSON object on the last line")
    return content
