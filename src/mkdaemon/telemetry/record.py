"""State of the daemon's recorder, and marks in recordings."""

from pydantic import Field

from mkdaemon.telemetry.base import Command, Stamped
from mkdaemon.telemetry.tone import Tone, ToneEnum


class RecorderState(ToneEnum):
    """State of a recorder. This is the only table of these states."""

    OFF = "off", "NOT RECORDING", Tone.NOTE
    """The configuration says that nothing is recorded, or a recording plays."""
    RECORDING = "recording", "records", Tone.OK
    """Everything is written."""
    FULL = "full", "NOT RECORDING, no room", Tone.BAD
    """There is no room that the configuration allows to take; it goes on as soon as there is."""
    FAULT = "fault", "NOT RECORDING, the disk fails", Tone.BAD
    """The disk or the folder fails; it is tried again every few seconds."""


class RecordStatus(Stamped):
    """The daemon's own recorder: `record/status`, at 1 Hz."""

    state: RecorderState
    """What it does."""
    reason: str
    """Why it does not record, one sentence; empty while it records."""
    file: str
    """The file that is being written; empty for none."""
    file_bytes: int
    """Its size."""
    total_bytes: int
    """Size of all recordings of this vehicle."""
    free_bytes: int | None
    """Free on the disk; null where it is not known."""
    entries: int
    """Written since the daemon's start."""
    lost: int
    """Not written since the daemon's start: the disk was too slow, full or failed."""
    queue_bytes: int
    """Bytes that wait to be written."""
    queue_limit_bytes: int
    """Limit of waiting bytes; beyond it entries are lost."""


class BusCounts(Stamped):
    """Number of values published since the daemon's start, by key: `bus/counts`, at 1 Hz.

    A subscriber that counts what it received between two of these knows what it lost.
    """

    counts: dict[str, int]
    """By key without `mk/<vehicle>/`; this value not included."""


class MarkRequest(Command):
    """Mark this moment in all recordings: `do/mark`."""

    text: str = Field(min_length=1, max_length=200)
    """What happened."""
    holder: str = Field(default="", max_length=64, pattern=r"^[A-Za-z0-9._-]*$")
    """Who says so."""


class MarkEvent(Stamped):
    """A client marked a moment: `event/mark`."""

    text: str
    """What happened."""
    holder: str
    """The client that said it."""
