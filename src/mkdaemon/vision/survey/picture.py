"""The picture of a map: its tags from above, how well each is known, and where the camera was."""

from __future__ import annotations

from typing import Final
from xml.sax.saxutils import escape

import numpy as np

from mkdaemon.vision.survey.survey import Survey

WIDE: Final = 900.0
"""Of the map [px]; its margin is a tenth."""
GOOD, POOR = 0.002, 0.01
"""Deviations of a place up to which it is drawn green, and from which red [m]."""


def picture_of(result: Survey) -> str:
    """Draw a map as SVG: y of the map up, tags to scale, cameras as dots, what was left out and what is weak below."""
    corners = np.concatenate([one.tag.corners[:, :2] for one in result.tags])
    low, high = corners.min(axis=0), corners.max(axis=0)
    margin = 0.1 * float((high - low).max())
    low, high = low - margin, high + margin
    scale = WIDE / float(high[0] - low[0])
    tall = scale * float(high[1] - low[1])

    def at(point: np.ndarray) -> str:
        return f"{scale * (point[0] - low[0]):.1f},{tall - scale * (point[1] - low[1]):.1f}"

    parts = []
    inside = ((result.centres[:, :2] > low) & (result.centres[:, :2] < high)).all(axis=1)
    for centre in result.centres[inside]:
        x, y = at(centre).split(",")
        parts.append(f'<circle cx="{x}" cy="{y}" r="1.5" fill="#9ab"/>')
    for one in result.tags:
        sd = float(np.linalg.norm(one.place_sd))
        colour = "#2a7" if sd <= GOOD else "#d90" if sd < POOR else "#c33"
        points = " ".join(at(corner) for corner in one.tag.corners)
        x, y = at(one.tag.position).split(",")
        title = f"tag {one.tag.tag_id}: {1000 * sd:.1f} mm, {one.rms_px:.2f} px, {one.images} images"
        parts.append(
            f'<g><title>{escape(title)}</title><polygon points="{points}" fill="{colour}" fill-opacity="0.35"'
            f' stroke="{colour}"/><text x="{x}" y="{y}" text-anchor="middle" dominant-baseline="middle">'
            f"{one.tag.tag_id}</text></g>"
        )
    words = [f"{len(result.tags)} tags by {result.images} images; corners fit to {result.rms_px:.2f} px"]
    words += [f"left out: tag {one.tag_id}, {one.words}" for one in result.left_out]
    words += [f"weak: tag {code}, {text}" for code, text in result.weak]
    step = 10.0 ** np.floor(np.log10(float(high[0] - low[0]) / 3.0))
    bottom = tall + 20.0
    parts.append(f'<path d="M10 {bottom:.0f} h{step * scale:.1f}" stroke="#000" stroke-width="2"/>')
    parts.append(f'<text x="10" y="{bottom + 16:.0f}">{step:g} m</text>')
    parts += [f'<text x="10" y="{bottom + 36 + 18 * k:.0f}">{escape(line)}</text>' for k, line in enumerate(words)]
    height = bottom + 36 + 18 * len(words)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDE:.0f} {height:.0f}" font-family="sans-serif"'
        f' font-size="13"><rect width="100%" height="100%" fill="#fff"/>{"".join(parts)}</svg>\n'
    )
