"""Plots of a finished vision campaign beside the figures of 2010."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from lab.vision import pipeline_figure
from mkdaemon.errors import ConfigError

FOOT = 0.3048
DISTANCES_2010 = (2 * FOOT, 4 * FOOT, 6 * FOOT)
ANGLE_SD_2010_DEG = (0.08, 0.24, 0.49)
"""Standard deviation of the angle at 2, 4 and 6 ft, ARToolKit on the 2010 system."""
Z_MEAN_2010_CM = 2.3
"""Mean range error of 2010 over 2-10 ft."""


def main(
    results: Annotated[Path, Parameter(help="JSON of `python -m lab vision --json`.")],
    *,
    out: Annotated[Path, Parameter(help="Folder for the PNG files.")] = Path("docs/figures"),
) -> None:
    """Draw `vision_*.png` from the JSON a campaign printed.

    Args:
        results: file whose last line is the object.
        out: folder for the pictures.

    Raises:
        ConfigError: the file cannot be read or holds no campaign, or matplotlib is not installed.
    """
    try:
        content: dict[str, Any] = json.loads(results.read_text().splitlines()[-1])
    except (OSError, IndexError, json.JSONDecodeError) as error:
        msg = f"results {results}: {error}; give a file written by `python -m lab vision --json`"
        raise ConfigError(msg) from None
    drawn = draw(content, out)
    if not drawn:
        msg = f"results {results}: none of accuracy, cold, view_angle, stages in it; run `python -m lab vision --json`"
        raise ConfigError(msg)
    print("\n".join(str(path) for path in drawn))


def draw(content: dict[str, Any], out: Path) -> list[Path]:
    """Draw what `content` has figures for; returns the files.

    Raises:
        ConfigError: matplotlib is not installed.
    """
    try:
        import matplotlib
    except ImportError:
        msg = "figures need matplotlib: install mkdaemon[figures]"
        raise ConfigError(msg) from None
    matplotlib.use("Agg")
    out.mkdir(parents=True, exist_ok=True)
    found: list[Path] = []
    for name, plot in (("accuracy", _accuracy), ("cold", _cold), ("view_angle", _view_angle)):
        if name in content:
            path = out / f"vision_{name}.png"
            plot(content[name], path)
            found.append(path)
    if "stages" in content:
        path = out / "vision_pipeline.png"
        pipeline_figure.draw(content["stages"], path)
        found.append(path)
    return found


def _axes(title: str, x: str, y: str) -> tuple[Any, Any]:
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(6.4, 4.0), dpi=110)
    axes.set(title=title, xlabel=x, ylabel=y)
    axes.grid(alpha=0.3)
    return figure, axes


def _save(figure: Any, axes: Any, path: Path) -> None:
    import matplotlib.pyplot as plt

    axes.legend()
    figure.tight_layout()
    figure.savefig(path)
    plt.close(figure)


def _accuracy(content: dict[str, Any], path: Path) -> None:
    rows = [row for row in content["by_distance"] if row["mean_3d_cm"] is not None]
    distance = [row["distance"] for row in rows]
    figure, axes = _axes("0.3048 m tag, VGA, exact calibration", "distance [m]", "error")
    axes.loglog(distance, [row["mean_3d_cm"] for row in rows], "o-", label="mean 3-D error [cm]")
    axes.loglog(distance, [max(row["sd_rpy_deg"]) for row in rows], "s-", label="angle sd, worst axis [deg]")
    axes.loglog(DISTANCES_2010, ANGLE_SD_2010_DEG, "s--", color="grey", label="angle sd 2010 [deg]")
    axes.axhline(Z_MEAN_2010_CM, ls=":", color="grey", label="mean range error 2010, 2-10 ft [cm]")
    axes.loglog(distance, [0.3 * d for d in distance], "k:", lw=0.8, label="0.3 % of the range: calibration [cm]")
    _save(figure, axes, path)


def _cold(content: dict[str, Any], path: Path) -> None:
    figure, axes = _axes("Cold start from one image", "distance [m]", "share posed, with attitude")
    for name, label in (("nested", "nested, VGA"), ("single", "single, VGA"), ("single_720p", "single, 1280x720")):
        rows = content[name]
        axes.semilogx([row["distance"] for row in rows], [row["posed"] for row in rows], "o-", label=label)
    axes.axvspan(0.106, 3.53, color="grey", alpha=0.15, label="range of 2010")
    _save(figure, axes, path)


def _view_angle(content: dict[str, Any], path: Path) -> None:
    figure, axes = _axes("Steep views of a 0.3048 m tag from 2 m", "angle from the normal [deg]", "share posed")
    for place in ("centre", "edge"):
        rows = content[place]
        axes.plot(
            [row["angle_deg"] for row in rows], [row["posed"] for row in rows], "o-", label=f"{place} of the image"
        )
    axes.axvline(73, ls=":", color="grey", label="2010")
    _save(figure, axes, path)
