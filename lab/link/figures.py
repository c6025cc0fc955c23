"""Plots of the link's cases beside the figures of 2010."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any, Final

from cyclopts import Parameter

from mkdaemon.errors import ConfigError

LOSS_2010_PERCENT: Final = {15: 1.18, 50: 2.82}
"""Echo loss by radio in 2010, by control rate [Hz]; over a cable none was lost."""
_DPI: Final = 110


def main(
    results: Annotated[Path, Parameter(help="JSON of `python -m lab link --json`, all cases.")],
    *,
    out: Annotated[Path, Parameter(help="Folder for the PNG files.")] = Path("docs/figures"),
) -> None:
    """Draw `link_*.png` from the JSON a run printed.

    Raises:
        ConfigError: the file cannot be read or holds no cases, or matplotlib is not installed.
    """
    try:
        content: dict[str, Any] = json.loads(results.read_text(encoding="utf-8").splitlines()[-1])
    except (OSError, IndexError, json.JSONDecodeError) as error:
        raise ConfigError(f"results {results}: {error}; give a file written by `python -m lab link --json`") from None
    for path in draw(content, out):
        print(path)


def draw(content: dict[str, Any], out: Path) -> list[Path]:
    """Draw every plot the results allow.

    Args:
        content: figures by case.
        out: folder.

    Raises:
        ConfigError: matplotlib is not installed, or nothing can be drawn.
    """
    cases = [case for case in content.values() if isinstance(case, dict) and "echo_p50_ms" in case]
    if not cases:
        raise ConfigError("the results hold no cases; run `python -m lab link --json` without --case")
    out.mkdir(parents=True, exist_ok=True)
    return [_draw_loss(content, out / "link_loss.png"), _draw_latency(cases, out / "link_latency.png")]


def _draw_loss(content: dict[str, Any], path: Path) -> Path:
    """Loss against the rate of external control: today by cable and radio, 2010 by radio."""
    figure, axes = _axes("Loss beside the full load", "external control [Hz]", "lost [%]")
    for prefix, label, marker in (("full", "by cable", "o"), ("radio", "by radio", "s")):
        rows = [(hz, content[f"{prefix}_{hz}"]) for hz in (15, 30, 50, 100) if f"{prefix}_{hz}" in content]
        for key, word, style in (("exact_echo_loss", "echoes", "-"), ("exact_control_loss", "control frames", "--")):
            if rows:
                values = [100 * (row[key] or 0.0) for _, row in rows]
                axes.plot([hz for hz, _ in rows], values, style, marker=marker, label=f"{word}, {label}")
        if prefix == "radio" and rows:
            axes.plot(
                [hz for hz, _ in rows],
                [100 * row["exact_radio_loss"] for _, row in rows],
                ":k",
                label="the radio's own",
            )
    axes.plot(list(LOSS_2010_PERCENT), list(LOSS_2010_PERCENT.values()), "rx", markersize=9, label="2010, by radio")
    axes.legend(fontsize=8)
    return _save(figure, path)


def _draw_latency(cases: list[dict[str, Any]], path: Path) -> Path:
    """Echo round trip, and what of it the host adds."""
    figure, axes = _axes("Round trip of a link test", "", "[ms]")
    places = range(len(cases))
    axes.bar([place - 0.2 for place in places], [case["echo_p99_ms"] or 0 for case in cases], 0.38, label="99 %")
    axes.bar([place - 0.2 for place in places], [case["echo_p50_ms"] or 0 for case in cases], 0.38, label="median")
    axes.bar(
        [place + 0.2 for place in places], [case["overhead_p50_ms"] or 0 for case in cases], 0.38, label="host, median"
    )
    axes.set_xticks(list(places), [case["case"] for case in cases], rotation=60, fontsize=8)
    axes.legend(fontsize=8)
    return _save(figure, path)


def _axes(title: str, x: str, y: str) -> tuple[Any, Any]:
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise ConfigError("plots need matplotlib: pip install 'mkdaemon[figures]'") from error
    figure = Figure(figsize=(7.0, 4.4), layout="constrained")
    axes = figure.add_subplot()
    axes.set_title(title)
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.grid(visible=True, alpha=0.3)
    return figure, axes


def _save(figure: Any, path: Path) -> Path:
    figure.savefig(path, dpi=_DPI)
    return path
