"""Reports to the guard: the port, the frames, and the release of the aircraft.

The guard is a separate process (`mkdaemon.guard`); this module only reports to it, from the place where bytes are
written, so that its heartbeat is the control path itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from mkdaemon.link.ports.port import Port
from mkdaemon.link.session import release
from mkdaemon.link.session.scheduler import QueuedTransmission
from mkdaemon.link.session.steering import ControlEntry, Steering
from mkdaemon.link.session.traffic import UNNUMBERED, Purpose
from mkdaemon.protocol.wire import WireMessage


class LineGuard(Protocol):
    """Receiver of one line's reports; `mkdaemon.daemon.guard.GuardProcess` in the daemon."""

    def port_opened(self, descriptor: int) -> None:
        """Take the descriptor of the open port."""

    def port_closed(self) -> None:
        """Close the port."""

    def frames_changed(self, release: Sequence[bytes]) -> None:
        """Take the encoded release frames of this aircraft."""

    def frame_written(self, neutral: bytes) -> None:
        """A frame that moves or releases the aircraft was written; `neutral` is the frame for level sticks."""

    def released(self) -> None:
        """Nothing is owed."""


class GuardFeed:
    """Reports stick frames of one line to the guard, and nothing before the first one."""

    def __init__(self, guard: LineGuard | None) -> None:
        self._guard = guard
        self._is_armed = False

    def port_opened(self, port: Port) -> None:
        """A port is open."""
        if self._guard is not None and port.descriptor is not None:
            self._guard.port_opened(port.descriptor)

    def port_lost(self) -> None:
        """The port is gone, and what was owed with it."""
        if self._guard is not None:
            self._guard.port_closed()
        self._disarm()

    def port_given_up(self) -> None:
        """We close the port; an aircraft that is not released yet is left to the guard and its duplicate."""
        if not self._is_armed:
            self.port_lost()

    def dialect_changed(self, layout: type[WireMessage] | None) -> None:
        """The aircraft takes another layout of external control, or it is known for the first time."""
        if self._guard is not None:
            self._guard.frames_changed([message.to_frame() for message in release.shortest_release(layout)])

    def written(self, entry: QueuedTransmission) -> None:
        """A frame was written."""
        if self._guard is None or not isinstance(entry, ControlEntry) or entry.message is None:
            return
        if entry.purpose is Purpose.SETPOINT:
            self._is_armed = True
            self._guard.frame_written(release.neutral_of(entry.message, UNNUMBERED).to_frame())
        elif self._is_armed:
            self._guard.frame_written(entry.raw)

    def settle(self, steering: Steering) -> None:
        """Disarm when the release has ended."""
        if self._is_armed and not steering.is_releasing and steering.control.last_command is None:
            self._disarm()

    def _disarm(self) -> None:
        if self._guard is not None and self._is_armed:
            self._guard.released()
        self._is_armed = False
