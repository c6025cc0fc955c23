"""`mkctl log export`: a recording as tables, tracks, a ROS 2 bag, or for Foxglove."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from mkdaemon.cli.arguments import AsJson
from mkdaemon.cli.printing import show
from mkdaemon.errors import ConfigError

Format = Literal["csv", "parquet", "gpx", "kml", "ros", "foxglove"]


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

    written: list[Path]
    match to:
        case "csv" | "parquet":
            folder = output or Path(f"{file.stem}-{to}")
            write = write_csv if to == "csv" else write_parquet
            written = write(lambda: read_values(file, key), folder, overwrite=force)
        case "gpx" | "kml":
            track = output or Path(f"{file.stem}.{to}")
            make = gpx if to == "gpx" else kml
            tracks = tracks_of(read_values(file, key or (POSITION,)))
            with saving(track, overwrite=force) as text:
                text.writelines(line.encode() for line in make(tracks))
            written = [track]
        case "ros":
            from mkdaemon.gateways.ros2.bag import write as write_bag

            bag = output or Path(f"{file.stem}-ros")
            write_bag(read_values(file, key, images=True), bag, overwrite=force)
            written = [bag]
        case "foxglove":
            written = [output or Path(f"{file.stem}-foxglove.mcap")]
            write_foxglove = _foxglove_writer()
            write_foxglove(read_values(file, key, images=True), written[0], overwrite=force)
    for path in written:
        show({"written": str(path)}, str(path), as_json=as_json)


def _foxglove_writer() -> Callable[..., int]:
    """The writer of `--format foxglove`.

    Raises:
        ConfigError: foxglove-sdk is not installed.
    """
    try:
        from mkdaemon.gateways.foxglove.recording import write
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "foxglove":
            raise
        raise ConfigError('--format foxglove needs foxglove-sdk: pip install "mkdaemon[foxglove]"') from None
    return write
