"""Measurements of the line as CSV: one row a probe, so that everything can be computed again."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import Final

from mkdaemon.client.linktest.measures import LoadRun
from mkdaemon.client.linktest.probes import Probe, ProbeKind
from mkdaemon.errors import ConfigError
from mkdaemon.foreignfiles import parse_number, read_text

HEADER: Final = ("label", "load", "control_hz", "kind", "sent_s", "round_trip_ms")
"""Columns; `round_trip_ms` is empty where no answer came in time."""
LARGEST: Final = 64_000_000
"""Larger files are none of ours [bytes]: a day at 50 Hz has 200 MB, an hour 8."""


def to_csv(runs: Sequence[LoadRun]) -> str:
    """Every probe as a row."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(HEADER)
    for run in runs:
        for probe in run.probes:
            trip = "" if probe.trip is None else f"{1000 * probe.trip:.3f}"
            writer.writerow((run.label, run.load, f"{run.control_hz:g}", probe.kind, f"{probe.sent:.4f}", trip))
    return text.getvalue()


def read_csv(path: Path) -> list[LoadRun]:
    """Read what `to_csv` wrote.

    Raises:
        ConfigError: it cannot be read, or is no such file; says which line.
    """
    try:
        text = read_text(path, limit=LARGEST)
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: no CSV of `mkctl linktest`") from None
    rows = csv.reader(io.StringIO(text))
    found: list[tuple[tuple[str, str, float], Probe]] = []
    try:
        if tuple(next(rows, ())) != HEADER:
            raise ConfigError(f"{path}: no CSV of `mkctl linktest`: its first line is {','.join(HEADER)}")
        for row in rows:
            label, load, control, kind, sent, trip = row
            probe = Probe(ProbeKind(kind), _number(sent), _number(trip) / 1000 if trip else None)
            found.append(((label, load, _number(control)), probe))
    except (ValueError, csv.Error) as error:
        raise ConfigError(f"{path}, line {rows.line_num}: {error}") from None
    if not found:
        raise ConfigError(f"{path}: it holds no measurement")
    return [
        LoadRun(label, load, control, tuple(probe for _, probe in group))
        for (label, load, control), group in groupby(found, key=lambda pair: pair[0])
    ]


def _number(text: str) -> float:
    """A figure of a row.

    Raises:
        ValueError: it is none, negative or infinite.
    """
    number = parse_number(text)
    if not (math.isfinite(number) and number >= 0.0):
        raise ValueError(f"{text} is not a figure")
    return number
