"""`mkctl log export`: a recording as tables, tracks, a ROS 2 bag, or for Foxglove."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Final, Literal

from cyclopts import Parameter

from mkdaemon.cli.arguments import AsJson
from mkdaemon.cli.extras import needing
from mkdaemon.cli.printing import show

Format = Literal["csv", "parquet", "gpx", "kml", "ros", "foxglove"]
ENDINGS: Final[Mapping[Format, str]] = {
    "csv": "-csv", "parquet": "-parquet", "gpx": ".gpx", "kml": ".kml", "ros": "-ros", "foxglove": "-foxglove.mcap",
}  # fmt: skip
"""Of what is written without `--output`."""


def export(
    file: Path,
    /,
    *,
    to: Annotated[Format, Parameter(name=["--format", "-f"])] = "csv",
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    key: Annotated[tuple[str, ...], Parameter(name=["--key", "-k"])] = (),
    force: bool = False,
    as_json: AsJson = False,
) -> None:
    """Write a recording for other programs.

    csv and parquet: a folder with one file a key, units in the names of the columns. gpx and kml: the track of
    `state/position`. ros: a ROS 2 bag (MCAP, CDR). foxglove: an MCAP file for Foxglove and Lichtblick. Files appear
    whole or not at all; docs/replay.md has the details.

    Example: mkctl log export flight.mcap --format csv

    Args:
        file: The recording.
        to: csv, parquet, gpx, kml, ros or foxglove.
        output: Folder or file to write; by default the recording's name with another ending, here.
        key: Only these keys, for example `-k 'state/*'`.
        force: Replace what is there.
        as_json: Print what was written as JSON.

    Raises:
        MkError: the recording cannot be read, has nothing to export, or the output cannot be written.
        ConfigError: the file is no recording, the output is there already, or a library is missing.
    """
    from mkdaemon.client.export.tables import write_csv, write_parquet
    from mkdaemon.client.export.tracks import POSITION, gpx, kml, tracks_of
    from mkdaemon.client.export.values import read_values
    from mkdaemon.files import saving

    target = output or Path(file.stem + ENDINGS[to])
    written = [target]
    match to:
        case "csv" | "parquet":
            write = write_csv if to == "csv" else write_parquet
            written = write(lambda: read_values(file, key), target, overwrite=force)
        case "gpx" | "kml":
            make = gpx if to == "gpx" else kml
            tracks = tracks_of(read_values(file, key or (POSITION,)))
            with saving(target, overwrite=force) as text:
                text.writelines(line.encode() for line in make(tracks))
        case "ros":
            from mkdaemon.gateways.ros2.bag import write as write_bag

            write_bag(read_values(file, key, images=True), target, overwrite=force)
        case "foxglove":
            with needing("--format foxglove", "foxglove-sdk", "foxglove"):
                from mkdaemon.gateways.foxglove.recording import write as write_foxglove

            write_foxglove(read_values(file, key, images=True), target, overwrite=force)
    for path in written:
        show({"written": str(path)}, str(path), as_json=as_json)
