"""`mkdaemon demo`: a whole flight by itself, take-off to landing on a moving target, in one process.

The aircraft, its boards, the radio and the camera are simulated; control, link and eyes are the daemon's own. Time is
virtual, and paced to the clock on the wall unless `--fast` is given: a slow computer makes it longer, not different.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import structlog
from cyclopts import Parameter
from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

from mkdaemon.cli.arguments import AsJson, Length
from mkdaemon.cli.printing import json_line
from mkdaemon.cli.program import EXIT_FAILURE, EXIT_OK

if TYPE_CHECKING:
    from mkdaemon.telemetry.control import ControlStatus
    from mksim.programs.flightrecord import Moment
    from mksim.programs.rehearsal import ShowOn

REDRAW: Final = 0.25
"""Least flight time between two tables [s]."""
LINE_EVERY: Final = 5.0
"""Least flight time between two lines of output without a terminal [s]."""
PICTURE: Final = Path("mkdaemon-demo.svg")
COLUMNS: Final = 78
SHOWN: Final = {
    "hold_rms_cm": "hold over the target, horizontal RMS (cm)",
    "hold_max_cm": "hold, largest horizontal error (cm)",
    "step_t90_s": "step of 1 m, time to 90 % (s)",
    "step_overshoot_percent": "step of 1 m, overshoot (%)",
    "follow_rms_cm": "over the moving target, horizontal RMS (cm)",
    "touch_cm": "landed, distance from the centre (cm)",
    "seconds": "flight time, including the pilot's (s)",
}
"""Figures of the summary."""


def demo(
    *,
    fast: Annotated[bool, Parameter(negative=(), help="Run in virtual time, as fast as possible.")] = False,
    headless: Annotated[bool, Parameter(negative=(), help="Print lines instead of a live table.")] = False,
    picture: Annotated[
        Path,
        Parameter(help="File of the picture (SVG); recording and report go to the same folder. Replaces files."),
    ] = PICTURE,
    wind: Annotated[Literal["none", "indoor", "light", "moderate"], Parameter(help="Simulated wind.")] = "light",
    seed: Annotated[int, Parameter(help="Random seed.")] = 1,
    fps: Annotated[Length, Parameter(help="Images a second.")] = 15.0,
    room: Annotated[
        bool, Parameter(negative=(), help="Fly through a room: from one pad over 24 tags to another, 6 m away.")
    ] = False,
    view: Annotated[bool, Parameter(negative=(), help="Show the flight in `mkctl view`.")] = False,
    telemetry: Annotated[
        bool, Parameter(negative=(), help="Instead, start simulator and daemon as processes, and print values.")
    ] = False,
    seconds: Annotated[Length, Parameter(help="With --telemetry: duration [s].")] = 30.0,
    as_json: AsJson = False,
) -> int:
    """Fly the simulation: take off, hold over a target, step aside by 1 m, follow the moving target, land on it.

    Needs no hardware, no network and no terminal. Exit code 0 only if it landed on the target and stopped its motors.

    With `--room`: take off, cross a room of surveyed tags to another pad, hold in its middle, land on that pad.

    Example: mkdaemon demo --wind moderate --view

    Raises:
        ConfigError: a number cannot be, or the picture cannot be written.
        MkError: with `--telemetry`: a process did not start, or ended while it flew.
    """
    if telemetry:
        from mksim.programs.telemetrydemo import watch_telemetry

        return watch_telemetry(seconds, as_json=as_json)
    pace = 0.0 if fast else 1.0
    fly = partial(_fly, pace, seed, wind, fps, picture, is_room=room, is_quiet=as_json, is_headless=headless)
    if not view:
        return fly()
    from mksim.programs.shownflight import looked_at

    with looked_at(is_quiet=as_json, is_headless=headless) as show_on:
        return fly(show_on)


def _fly(
    pace: float,
    seed: int,
    wind: str,
    fps: float,
    picture: Path,
    show_on: ShowOn | None = None,
    *,
    is_room: bool,
    is_quiet: bool,
    is_headless: bool,
) -> int:
    import mksim.scene  # noqa: F401 - before vision: if OpenCV is missing it names the extra to install
    from mkdaemon.virtualtime import run_virtually
    from mksim.programs.flightrecord import write_picture
    from mksim.programs.rehearsal import rehearse

    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(logging.CRITICAL))
    console = Console(quiet=is_quiet)
    where = "in a room of tags, 6 m from the pad to land on" if is_room else "on its target"
    console.print(f"a simulated aircraft {where}; {wind} wind, {fps:g} images a second, seed {seed}")
    with _Board(console, is_live=console.is_terminal and not is_headless) as board:
        recording = picture.with_suffix(".mcap")
        how: dict[str, Any] = {"show_on": show_on, "recording": recording, "is_room": is_room}
        flight = rehearse(seed=seed, wind=wind, fps=fps, watcher=board.show, **how)
        record = run_virtually(flight, pace)
    figures = record.figures()
    write_picture(record, picture)
    report, reason = _write_report(recording)
    if is_quiet:
        files = {"picture": str(picture), "recording": str(recording), "report": report and str(report)}
        print(json_line({**figures, **files}))
    else:
        console.print(summary_table(figures))
        print_files(console, picture, recording, report, reason)
        words = "landed on the target, motors off" if record.has_landed else f"NOT landed: {figures['outcome']}"
        console.print(Text(words, style="bold green" if record.has_landed else "bold red"))
    return EXIT_OK if record.has_landed else EXIT_FAILURE


def print_files(console: Console, picture: Path, recording: Path, report: Path | None, reason: str) -> None:
    """Say where the flight was written, and why there is no report; brackets are brackets, of an extra for example."""
    last = f"its report, for a browser: {report}" if report else f"no report: {reason}"
    for line in (f"picture of the flight: {picture}", f"its recording: {recording}", last):
        console.print(line, markup=False)


def _write_report(recording: Path) -> tuple[Path | None, str]:
    """Write the report beside a recording: its file, or none and why."""
    from mkdaemon.errors import MkError
    from mkdaemon.files import save
    from mkdaemon.view.report.make import make_page

    report = recording.with_suffix(".html")
    try:
        save(report, make_page(recording, None), overwrite=True)
    except MkError as error:
        return None, str(error)
    return report, ""


class _Board:
    """Shows the flight while it is flown: a live table, or now and then a line."""

    def __init__(self, console: Console, *, is_live: bool) -> None:
        self._console = console
        self._live = Live(console=console, auto_refresh=False, transient=True) if is_live else None
        self._shown_at = float("-inf")
        self._part = ""

    def __enter__(self) -> _Board:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live is not None:
            self._live.stop()

    def show(self, moment: Moment, status: ControlStatus | None) -> None:
        """Show a moment, if it is time."""
        every = LINE_EVERY if self._live is None else REDRAW
        if moment.at - self._shown_at < every and moment.part == self._part:
            return
        self._shown_at, self._part = moment.at, moment.part
        if self._live is not None:
            self._live.update(flight_table(moment, status), refresh=True)
        else:
            self._console.print(flight_line(moment), highlight=False)


def flight_line(moment: Moment) -> str:
    """A moment in one line of at most 80 columns."""
    x, y, z = moment.position
    words = f"{moment.at:5.1f} s  {moment.part:<9} x {x:+.2f} y {y:+.2f} z {z:.2f} m over the target"
    if moment.goal is not None and moment.part != "take-off":
        words += f", {100 * _distance(moment):.0f} cm off"
    return words


def flight_table(moment: Moment, status: ControlStatus | None) -> Table:
    """A moment as a table of at most 80 columns."""
    table = Table(width=COLUMNS, show_header=False, title=f"mkdaemon demo, {moment.at:.1f} s")
    table.add_column(width=20)
    table.add_column()
    x, y, z = moment.position
    table.add_row("part of the flight", moment.part)
    table.add_row("control", "-" if status is None else f"{status.phase.value}: {status.stage or status.reason}")
    table.add_row("over the target", f"x {x:+.2f}   y {y:+.2f}   z {z:.2f} m   (true)")
    goal, estimate = moment.goal, moment.estimate
    table.add_row("believed", "-" if estimate is None else "x {:+.2f}   y {:+.2f}   z {:.2f} m".format(*estimate))
    table.add_row("wanted", "-" if goal is None else "x {:+.2f}   y {:+.2f}   z {:.2f} m".format(*goal))
    table.add_row("error", "-" if goal is None else f"{100 * _distance(moment):.0f} cm")
    table.add_row("the target is at", f"east {moment.target[0]:.2f} m, north {moment.target[1]:.2f} m")
    return table


def summary_table(figures: Mapping[str, Any]) -> Table:
    """The figures of a flight."""
    table = Table(width=COLUMNS)
    table.add_column("figure", no_wrap=True)
    table.add_column("value", justify="right")
    for name, words in SHOWN.items():
        if figures.get(name) is not None:
            table.add_row(words, str(figures[name]))
    return table


def _distance(moment: Moment) -> float:
    """From where it is to be [m]."""
    assert moment.goal is not None
    return float(sum((a - b) ** 2 for a, b in zip(moment.position, moment.goal, strict=True)) ** 0.5)
