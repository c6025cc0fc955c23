"""`mkctl export`: a recording as tables, tracks or a ROS 2 bag."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from mkdaemon.cli.arguments import AsJson
from mkdaemon.cli.printing import json_line

Format = Literal["csv", "parquet", "gpx", "kml", "ros"]


def export(
    file: Path,
    /,
    *,
    to: Annotated[Format, Parameter(name=["--format", "-f"])] = "csv",
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    key: Annotated[tuple[str, ...], Parameter(name=["--key", "-k"], negative=())] = (),
    force: Annotated[bool, Parameter(negative=())] = False,
    as_json: AsJson = False,
) -> None:
    """Write a recording for other programs.

    csv and parquet: a folder with one file a key, units in the names of the columns. gpx and kml: the track of
    `state/position`. ros: a ROS 2 bag (MCAP, CDR). Files appear whole or not at all; docs/replay.md has the details.

    Args:
        file: The recording.
        to: csv, parquet, gpx, kml or ros.
        output: Folder or file to write; by default the recording's name with another ending, here.
        key: Only these keys, for example `-k 'state/*'`.
        force: Replace what is there.
        as_json: Print what was written as JSON.

    Raises:
        MkError: the recording cannot be read, has nothing to export, or the output cannot be written.
        ConfigError: the file is no recording, the output is there already, or a library is missing.
    """
    from mkdaemon.client.export.tables import tables_of, write_csv, write_parquet
    from mkdaemon.client.export.tracks import gpx, kml, tracks_of
    from mkdaemon.client.export.values import read_values
    from mkdaemon.files import save

    values = read_values(file, key)
    written: list[Path]
    match to:
        case "csv" | "parquet":
            folder = output or Path(f"{file.stem}-{to}")
            write = write_csv if to == "csv" else write_parquet
            written = write(tables_of(values), folder, overwrite=force)
        case "gpx" | "kml":
            track = output or Path(f"{file.stem}.{to}")
            make = gpx if to == "gpx" else kml
            save(track, make(tracks_of(values)), overwrite=force)
            written = [track]
        case "ros":
            from mkdaemon.client.export.ros import RosExport

            bag = output or Path(f"{file.stem}-ros")
            RosExport().write(values, bag, overwrite=force)
            written = [bag]
    for path in written:
        print(json_line({"written": str(path)}) if as_json else path)
