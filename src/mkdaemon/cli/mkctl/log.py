"""`mkctl log`: recordings, looked at, repaired, cut, joined; and marks in those that are being made."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

from cyclopts import App, Parameter

from mkdaemon.cli.arguments import AsJson
from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.mkctl.logshow import print_check, print_list, print_summary, reading_progress, summary_fields
from mkdaemon.cli.mkctl.logtime import moment_of, recording_folders
from mkdaemon.cli.printing import json_line
from mkdaemon.cli.program import EXIT_FAILURE, EXIT_OK
from mkdaemon.errors import ConfigError

if TYPE_CHECKING:
    from mkdaemon.record.writer import View

Force = Annotated[bool, Parameter(negative=(), help="Replace a file that is there.")]
Viewer = Annotated[bool, Parameter(negative=(), help="Add JSON, for Foxglove, Lichtblick and PlotJuggler.")]

app: Final = App(
    name="log",
    help="Recordings: look at them, repair, cut and join them; mark a moment in those that are being made.",
)


@app.command
async def mark(text: str, *, connection: Connection = HERE) -> None:
    """Mark this moment in all recordings of a vehicle: the daemon's own, and those on the ground. Needs no lease.

    Args:
        text: What happened, up to 200 characters.
    """
    from mkdaemon.client.identity import client_name

    async with connection.open() as client:
        (await client.command("do", "mark", {"text": text, "holder": client_name()})).require()
    print(json_line({"marked": text}) if connection.json else f"marked: {text}")


@app.command(name="list")
def list_(folder: Path | None = None, *, as_json: AsJson = False) -> None:
    """List recordings, the newest last.

    Args:
        folder: Where to look; by default where daemons and recorders of this machine write.

    Raises:
        ConfigError: there is no such folder.
    """
    from mkdaemon.record.summary import glance

    folders = [folder] if folder is not None else recording_folders()
    if folder is not None and not folder.is_dir():
        msg = f"{folder}: there is no such folder"
        raise ConfigError(msg)
    found = [glance(path) for one in folders for path in sorted(one.glob("*.mcap"))]
    print_list(found, folders, as_json=as_json)


@app.command
def info(*files: Path, as_json: AsJson = False) -> None:
    """Show what recordings hold: keys, counts, rates, gaps, losses, marks.

    Args:
        files: Recordings, whole or damaged.
    """
    from mkdaemon.record.summary import summarise

    for path in _required(files):
        with reading_progress([path]) as progress:
            summary = summarise(path, progress)
        if as_json:
            print(json_line(summary_fields(summary)))
        else:
            print_summary(summary)


@app.command
def check(*files: Path, as_json: AsJson = False) -> int:
    """Check that recordings are whole. Exit code 0 only if nothing is damaged, lost or unfinished.

    Args:
        files: Recordings.
    """
    from mkdaemon.record.summary import summarise

    is_whole = True
    for path in _required(files):
        with reading_progress([path]) as progress:
            summary = summarise(path, progress)
        is_whole = is_whole and summary.report.is_whole and not summary.missed
        print_check(summary, as_json=as_json)
    return EXIT_OK if is_whole else EXIT_FAILURE


@app.command
def recover(
    file: Path,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    *,
    force: Force = False,
    viewer: Viewer = False,
    as_json: AsJson = False,
) -> None:
    """Write everything that is whole in a recording into a new one with an index. The old one stays as it is.

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
    key: Annotated[tuple[str, ...], Parameter(name=["--key", "-k"], negative=())] = (),
    force: Force = False,
    viewer: Viewer = False,
    as_json: AsJson = False,
) -> None:
    """Write a part of a recording into a new one: a time, some keys, or both.

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

    Args:
        files: Recordings.
        output: The new one.
    """
    from mkdaemon.record.rewrite import merge as write

    with reading_progress(_required(files)) as progress:
        written = write(files, output, overwrite=force, view=_view(viewer), progress=progress)
    _print_written(output, written.entries, sum(report.lost for report in written.reports), as_json=as_json)


def _required(files: Sequence[Path]) -> Sequence[Path]:
    if not files:
        msg = "give one recording or more; `mkctl log list` shows what there is"
        raise ConfigError(msg)
    return files


def _view(is_wanted: bool) -> View | None:
    from mkdaemon.client.schemas import known_schema
    from mkdaemon.record.view import JsonView

    return JsonView(known_schema) if is_wanted else None


def _print_written(target: Path, entries: int, lost: int, *, as_json: bool) -> None:
    if as_json:
        print(json_line({"file": str(target), "entries": entries, "lost": lost}))
    else:
        print(f"{target}: {entries} entries" + (f"; {lost} are missing by their numbers" if lost else ""))
