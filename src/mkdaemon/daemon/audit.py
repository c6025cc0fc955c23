"""The audit trail: every request with its client, the decision and its reason. Every command is published."""

from __future__ import annotations

from typing import Any, Final, Protocol

import structlog
from pydantic import BaseModel

from mkdaemon.clock import Clock, ClockStep
from mkdaemon.control.actions import Report, ReportCommand, ReportFailsafe, ReportMode
from mkdaemon.telemetry.command import CommandResult
from mkdaemon.telemetry.event import ClockEvent, CommandEvent, FailsafeEvent, LogEvent, ModeEvent
from mkdaemon.telemetry.record import MarkEvent

_log = structlog.get_logger("mkdaemon")
_SHOWN: Final = 16
"""Longest list or string shown in the log; the event carries everything."""


class Outlet(Protocol):
    """Publisher of values: `mkdaemon.bus.gateway.Bus` in the daemon."""

    def publish(self, suffix: str, value: BaseModel, *, schema: type[BaseModel] | None = None) -> None:
        """Put a value under a key; see `Bus.publish`."""


class Audit:
    """Publishes events, and writes them to the log."""

    def __init__(self, bus: Outlet, clock: Clock) -> None:
        self._bus = bus
        self._clock = clock

    def report(self, report: Report, at: float) -> None:
        """Publish a report of the flight core at a time [s; monotonic]."""
        match report:
            case ReportCommand():
                self.command(report.key, report.fields, report.result, at)
            case ReportMode():
                self.mode(report.before.value, report.after.value, report.reason, at)
            case ReportFailsafe():
                self.failsafe(report.action, report.reason, report.released, at)
            case _:
                self.log("warning", report.text)

    def command(self, key: str, fields: dict[str, Any], result: CommandResult, at: float | None = None) -> None:
        """A command and its end; the secret of a lease stays one."""
        fields = {**fields, "secret": "..."} if "secret" in fields else fields
        event = CommandEvent(
            stamp=self._clock.stamp(at),
            key=key,
            fields=fields,
            status=result.status.value,
            token=result.token,
            reason=result.reason,
            fix=result.fix,
            duration=result.duration,
        )
        self._bus.publish("event/command", event)
        shown = {name: value for name, value in fields.items() if len(str(value)) <= _SHOWN}
        _log.info("command", key=key, status=event.status, token=event.token, reason=event.reason, fields=shown)

    def mode(self, before: str, after: str, reason: str, at: float) -> None:
        """Authority moved from one phase to another."""
        self._bus.publish(
            "event/mode", ModeEvent(stamp=self._clock.stamp(at), before=before, after=after, reason=reason)
        )
        _log.info("mode", before=before, after=after, reason=reason)

    def failsafe(self, action: str, reason: str, released: bool | None = None, at: float | None = None) -> None:
        """The daemon acted on its own."""
        event = FailsafeEvent(stamp=self._clock.stamp(at), action=action, reason=reason, released=released)
        self._bus.publish("event/failsafe", event)
        _log.warning("failsafe", action=action, reason=reason, released=released)

    def mark(self, text: str, holder: str) -> None:
        """A client marked this moment."""
        self._bus.publish("event/mark", MarkEvent(stamp=self._clock.stamp(), text=text, holder=holder))
        _log.info("mark", text=text, holder=holder)

    def clock_stepped(self, step: ClockStep) -> None:
        """The system clock was set; stamps follow it from now on."""
        event = ClockEvent(stamp=self._clock.stamp(step.at), step=step.step, suspended=step.suspended)
        self._bus.publish("event/clock", event)
        _log.warning("system clock was set", step=round(step.step, 3), suspended=round(step.suspended, 3))

    def log(self, level: str, text: str) -> None:
        """Something worth a line: info, warning or error."""
        self._bus.publish("event/log", LogEvent(stamp=self._clock.stamp(), level=level, text=text))
        getattr(_log, level)(text)
