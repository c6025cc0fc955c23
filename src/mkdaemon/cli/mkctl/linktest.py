"""`mkctl linktest`: how good the line to the aircraft is, with advice."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

from mkdaemon.cli.arguments import Length, fitting
from mkdaemon.cli.console import Console, progress_bars
from mkdaemon.cli.interrupts import asked_to_end
from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.mkctl.streams import read_interval
from mkdaemon.cli.printing import json_line, picked
from mkdaemon.cli.program import EXIT_FAILURE, EXIT_OK
from mkdaemon.cli.terminal import on_one_line
from mkdaemon.errors import ConfigError, MkError
from mkdaemon.files import refuse_existing, save

if TYPE_CHECKING:
    from mkdaemon.client.linktest.advice import LineVerdict
    from mkdaemon.client.linktest.campaign import LinkTestFound, LinkTestPlan, LinkTestProgress, OnLinkTest
    from mkdaemon.client.linktest.measures import LoadRun, Measures
    from mkdaemon.client.linktest.probes import Probe

BINS: Final = 16
"""Lines of a histogram on the terminal."""
BAR: Final = 40
"""Characters of its longest bar."""
SLICES: Final = 60
"""Characters of the line that shows losses over time."""
Rate = Annotated[float, fitting(lambda value: 0.0 <= value <= 100.0, "give a rate from 0 to 100 Hz")]


async def linktest(
    *,
    load: Literal["light", "full", "both"] = "both",
    stream: tuple[str, ...] = (),
    control: Rate = 0.0,
    seconds: Length = 60.0,
    tests: Rate = 0.0,
    label: str = "",
    csv: Path | None = None,
    picture: Path | None = None,
    compare: Path | None = None,
    motors_off: bool = False,
    force: bool = False,
    connection: Connection = HERE,
) -> int:
    """Measure the line: round trips and losses under light and full load, with a verdict and what to change.

    On the ground, motors off; refused while they run. Streams are changed meanwhile and put back at the end, also
    after Ctrl-C, which ends the measurement and still shows what was found. Exit code 1 for a poor line.

    Example: mkctl linktest --label "XBee A" --csv a.csv --picture a.svg

    Args:
        load: `light` is OSD twice a second; `full` OSD at 100 ms, debug at 200 ms, attitude at 50 ms.
        stream: A stream of your own choice in place of these, for example `osd=100ms`; may be given again.
        control: Stick setpoints a second beside full or chosen load [Hz]: neutral, lowest throttle, under a lease.
        seconds: Length of each load [s].
        tests: Link tests a second beside the daemon's own (`link.echo_hz`) [Hz].
        label: Whose line: the radio, the cable, the place. The vehicle's name by default.
        csv: Write every probe into this file.
        picture: Draw histogram and losses into this SVG.
        compare: CSV of another line, shown beside this one.
        motors_off: You have looked: the motors are off, where no stream says so.
        force: Overwrite files that are there.

    Raises:
        ConfigError: an option cannot be, or a file is there already.
        MkError: motors run, or the line is down.
        CommandRejectedError: the line cannot carry the streams, or the lease is refused.
    """
    from mkdaemon.client.linktest.campaign import CHOSEN, FULL, LIGHT, LinkTestPlan
    from mkdaemon.client.linktest.probefile import read_csv, to_csv

    for path in (csv, picture):
        if path is not None:
            refuse_existing(path, overwrite=force)
    other = [] if compare is None else read_csv(compare)
    plan = LinkTestPlan(
        label=label or connection.vehicle,
        loads=(CHOSEN,) if stream else {"light": (LIGHT,), "full": (FULL,), "both": (LIGHT, FULL)}[load],
        streams=dict(_stream(text) for text in stream),
        control_hz=control,
        seconds=seconds,
        tests_hz=tests,
        motors_off=motors_off,
    )
    found = await _run(plan, connection)
    if csv is not None:
        save(csv, to_csv(found.runs), overwrite=force)
    return _report_found(found, other, picture, connection, force=force)


def _report_found(
    found: LinkTestFound, other: Sequence[LoadRun], picture: Path | None, connection: Connection, *, force: bool
) -> int:
    """Draw and print what was found; the exit code."""
    from mkdaemon.client.linktest.advice import Grade, judge

    verdict = judge(found.runs)
    if picture is not None:
        from mkdaemon.view.linkpicture import link_picture

        title = f"Link test: {verdict.grade}. {verdict.reason}"
        save(picture, link_picture([*other, *found.runs], title), overwrite=force)
    if connection.json:
        runs = [_fields(run) for run in found.runs]
        print(json_line({"verdict": asdict(verdict), "ended_by": found.ended_by, "runs": runs}))
    else:
        _print(found.runs, other, verdict)
    return EXIT_OK if verdict.grade in (Grade.GOOD, Grade.USABLE) else EXIT_FAILURE


def _stream(text: str) -> tuple[str, float]:
    """Read `osd=100ms`.

    Raises:
        ConfigError: it is not a stream with an interval.
    """
    name, equals, interval = text.partition("=")
    if not (name and equals):
        raise ConfigError(f"--stream {text!r}: write a stream and its interval, for example osd=100ms")
    return name, read_interval(interval)


async def _run(plan: LinkTestPlan, connection: Connection) -> LinkTestFound:
    """Measure until it is done or Ctrl-C.

    Raises:
        MkError: nothing was measured.
    """
    from mkdaemon.client.linktest.campaign import run_link_test

    async with connection.open() as uav:
        with asked_to_end() as stop, _bars(plan, quiet=connection.json) as show:
            found = await run_link_test(uav, plan, on_progress=show, stop=stop)
    if found.ended_by:
        print(f"mkctl: ended early, the streams are as they were: {on_one_line(found.ended_by)}", file=sys.stderr)
    if not any(run.probes for run in found.runs):
        raise MkError("no link test was seen: set link.echo_hz in the configuration, or give --tests 5")
    return found


@contextmanager
def _bars(plan: LinkTestPlan, *, quiet: bool) -> Iterator[OnLinkTest]:
    """A bar on standard error, where a terminal is."""
    with progress_bars("", "{task.description}", quiet=quiet) as bars:
        task = bars.add_task("streams are set", total=plan.seconds * len(plan.loads))

        def show(progress: LinkTestProgress) -> None:
            done = progress.done * plan.seconds + progress.elapsed
            words = (
                f"{progress.load} load {progress.done + 1} of {progress.of}: {progress.sent} sent, {progress.lost} lost"
            )
            bars.update(task, completed=done, description=words)

        yield show


def _fields(run: LoadRun) -> dict[str, Any]:
    from mkdaemon.client.linktest.measures import measure
    from mkdaemon.client.linktest.probes import ProbeKind

    found = {kind.name.lower(): measure(run.of(kind)) for kind in ProbeKind if run.of(kind)}
    return {
        **picked(run, "label", "load", "control_hz", "line_share"),
        "damaged_bytes": run.damaged,
        "counted": {title: fates.model_dump() for title, fates in run.counted.items()},
        "daemon_stalled": run.stalled,
        **{name: {**asdict(value), "loss_percent": value.loss_percent} for name, value in found.items()},
    }


def _print(runs: Sequence[LoadRun], other: Sequence[LoadRun], verdict: LineVerdict) -> None:
    from rich.table import Table

    from mkdaemon.client.linktest.measures import measure
    from mkdaemon.client.linktest.probes import ProbeKind

    console = Console()
    for run in runs:
        for kind, group in groupby(sorted(run.probes, key=lambda probe: probe.kind), key=lambda probe: probe.kind):
            probes = list(group)
            console.print(f"{run.load} load, {kind}s:")
            for line in (*_histogram(probes), _over_time(probes)):
                console.print(line)
            console.print()
    counts = ("sent", "lost %", "replaced", "in a row")
    table = Table("line", "load", "probe", *counts, "50", "95", "99 %", "most", "weighted ms", box=None, pad_edge=False)
    for run in (*other, *runs):
        for kind in ProbeKind:
            if run.of(kind):
                figures = measure(run.of(kind))
                table.add_row(on_one_line(run.label), on_one_line(run.load), kind, *_cells(figures))
    console.print(table)
    for run in runs:
        for title, fates in run.counted.items():
            console.print(f"{on_one_line(run.load)} load, {title}: {fates.words}")
    console.print(f"\n{verdict.grade.upper()}: {verdict.reason}")
    for advice in verdict.advice:
        console.print(f"  {advice}")


def _cells(figures: Measures) -> tuple[str, ...]:
    times = (figures.p50_ms, figures.p95_ms, figures.p99_ms, figures.most_ms, figures.weighted_ms)
    return (
        str(figures.sent),
        f"{figures.loss_percent:.2f}",
        str(figures.replaced),
        str(figures.longest_run),
        *("-" if value is None else f"{value:.1f}" for value in times),
    )


def _histogram(probes: Sequence[Probe]) -> Iterator[str]:
    """Bars of round trips, the lost ones last."""
    from mkdaemon.client.linktest.measures import histogram

    trips = sorted(1000 * probe.trip for probe in probes if probe.trip is not None)
    lost = len(probes) - len(trips)
    if trips:
        width = max(trips[int(0.995 * len(trips))] / BINS, 0.5)
        counts = histogram(trips, width, BINS)
        last = max(place for place, count in enumerate(counts) if count)
        for place, count in enumerate(counts[: last + 1]):
            until = f"- {(place + 1) * width:5.1f} ms" if place < BINS - 1 else "ms ...    "
            yield f"  {place * width:5.1f} {until} {'#' * round(BAR * count / max(counts)):<{BAR}} {count}"
    yield f"  {'lost':<16} {'':<{BAR}} {lost}"


def _over_time(probes: Sequence[Probe]) -> str:
    """Losses over time: a character for each part of it."""
    from mkdaemon.client.linktest.measures import losses_over_time

    seconds = max(probe.sent for probe in probes)
    shares = losses_over_time(probes, seconds, min(SLICES, len(probes)))
    marks = "".join(" " if share is None else "." if not share else str(min(int(10 * share), 9)) for share in shares)
    return f"  lost over {seconds:.0f} s: [{marks}]  (. none, 0 below a tenth, 9 nine tenths or more)"
