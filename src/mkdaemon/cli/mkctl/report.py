"""`mkctl log report`: a flight as one page, out of a recording."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter
from rich.table import Table

from mkdaemon.cli.arguments import AsJson
from mkdaemon.cli.mkctl.log import Force, reading_progress, wide_console
from mkdaemon.cli.printing import picked, show
from mkdaemon.cli.program import EXIT_FAILURE, EXIT_OK
from mkdaemon.cli.terminal import on_one_line

if TYPE_CHECKING:
    from mkdaemon.view.report.against import Chapter


def report(
    file: Path,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    *,
    vehicle: Annotated[str | None, Parameter(name="--vehicle")] = None,
    against: Annotated[str | None, Parameter(name="--against")] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> int:
    """Write a flight as one page: in words, from above, over time, with its errors, events, refusals and pictures.

    The page is one HTML file that needs no network; the browser prints it, or saves it as PDF. A damaged recording is
    reported as far as it can be read, and the page says what is missing.

    Example: mkctl log report flight.mcap --against mocap

    Args:
        file: A recording, whole or damaged.
        output: The page; by default the recording's name with `.html`, here.
        vehicle: Whose flight, where the recording has several vehicles.
        against: Source of `[[positions]]`, or camera, to compare the cameras with: scale, errors, detection, drop-outs
            and latency as tables here and figures in the page. Exit code 1 if the recording does not answer.

    Raises:
        MkError: the recording cannot be read, has nothing in it, or the page cannot be written.
        ConfigError: the page is there already, plotly is not installed, or it is not clear which vehicle is meant, or
            nothing can be compared.
    """
    from mkdaemon.files import refuse_existing, save
    from mkdaemon.view.report.make import report_of
    from mkdaemon.view.report.page import plotly_source, render

    target = output or Path(f"{file.stem}.html")
    refuse_existing(target, overwrite=force)
    library = plotly_source()
    with reading_progress([file]) as progress:
        found = report_of(file, vehicle, progress, against)
    page = render(found, library)
    save(target, page, overwrite=force)
    if not as_json:
        for chapter in found.chapters:
            _print_chapter(chapter)
    compared = {} if against is None else {"against": [_fields_of(chapter) for chapter in found.chapters]}
    show({"written": str(target), "bytes": len(page)} | compared, str(target), as_json=as_json)
    return EXIT_OK if all(chapter.is_answered for chapter in found.chapters) else EXIT_FAILURE


def _print_chapter(chapter: Chapter) -> None:
    """A camera against a reference, as the page has it."""
    console = wide_console()
    console.print(f"{chapter.camera} against {chapter.reference}")
    for sentence in chapter.sentences:
        console.print(on_one_line(sentence))
    for sheet in chapter.sheets:
        table = Table(*sheet.head, box=None, pad_edge=False, title=sheet.title, title_justify="left")
        for row in sheet.rows:
            table.add_row(*map(on_one_line, row))
        console.print(table)


def _fields_of(chapter: Chapter) -> dict[str, Any]:
    """The same for a program: tables as lists of rows by their title."""
    sheets = {sheet.title: [dict(zip(sheet.head, row, strict=True)) for row in sheet.rows] for sheet in chapter.sheets}
    return picked(chapter, "camera", "reference", "is_answered", "sentences") | {"tables": sheets}
