"""A recording as an MCAP file for Foxglove and Lichtblick: the topics, schemas and frames of the gateway.

Topics and conversions are those of `topics.TOPICS`, so that a layout made for the gateway shows the file too. Log times
are the wall times of the values.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from mcap.writer import Writer

from mkdaemon.client.export.values import ExportedValue
from mkdaemon.errors import MkError
from mkdaemon.files import saving
from mkdaemon.gateways.faults import expressible
from mkdaemon.gateways.foxglove.names import LATEST, Names
from mkdaemon.gateways.foxglove.topics import (
    CAMERA,
    SHOWN_OTHERWISE,
    TOPICS,
    Conversion,
    FoxgloveTopic,
    json_message,
    json_topic,
)
from mkdaemon.stamp import nanoseconds

_Line = tuple[int, Conversion | None]
"""Id of the channel, and the conversion; None where the value is shown as JSON."""


class _Aircraft:
    """The channels of one vehicle; each is made when its first value comes."""

    def __init__(self, names: Names, writer: Writer) -> None:
        self._names, self._writer = names, writer
        self._lines: dict[str, list[_Line]] = {}
        self._topics: dict[str, _Line] = {}

    def take(self, value: ExportedValue) -> int:
        """Write every message that a value makes; their number. Raises `MkError` as `ExportedValue.stamped` does."""
        if value.suffix not in self._lines:
            self._lines[value.suffix] = self._lines_of(value)
        count, at = 0, min(max(nanoseconds(value.wall), 0), LATEST)
        for channel, convert in self._lines[value.suffix]:
            with expressible(value.suffix, value.vehicle, value.wall):
                message = json_message(value.fields) if convert is None else convert(value.suffix, value.stamped)
            if message is not None:
                self._writer.add_message(channel, log_time=at, data=message, publish_time=at)
                count += 1
        return count

    def _lines_of(self, value: ExportedValue) -> list[_Line]:
        head, _, rest = value.suffix.partition("/")
        camera = rest.partition("/")[0] if head == "vision" else ""
        rows = [row for row in (topic.of(camera) for topic in TOPICS) if row.takes(value.suffix)]
        if value.suffix.replace(f"vision/{camera}/", f"vision/{CAMERA}/") not in SHOWN_OTHERWISE:
            rows.append(json_topic(value.suffix, value.schema))
        return [self._line_of(row) for row in rows]

    def _line_of(self, row: FoxgloveTopic) -> _Line:
        if row.name not in self._topics:
            schema = row.schema()
            known = self._writer.register_schema(schema.name, schema.encoding, schema.data)
            channel = self._writer.register_channel(self._names.topic(row.name), row.encoding, known)
            self._topics[row.name] = channel, row.conversion(self._names)
        return self._topics[row.name]


def write(values: Iterable[ExportedValue], path: Path, *, overwrite: bool) -> int:
    """Write a file, whole or not at all; returns the number of messages.

    Args:
        values: of a recording. Topics and frames of every vehicle but the first begin with its name.
        path: the file.
        overwrite: replace a file that is there.

    Raises:
        ConfigError: it is there already, and `overwrite` is off; or there is no such folder.
        MkError: it cannot be written, a value is not what its key carries, or nothing was recorded.
    """
    fleet, count = dict[str, _Aircraft](), 0
    with saving(path, overwrite=overwrite) as file:
        # The SDK's own writer logs a full disk for every message and goes on.
        writer = Writer(file)
        writer.start(library="mkdaemon")
        for value in values:
            if value.vehicle not in fleet:
                names = Names(value.vehicle, f"{value.vehicle}/" if fleet else "")
                fleet[value.vehicle] = _Aircraft(names, writer)
            count += fleet[value.vehicle].take(value)
        writer.finish()  # type: ignore[no-untyped-call]
        if count == 0:
            msg = f"{path}: there is nothing to export in the recording"
            raise MkError(msg)
    return count
