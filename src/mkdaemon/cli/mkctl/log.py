"""`mkctl log`: recordings, looked at, repaired, cut, joined; and marks in those that are being made."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

from cyclopts import App, Parameter
from rich.table import Table

from mkdaemon.cli.arguments import AsJson
from mkdaemon.cli.console import Console, progress_bars
from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.mkctl.logtime import moment_of, recording_folders
from mkdaemon.cli.printing import json_line, picked, show
from mkdaemon.cli.program import EXIT_FAILURE, EXIT_OK
from mkdaemon.cli.sparkline import sparkline
from mkdaemon.cli.terminal import on_one_line
from mkdaemon.errors import ConfigError
from mkdaemon.stamp import NANOSECONDS

if TYPE_CHECKING:
    from mkdaemon.record.reader import ReadReport
    from mkdaemon.record.summary import Glance, KeySummary, Summary
    from mkdaemon.record.writer import View

Force = Annotated[bool, Parameter(help="Replace an existing file.")]
Viewer = Annotated[bool, Parameter(help="Add JSON, for Foxglove, Lichtblick and PlotJuggler.")]

app: Final = App(
    name="log",
    help="Recordings: make, inspect, play, export and repair them, and mark a moment.",
)
for _name in ("record", "play", "export", "report"):
    app.command(f"mkdaemon.cli.mkctl.{_name}:{_name}", name=_name)


@app.command
async def mark(text: str, *, connection: Connection = HERE) -> None:
    """Mark this moment in all recordings of a vehicle: the daemon's own, and those on the ground. Needs no lease.

    Example: mkctl log mark "here it swings"

    Args:
        text: What happened, up to 200 characters.
    """
    async with connection.open() as uav:
        await uav.records.mark(text)
    connection.show({"marked": text}, f"marked: {on_one_line(text)}")


@app.command(name="list")
def list_(folder: Path | None = None, *, as_json: AsJson = False) -> None:
    """List recordings, the newest last.

    Example: mkctl log list

    Args:
        folder: Where to look; by default where daemons and recorders of this machine write.

    Raises:
        ConfigError: there is no such folder.
    """
    from mkdaemon.record.summary import glance

    folders = [folder] if folder is not None else recording_folders()
    if folder is not None and not folder.is_dir():
        raise ConfigError(f"{folder}: there is no such folder")
    found = [glance(path) for one in folders for path in sorted(one.glob("*.mcap"))]
    print_list(found, folders, as_json=as_json)


@app.command
def info(*files: Path, as_json: AsJson = False) -> None:
    """Show what recordings hold: keys, counts, rates, gaps, losses, marks.

    Example: mkctl log info flight.mcap

    Args:
        files: Recordings, whole or damaged.
    """
    for summary in _summaries(files):
        if as_json:
            print(json_line(summary_fields(summary)))
        else:
            print_summary(summary)


@app.command
def verify(*files: Path, as_json: AsJson = False) -> int:
    """Check that recordings are whole. Exit code 0 only if nothing is damaged, lost or unfinished.

    Example: mkctl log verify flight.mcap

    Args:
        files: Recordings.
    """
    is_whole = True
    for summary in _summaries(files):
        is_whole = is_whole and summary.report.is_whole and not summary.missed
        print_check(summary, as_json=as_json)
    return EXIT_OK if is_whole else EXIT_FAILURE


@app.command
def repair(
    file: Path,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    *,
    force: Force = False,
    viewer: Viewer = False,
    as_json: AsJson = False,
) -> None:
    """Write everything that is whole in a recording into a new one with an index. The old one stays as it is.

    Example: mkctl log repair torn.mcap whole.mcap

    Args:
        file: A recording that was cut off or damaged.
        output: The new one; by default NAME-recovered.mcap beside it.
    """
    from mkdaemon.record.rewrite import recover as write

    target = output or file.with_name(f"{file.stem}-recovered.mcap")
    with reading_progress([file]) as progress:
        written = write(file, target, overwrite=force, view=_view(viewer), progress=progress)
    _print_written(target, written.entries, written.reports[0].lost, as_json=as_json)


@app.command
def cut(
    file: Path,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    *,
    start: Annotated[str | None, Parameter(name="--from")] = None,
    end: Annotated[str | None, Parameter(name="--to")] = None,
    key: Annotated[tuple[str, ...], Parameter(name=["--key", "-k"])] = (),
    force: Force = False,
    viewer: Viewer = False,
    as_json: AsJson = False,
) -> None:
    """Write a part of a recording into a new one: a time, some keys, or both.

    Example: mkctl log cut flight.mcap landing.mcap --from 60 --to 90

    Args:
        file: A recording.
        output: The new one.
        start: From when on: seconds from its beginning, negative from its end, or a time, `2026-11-22T08:00:00Z`.
        end: Until when, in the same way.
        key: Keys that are taken, with or without `mk/<vehicle>/`: `state/**`; may be given several times.
    """
    from mkdaemon.record.reader import matches_any
    from mkdaemon.record.rewrite import Selection
    from mkdaemon.record.rewrite import cut as write

    selection = Selection(
        lambda facts: matches_any(facts.key, key),
        moment_of(start, file, "--from"),
        moment_of(end, file, "--to"),
    )
    with reading_progress([file]) as progress:
        written = write(file, output, selection, overwrite=force, view=_view(viewer), progress=progress)
    _print_written(output, written.entries, written.reports[0].lost, as_json=as_json)


@app.command
def merge(
    *files: Path,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    force: Force = False,
    viewer: Viewer = False,
    as_json: AsJson = False,
) -> None:
    """Join recordings by time: parts of one, or those of several vehicles.

    Example: mkctl log merge part1.mcap part2.mcap --output whole.mcap

    Args:
        files: Recordings.
        output: The new one.
    """
    from mkdaemon.record.rewrite import merge as write

    with reading_progress(_required(files)) as progress:
        written = write(files, output, overwrite=force, view=_view(viewer), progress=progress)
    _print_written(output, written.entries, sum(report.lost for report in written.reports), as_json=as_json)


def _summaries(files: Sequence[Path]) -> Iterator[Summary]:
    """What each recording holds."""
    from mkdaemon.record.summary import summarise

    for path in _required(files):
        with reading_progress([path]) as progress:
            yield summarise(path, progress)


def _required(files: Sequence[Path]) -> Sequence[Path]:
    if not files:
        raise ConfigError("give one recording or more; `mkctl log list` shows what there is")
    return files


def _view(is_wanted: bool) -> View | None:
    from mkdaemon.client.samples import known_schema
    from mkdaemon.record.view import JsonView

    return JsonView(known_schema) if is_wanted else None


def _print_written(target: Path, entries: int, lost: int, *, as_json: bool) -> None:
    words = f"{on_one_line(target)}: {entries} entries" + (f"; {lost} are missing by their numbers" if lost else "")
    show({"file": str(target), "entries": entries, "lost": lost}, words, as_json=as_json)


MOST_LINES: Final = 300
"""Keys, marks or findings that are shown of a file; ours have up to 60 keys."""
BARS: Final = 12
"""Of the trend of a key."""
ENOUGH: Final = 8 * BARS
"""Fewer entries than this come too unevenly to be counted by the bar."""
_SESSION: Final = ("recorder", "vehicle", "name", "part")
WIDE: Final = 1000
"""Columns where there is no terminal."""


@contextmanager
def reading_progress(paths: Sequence[Path]) -> Iterator[Callable[[int], None]]:
    """Show on standard error how much of some files has been read; nothing where there is no terminal."""
    total = sum(path.stat().st_size for path in paths if path.exists())
    with progress_bars("{task.description}", "{task.percentage:3.0f} %") as bars:
        task = bars.add_task(on_one_line(paths[0].name), total=total)
        yield lambda position: bars.update(task, completed=position)


def print_list(found: Sequence[Glance], folders: Sequence[Path], *, as_json: bool) -> None:
    """Print what recordings there are, the newest last."""
    if as_json:
        for one in found:
            begins = None if one.first is None else one.first / NANOSECONDS
            known = {"begins": begins, **picked(one, "duration", "size"), "finished": one.is_finished}
            print(json_line({"file": str(one.path), **picked(one.session, *_SESSION), **known}))
        return
    if not found:
        where = ", ".join(map(str, folders)) or "/var/lib/mkdaemon and the user's state folder"
        print(f"no recordings in {where}; name a folder: mkctl log list FOLDER")
        return
    table = Table(box=None, pad_edge=False)
    for name in ("recording", "by", "begins (UTC)", "length", "size", ""):
        table.add_column(name, overflow="fold")
    for one in found:
        session = one.session
        table.add_row(
            on_one_line(one.path),
            "?" if session is None else on_one_line(session.recorder),
            "?" if one.first is None else _time(one.first),
            "?" if one.duration is None else _length(one.duration),
            _size(one.size),
            "" if one.is_finished else "not finished",
        )
    wide_console().print(table)


def summary_fields(summary: Summary) -> dict[str, Any]:
    """What a recording holds, for programs."""
    keys = ("key", "encoding", "count", "rate", "longest_gap", "lost")
    return {
        "file": str(summary.path),
        "size": summary.report.size,
        **picked(summary.session, "recorder", "name", "part", "program", "host"),
        "vehicles": summary.vehicles,
        "begins": summary.first / NANOSECONDS,
        "duration": summary.duration,
        **report_fields(summary.report),
        "missed": dict(summary.missed),
        "keys": [{"kind": one.kind, "bytes": one.size, **picked(one, *keys)} for one in summary.keys.values()],
        "marks": [
            {"at": (mark.at - summary.first) / NANOSECONDS, **picked(mark, "vehicle", "text")} for mark in summary.marks
        ],
        "senders": [{**asdict(one), "names": sorted(one.names)} for one in summary.senders.found.values()],
    }


def report_fields(report: ReadReport) -> dict[str, Any]:
    """What was found while reading, for programs."""
    return {
        "whole": report.is_whole,
        "finished": report.is_complete,
        **picked(report, "entries", "lost", "orphans", "unreadable", "foreign"),
        "damages": [picked(one, "offset", "length", "reason") for one in report.damages],
    }


def print_summary(summary: Summary) -> None:
    """Print what a recording holds."""
    session, console = summary.session, wide_console()
    console.print(f"{on_one_line(summary.path)}: {_size(summary.report.size)}, {summary.report.entries} entries")
    if session is not None:
        words = f"{session.recorder} {session.name}, part {session.part}, by {session.program} on {session.host}"
        console.print(on_one_line(words))
    if summary.keys:
        vehicles = on_one_line(", ".join(summary.vehicles)) or "-"
        words = f"begins {_time(summary.first)} UTC, {_length(summary.duration)}; vehicle {vehicles}"
        console.print(words)
        console.print(_key_table(summary))
        _print_rest(console, len(summary.keys), "keys")
    for mark in summary.marks[:MOST_LINES]:
        at = (mark.at - summary.first) / NANOSECONDS
        console.print(on_one_line(f"mark {at:10.3f} s  {mark.vehicle}: {mark.text}"))
    _print_rest(console, len(summary.marks), "marks")
    lines = [*sender_lines(summary), *damage_lines(summary.report), *missed_lines(summary)]
    for line in lines[:MOST_LINES]:
        console.print(on_one_line(line))
    _print_rest(console, len(lines), "lines")


def _print_rest(console: Console, count: int, what: str) -> None:
    """Print how many are not shown."""
    if count > MOST_LINES:
        console.print(f"... and {count - MOST_LINES} more {what}; --json has them all")


def sender_lines(summary: Summary) -> Iterator[str]:
    """Who sent setpoints and requests, a sentence each."""
    for one in summary.senders.found.values():
        names = f" ({', '.join(sorted(one.names))})" if one.names else ""
        counts = [f"{one.requests} requests, {one.requests_refused} refused"] if one.requests else []
        if one.setpoints:
            tokens = ", ".join(f"{number} {token}" for token, number in one.setpoints_refused.items())
            refused = tokens or "none"
            late = f", {one.setpoints_late} under way when it ended" if one.setpoints_late else ""
            counts.append(
                f"{one.setpoints} setpoints, {one.signed} signed by the holder of the lease{late}, refused: {refused}"
            )
        yield f"from {one.source or 'an unknown source'}{names}: {'; '.join(counts)}"


def _key_table(summary: Summary) -> Table:
    table = Table(box=None, pad_edge=False)
    table.add_column("kind")
    table.add_column("key", overflow="fold")
    for name in ("count", "Hz", "kB", "longest gap (s)", "lost"):
        table.add_column(name, justify="right")
    table.add_column("over time", no_wrap=True)
    for one in sorted(summary.keys.values(), key=lambda one: (one.kind.value, one.key))[:MOST_LINES]:
        table.add_row(
            one.kind.value,
            on_one_line(one.key),
            str(one.count),
            f"{one.rate:.1f}",
            f"{one.size / 1000:.1f}",
            f"{one.longest_gap:.2f}",
            str(one.lost or ""),
            trend(one, summary.last),
        )
    return table


def trend(one: KeySummary, end: int) -> str:
    """When entries of a key came, until an end [ns]: how many, or only whether, where they are too few for bars."""
    counts = one.activity.over(end, BARS)
    if one.count < ENOUGH:
        return "".join("▄" if count else " " for count in counts)
    return sparkline([count or None for count in counts], BARS, least=0.0)


def print_check(summary: Summary, *, as_json: bool) -> None:
    """Print whether a recording is whole."""
    report = summary.report
    if as_json:
        print(json_line({"file": str(summary.path), **report_fields(report), "missed": dict(summary.missed)}))
        return
    words = "whole" if report.is_whole and not summary.missed else "not whole"
    print(f"{on_one_line(summary.path)}: {words}, {report.entries} entries")
    lines = [*damage_lines(report), *missed_lines(summary)]
    for line in lines[:MOST_LINES]:
        print(on_one_line(f"  {line}"))
    _print_rest(wide_console(), len(lines), "lines")


def missed_lines(summary: Summary) -> Iterator[str]:
    """What never reached the recorder, a sentence each."""
    for key, lost in summary.missed.most_common():
        yield f"{lost} of {key} were put by the daemon and never came: lost on the way to the recorder"


def damage_lines(report: ReadReport) -> Iterator[str]:
    """What is wrong with a recording, a sentence each."""
    for one in report.damages:
        where = f"{one.length} bytes at byte {one.offset}" if one.length else f"at byte {one.offset}"
        yield f"{where}: {one.reason}"
    if report.damages:
        yield "`mkctl log repair FILE` writes what is whole into a new file"
    for (kind, key), lost in report.gaps.items():
        yield f"{lost} of {kind} {key} are missing by their numbers: they were lost before they were written"
    if report.orphans:
        yield f"{report.orphans} entries belong to keys that are nowhere in the file"
    if report.unreadable:
        yield f"{report.unreadable} entries cannot be read"
    if report.foreign:
        yield f"{report.foreign} messages of other programs are left out"


def wide_console() -> Console:
    """Where it is printed; what another program reads is not cut into lines of a terminal."""
    console = Console()
    return console if console.is_terminal else Console(width=WIDE)


def _time(at: int) -> str:
    return f"{datetime.fromtimestamp(at / NANOSECONDS, UTC):%Y-%m-%d %H:%M:%S}"


def _length(seconds: float) -> str:
    whole = round(seconds)
    if whole < 60:
        return f"{seconds:.1f} s"
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"


def _size(size: int) -> str:
    return f"{size / 1e6:.1f} MB" if size >= 100_000 else f"{size / 1e3:.1f} kB"
