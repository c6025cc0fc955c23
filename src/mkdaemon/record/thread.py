"""The thread that writes recordings."""

from __future__ import annotations

import threading
import time
from dataclasses import replace
from typing import Final

import structlog

from mkdaemon.record.recorder import Recorder, RecorderReport
from mkdaemon.telemetry.record import RecorderState

_log = structlog.get_logger(__name__)
STALLED: Final = 3.0
"""A disk that has not answered for so long counts as failing [s]; an SD card takes up to a second."""
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
