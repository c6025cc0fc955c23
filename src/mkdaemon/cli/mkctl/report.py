"""`mkctl log report`: a flight as one page, out of a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from mkdaemon.cli.arguments import AsJson
from mkdaemon.cli.mkctl.log import Force, reading_progress
from mkdaemon.cli.printing import show


def report(
    file: Path,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    *,
    vehicle: Annotated[str | None, Parameter(name="--vehicle")] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Write a flight as one page: in words, from above, over time, with its errors, events, refusals and pictures.

    The page is one HTML file that needs no network; the browser prints it, or saves it as PDF. A damaged recording is
    reported as far as it can be read, and the page says what is missing.

    Example: mkctl log report flight.mcap

    Args:
        file: A recording, whole or damaged.
        output: The page; by default the recording's name with `.html`, here.
        vehicle: Whose flight, where the recording has several vehicles.

    Raises:
        MkError: the recording cannot be read, has nothing in it, or the page cannot be written.
        ConfigError: the page is there already, plotly is not installed, or it is not clear which vehicle is meant.
    """
    from mkdaemon.files import refuse_existing, save
    from mkdaemon.view.report.make import make_page

    target = output or Path(f"{file.stem}.html")
    refuse_existing(target, overwrite=force)
    with reading_progress([file]) as progress:
        page = make_page(file, vehicle, progress)
    save(target, page, overwrite=force)
    show({"written": str(target), "bytes": len(page)}, str(target), as_json=as_json)
