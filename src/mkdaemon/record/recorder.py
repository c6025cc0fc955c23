"""Writes what waits in a queue into the files of a folder, and survives what disks do.

`step` does a little of the work and says when to come back: a thread calls it (`RecorderThread`), tests call it in any
time they like. Everything that may wait for the disk happens in `step`.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Protocol

import structlog

from mkdaemon.record.entry import Entry
from mkdaemon.record.folder import RawFile, RecordingFolder
from mkdaemon.record.layout import Session
from mkdaemon.record.queue import EntryQueue
from mkdaemon.record.writer import RecordingWriter, View
from mkdaemon.telemetry.record import RecorderState

FLUSH: Final = 0.8
"""Time between two flushes [s]: with it nothing older than a second is lost when the process is killed."""
LOOK: Final = 1.0
"""Time between two looks at the room on the disk and at the file [s]."""
RETRY: Final = 3.0
"""Time before a folder that failed or was full is tried again [s]."""
SLICE: Final = 16
"""Entries written in one step: 0.2 ms, after which the event loop may have the interpreter."""
PAUSE: Final = 0.0005
"""Time between two steps while more is waiting [s]."""
IDLE: Final = 0.05
"""Time between two looks into an empty queue [s]."""


class OutputFile(Protocol):
    """A file that is being written; see `RawFile`."""

    def write(self, data: bytes, /) -> None:
        """Append all of it or nothing."""

    def sync(self) -> None:
        """Bring it to the disk."""

    def is_in_place(self) -> bool:
        """Whether it still has its name."""

    def close(self) -> None:
        """Close it."""

    def discard(self) -> None:
        """Close it and take its name away."""


@dataclass(frozen=True, slots=True)
class RecorderReport:
    """State of a recorder.

    Attributes:
        state: what it does.
        reason: why it does not record; empty where it does.
        file: what is being written; None for nothing.
        file_bytes: its size.
        total_bytes: of all recordings of the folder.
        free_bytes: on the disk; None where it is not known.
        entries: number written.
    """

    state: RecorderState
    reason: str = ""
    file: Path | None = None
    file_bytes: int = 0
    total_bytes: int = 0
    free_bytes: int | None = None
    entries: int = 0


class Recorder:
    """One recording, in parts.

    Attributes:
        report: what it does now; may be read from any thread.
        queue: what it writes.
    """

    def __init__(
        self,
        queue: EntryQueue,
        folder: RecordingFolder,
        session: Session,
        *,
        view: View | None = None,
        sync_period: float = 0.0,
        complete: Callable[[Entry], Entry] = lambda entry: entry,
        open_file: Callable[[Path], OutputFile] = RawFile,
    ) -> None:
        """Prepare; nothing is opened yet.

        Args:
            queue: what is written.
            folder: where.
            session: what every file says about itself; parts are counted from its own.
            view: adds JSON for viewers.
            sync_period: time between two calls that bring the file to the disk itself [s]; 0 for never.
            complete: adds to every entry what was too slow for who put it.
            open_file: makes a file.
        """
        self.report = RecorderReport(RecorderState.RECORDING)
        self.queue = queue
        self._folder = folder
        self._session = session
        self._view = view
        self._sync_period = sync_period
        self._complete = complete
        self._open_file = open_file
        self._part: _Part | None = None
        self._retry_at = float("-inf")
        self._written = 0

    def step(self, now: float) -> float:
        """Write some of what waits; returns how long to wait before the next step [s].

        Args:
            now: [s; monotonic].
        """
        try:
            if self._part is None:
                if now < self._retry_at or not len(self.queue):
                    return IDLE
                self._begin(now)
            part = self._part
            if part is not None:
                self._write(part, now)
        except OSError as error:
            self._give_up(RecorderState.FAULT, f"{self._folder.path}: {error.strerror or error}", now)
        return PAUSE if len(self.queue) and self._part is not None else IDLE

    def close(self, now: float) -> None:
        """Write what is left and end the file."""
        waiting = len(self.queue) + 1
        while 0 < len(self.queue) < waiting:
            waiting = len(self.queue)
            self.step(now)
        self._end(now)
        self.queue.count_lost(len(self.queue))
        self.report = replace(self.report, entries=self._written)

    def fail(self, reason: str) -> None:
        """Report that nothing is written any more."""
        self.report = replace(self.report, state=RecorderState.FAULT, reason=reason, file=None)

    def _begin(self, now: float) -> None:
        """Open the next part, if there is room."""
        self._folder.make()
        reason = self._folder.make_room(self._session.name, None)
        if reason:
            self._give_up(RecorderState.FULL, reason, now)
            return
        if self._session.part == 0:
            self._session = replace(self._session, name=self._folder.unused_name(self._session.name))
        path = self._folder.file(self._session.name, self._session.part)
        file = self._open_file(path)
        try:
            writer = RecordingWriter(file, self._session, self._view)
        except OSError:
            file.discard()
            raise
        self._session = replace(self._session, part=self._session.part + 1)
        self._part = part = _Part(path, file, writer, now)
        self._look(part, now)

    def _write(self, part: _Part, now: float) -> None:
        for item in self.queue.take(SLICE):
            entry = item if isinstance(item, Entry) else item()
            if entry is not None:
                part.taken.append(self._complete(entry))
        while part.taken:
            part.writer.add(part.taken.popleft())
        if now >= part.flush_at:
            part.flush_at = now + FLUSH
            self._flush(part)
            if self._sync_period and now >= part.sync_at:
                part.sync_at = now + self._sync_period
                part.file.sync()
        if now >= part.look_at:
            self._look(part, now)
        limits = self._folder.limits
        is_old = now - part.opened_at >= limits.file_time
        if is_old or part.writer.size >= limits.file_bytes or part.writer.is_full:
            self._end(now)

    def _flush(self, part: _Part) -> None:
        part.writer.flush()
        self._count(part)

    def _count(self, part: _Part) -> None:
        """Count what has been written since the last time."""
        written = part.writer.entries - len(part.writer.pending)
        self._written, part.counted = self._written + written - part.counted, written

    def _look(self, part: _Part, now: float) -> None:
        """Look after the file and the room for it, and report."""
        part.look_at = now + LOOK
        self._require_in_place(part)
        reason = self._folder.make_room(self._session.name, part.path)
        if reason:
            self._end(now)
            self._give_up(RecorderState.FULL, reason, now)
            return
        self.report = RecorderReport(
            RecorderState.RECORDING,
            file=part.path,
            file_bytes=part.writer.size,
            total_bytes=self._folder.total_bytes(),
            free_bytes=self._folder.free_bytes(),
            entries=self._written,
        )

    def _require_in_place(self, part: _Part) -> None:
        """Make sure that the file still has its name: what was written into a removed one is lost, and counted.

        Raises:
            FileNotFoundError: it has not.
        """
        if part.file.is_in_place():
            return
        self._count(part)
        self._written -= part.counted
        self.queue.count_lost(part.counted)
        raise FileNotFoundError(
            2, f"the file that was being written has been removed, and {part.counted} entries with it"
        )

    def _end(self, now: float) -> None:
        """End the present part as a whole file."""
        part = self._part
        if part is None:
            return
        try:
            self._flush(part)
            part.writer.finish()
            if self._sync_period:
                part.file.sync()
            self._require_in_place(part)
        except OSError as error:
            self._give_up(RecorderState.FAULT, f"{part.path}: {error.strerror or error}", now)
        else:
            part.file.close()
            self._part = None
            self.report = replace(self.report, file_bytes=part.writer.size, entries=self._written)

    def _give_up(self, state: RecorderState, reason: str, now: float) -> None:
        """Leave the present part as it is on the disk, and try again later."""
        part, self._part = self._part, None
        if part is not None:
            part.file.close()
            self._count(part)
            self.queue.put_back([*part.writer.pending, *part.taken])
        self._retry_at = now + RETRY
        self.report = RecorderReport(state, reason, entries=self._written, free_bytes=self._free())

    def _free(self) -> int | None:
        try:
            return self._folder.free_bytes()
        except OSError:
            return None


class _Part:
    """The file that is being written."""

    def __init__(self, path: Path, file: OutputFile, writer: RecordingWriter, now: float) -> None:
        self.path = path
        self.file = file
        self.writer = writer
        self.taken: deque[Entry] = deque()
        self.counted = 0
        self.opened_at = now
        self.flush_at = now + FLUSH
        self.sync_at = now
        self.look_at = now + LOOK


_log = structlog.get_logger(__name__)
STALLED: Final = 3.0
"""A disk that has not answered within this time counts as failing [s]; an SD card takes up to a second."""
CLOSING: Final = 1.0
"""Longest time to write what is left at the end [s]; a disk that hangs must not keep the daemon alive."""


class RecorderThread:
    """Runs a recorder until it is stopped.

    Attributes:
        recorder: what it runs.
    """

    def __init__(self, recorder: Recorder) -> None:
        self.recorder = recorder
        self._stop = threading.Event()
        self._turn_at = time.monotonic()
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)

    def start(self) -> None:
        """Start to write."""
        self._thread.start()

    def stop(self, timeout: float = CLOSING) -> bool:
        """Write what is left and end the file; returns whether that was done in time.

        Args:
            timeout: longest wait [s].
        """
        self._stop.set()
        self._thread.join(timeout)
        return not self._thread.is_alive()

    @property
    def report(self) -> RecorderReport:
        """What the recorder does now; a disk that does not answer is a fault that it cannot report itself."""
        report, silence = self.recorder.report, time.monotonic() - self._turn_at
        if report.state is RecorderState.RECORDING and self._thread.is_alive() and silence > STALLED:
            reason = f"the disk has not answered for {silence:.0f} s"
            return replace(report, state=RecorderState.FAULT, reason=reason)
        return report

    @property
    def is_alive(self) -> bool:
        """Whether it runs."""
        return self._thread.is_alive()

    def _run(self) -> None:
        try:
            while not self._stop.is_set():
                self._turn_at = time.monotonic()
                self._stop.wait(self.recorder.step(self._turn_at))
            self.recorder.close(time.monotonic())
        except Exception as error:  # noqa: BLE001
            # A defect here ends the recording and no flight; what is put from now on is counted as lost.
            _log.exception("the recorder has ended")
            self.recorder.fail(f"the recorder has ended by {type(error).__name__}: {error}")
