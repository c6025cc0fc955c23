"""A flight of the demonstration: what truly happened over the target, its figures, and its picture (SVG)."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from mkdaemon.files import save

Array = npt.NDArray[np.float64]

SETTLING: Final = 2.0
"""Figures of a hold are taken after this [s]."""


@dataclass(frozen=True, slots=True)
class Moment:
    """The aircraft at one moment.

    Attributes:
        at: [s].
        position: true, from the middle of the target (3,) [m].
        target: true, of the target (3,) [m; ENU].
        goal: wanted position, from the middle of the target; None without one.
        estimate: estimated position; None while it is not used.
        part: of the flight.
    """

    at: float
    position: tuple[float, float, float]
    target: tuple[float, float, float]
    goal: tuple[float, float, float] | None
    estimate: tuple[float, float, float] | None
    part: str


@dataclass(slots=True)
class Rehearsed:
    """A whole flight.

    Attributes:
        moments: twenty a second.
        parts: begin of each part of the flight [s].
        outcome: why the flight ended.
        motors_stand: whether the motors stood still at the end.
        crashed: why the aircraft broke; empty while it is whole.
        images: looked at.
        posed: of those, with a pose.
    """

    moments: list[Moment] = field(default_factory=list)
    parts: dict[str, float] = field(default_factory=dict)
    outcome: str = ""
    motors_stand: bool = False
    crashed: str = ""
    images: int = 0
    posed: int = 0

    @property
    def landing(self) -> Moment | None:
        """The aircraft at the release after the landing; None if it never started to land."""
        return next((moment for moment in reversed(self.moments) if moment.part == "land"), None)

    @property
    def touch_error(self) -> float:
        """Horizontal distance from the middle of the target then [m]: what the pilot does afterwards is his."""
        return math.hypot(*self.landing.position[:2]) if self.landing is not None else math.nan

    @property
    def has_landed(self) -> bool:
        """Whether it stands on the target, whole, and its motors stand still."""
        landing = self.landing
        on_pad = landing is not None and self.touch_error < 0.3 and landing.position[2] < 0.2
        return on_pad and self.outcome.startswith("landed on") and self.motors_stand and not self.crashed

    def errors(self, part: str) -> Array:
        """True position less goal in a part, after it settled (n, 3) [m]."""
        began = self.parts.get(part, math.inf) + SETTLING
        found = [
            np.subtract(moment.position, moment.goal)
            for moment in self.moments
            if moment.part == part and moment.goal is not None and moment.at >= began
        ]
        return np.array(found).reshape(-1, 3)

    def figures(self) -> Mapping[str, Any]:
        """The errors, in centimetres, and how it ended."""
        found: dict[str, Any] = {"landed": self.has_landed, "outcome": self.outcome or "not landed"}
        if self.crashed:
            found["crashed"] = self.crashed
        for part in ("hold", "follow"):
            errors = self.errors(part)
            if len(errors):
                level = np.hypot(errors[:, 0], errors[:, 1])
                found[f"{part}_rms_cm"] = _cm(math.sqrt(float((level**2).mean())))
                found[f"{part}_max_cm"] = _cm(float(level.max()))
                found[f"{part}_height_rms_cm"] = _cm(math.sqrt(float((errors[:, 2] ** 2).mean())))
        found |= self._step()
        found["touch_cm"] = None if self.landing is None else _cm(self.touch_error)
        found["motors_stand"] = self.motors_stand
        found["seconds"] = round(self.moments[-1].at, 1) if self.moments else 0.0
        found["images"], found["posed"] = self.images, self.posed
        return found

    def _step(self) -> dict[str, float]:
        """Time to nine tenths and overshoot of the step of 1 m."""
        began = self.parts.get("step")
        if began is None:
            return {}
        way = [(m.at - began, m.position[0] + 0.5) for m in self.moments if m.part == "step"]
        reached = next((at for at, east in way if east >= 0.9), math.nan)
        return {
            "step_t90_s": round(reached, 2),
            "step_overshoot_percent": round(100 * max(0.0, max((east for _, east in way), default=0.0) - 1.0), 1),
        }


def _cm(metres: float) -> float:
    return round(100.0 * metres, 1)


WIDTH: Final = 900
HEIGHT: Final = 760
_STYLE: Final = (
    "text{font:13px sans-serif;fill:#222}.t{font-weight:bold}.a{stroke:#999;fill:none}.g{stroke:#e4e4e4}"
    ".p{fill:none;stroke:#1f6fb4;stroke-width:1.6}.w{fill:none;stroke:#d9822b;stroke-width:1.4;stroke-dasharray:5 3}"
    ".s{stroke:#bbb;stroke-dasharray:2 3}"
)


def write_picture(record: Rehearsed, path: Path) -> None:
    """Draw a flight into a file.

    Raises:
        ConfigError: the file cannot be written.
    """
    save(path, _svg(record), overwrite=True)


def _svg(record: Rehearsed) -> str:
    flown = [moment for moment in record.moments if moment.part != "start"]
    moments = flown or record.moments
    figures = record.figures()
    touch = "" if figures["touch_cm"] is None else f"; {figures['touch_cm']:g} cm from the middle of the target"
    title = f"{figures['outcome']}{touch}"
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{HEIGHT}"><style>{_STYLE}</style>',
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/><text class="t" x="20" y="26">{title}</text>',
        _from_above(moments),
        _over_time(moments, record, 440.0, "height above the target [m]", lambda m: m.position[2], _wanted_height),
        _over_time(moments, record, 610.0, "horizontal error [cm]", _error, None),
        "</svg>",
    ]
    return "\n".join(parts)


def _from_above(moments: Sequence[Moment]) -> str:
    """The way over the ground, north up, and that of the target."""
    tracks = {
        "p": [(m.position[0] + m.target[0], m.position[1] + m.target[1]) for m in moments],
        "w": [(m.target[0], m.target[1]) for m in moments],
    }
    places = [place for track in tracks.values() for place in track]
    east, north = [place[0] for place in places], [place[1] for place in places]
    left, top, wide, tall = 60.0, 60.0, 800.0, 330.0
    middle = ((min(east) + max(east)) / 2, (min(north) + max(north)) / 2)
    span = max((max(east) - min(east) + 0.8) / wide, (max(north) - min(north) + 0.8) / tall)

    def at(place: tuple[float, float]) -> tuple[float, float]:
        return left + wide / 2 + (place[0] - middle[0]) / span, top + tall / 2 - (place[1] - middle[1]) / span

    grid = "".join(
        f'<line class="g" x1="{x:.1f}" y1="{top}" x2="{x:.1f}" y2="{top + tall}"/>'
        f'<text x="{x + 3:.1f}" y="{top + tall - 4}">{metre} m</text>'
        for metre in range(math.floor(middle[0] - wide * span / 2) + 1, math.ceil(middle[0] + wide * span / 2))
        for x in [at((metre, 0.0))[0]]
    )
    x, y = at(tracks["w"][-1])
    size = 0.3048 / span
    pad = f'<rect x="{x - size / 2:.1f}" y="{y - size / 2:.1f}" width="{size:.1f}" height="{size:.1f}" class="a"/>'
    words = (
        f'<text class="t" x="{left}" y="{top - 10}">from above: aircraft (line), target (dashed), its tag at the end'
        "</text>"
    )
    lines = "".join(_line(kind, [at(place) for place in track]) for kind, track in tracks.items())
    return f'{words}{grid}<rect class="a" x="{left}" y="{top}" width="{wide}" height="{tall}"/>{pad}{lines}'


def _over_time(
    moments: Sequence[Moment],
    record: Rehearsed,
    top: float,
    name: str,
    value: Callable[[Moment], float | None],
    wanted: Callable[[Moment], float | None] | None,
) -> str:
    """One value over time, the parts of the flight marked."""
    left, wide, tall = 60.0, 800.0, 115.0
    first, last = moments[0].at, moments[-1].at
    values = [(m.at, found) for m in moments if (found := value(m)) is not None]
    goals = [] if wanted is None else [(m.at, found) for m in moments if (found := wanted(m)) is not None]
    high = max([v for _, v in values + goals], default=1.0) * 1.08 or 1.0

    def at(point: tuple[float, float]) -> tuple[float, float]:
        return left + wide * (point[0] - first) / max(last - first, 1e-9), top + tall * (1.0 - point[1] / high)

    marks = "".join(
        f'<line class="s" x1="{x:.1f}" y1="{top}" x2="{x:.1f}" y2="{top + tall}"/>'
        f'<text x="{x + 3:.1f}" y="{top + tall + 15}">{part}</text>'
        for part, began in record.parts.items()
        if began >= first
        for x in [at((began, 0.0))[0]]
    )
    return (
        f'<text class="t" x="{left}" y="{top - 8}">{name}</text>{marks}'
        f'<rect class="a" x="{left}" y="{top}" width="{wide}" height="{tall}"/>'
        f'<text x="{left - 42}" y="{top + 12}">{high:.3g}</text><text x="{left - 20}" y="{top + tall}">0</text>'
        + _line("w", [at(point) for point in goals])
        + _line("p", [at(point) for point in values])
    )


def _line(kind: str, points: Sequence[tuple[float, float]]) -> str:
    shown = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    return f'<polyline class="{kind}" points="{shown}"/>' if points else ""


def _error(moment: Moment) -> float | None:
    goal = moment.goal
    return None if goal is None else 100 * math.hypot(moment.position[0] - goal[0], moment.position[1] - goal[1])


def _wanted_height(moment: Moment) -> float | None:
    return None if moment.goal is None else moment.goal[2]
