"""Recorded teleop sessions: what devices said and what was decided, one JSON object a line; written and read."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, Literal, TextIO

from pydantic import BaseModel, ConfigDict, ValidationError

from mkdaemon.cli.mkctl.teleop.devices import Device, DeviceState
from mkdaemon.client.teleop.inputs import AxisRange, PadFacts
from mkdaemon.client.teleop.teleop import TeleopOutput
from mkdaemon.config.gamepad import Gamepad
from mkdaemon.errors import ConfigError
from mkdaemon.foreignfiles import read_text

LONGEST: Final = 200_000_000
"""Longest recording that is read [bytes]; an hour is about 30 million."""


class RecordedFacts(BaseModel):
    """What a device said about itself."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    ranges: dict[str, tuple[float, float]]
    buttons: tuple[str, ...]
    wireless: bool

    def read(self) -> PadFacts:
        """Return it as the teleop knows it."""
        ranges = {name: AxisRange(low, high) for name, (low, high) in self.ranges.items()}
        return PadFacts(self.name, ranges, frozenset(self.buttons), is_wireless=self.wireless)


class PadLine(BaseModel):
    """One line of a recording; which fields it has depends on `event`."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    t: float
    """When it happened, since the start [s]."""
    event: Literal["start", "attach", "state", "report", "lost", "output"]
    """What happened."""
    version: int = 1
    """Of the format."""
    device: str = ""
    """Which device."""
    facts: RecordedFacts | None = None
    """What it says about itself; `attach`."""
    mapping: Gamepad | None = None
    """Its mapping; `attach`."""
    at: float = 0.0
    """When the values were true, since the start [s]; `state`."""
    values: dict[str, float] = {}
    """Values that have changed since the state before; `state`."""
    control: str = ""
    """What changed; `report`."""
    raw: float = 0.0
    """To what; `report`."""
    reason: str = ""
    """Why; `lost`, `output`."""
    setpoint: dict[str, Any] | None = None
    """What was streamed; `output`."""


class PadRecorder:
    """Writes a recording.

    Args:
        file: where to; every line is flushed.
        now: when the recording begins [s].
    """

    def __init__(self, file: TextIO, now: float) -> None:
        self._file, self._began = file, now
        self._states: dict[str, Mapping[str, float]] = {}
        self._setpoint: object = None
        self._write(now, "start", version=1)

    def attached(self, device: Device, pad: Gamepad, now: float) -> None:
        """Note a device that came."""
        facts = device.facts
        ranges = {name: (span.low, span.high) for name, span in facts.ranges.items()}
        shown = {"name": facts.name, "ranges": ranges, "buttons": sorted(facts.buttons), "wireless": facts.is_wireless}
        self._states[device.name] = {}
        self._write(now, "attach", device=device.name, facts=shown, mapping=pad.model_dump(mode="json"))

    def asked(self, name: str, state: DeviceState, now: float) -> None:
        """Note what a device answered."""
        before = self._states.get(name, {})
        changed = {control: value for control, value in state.values.items() if before.get(control) != value}
        self._states[name] = dict(state.values)
        self._write(now, "state", device=name, at=round(state.at - self._began, 6), values=changed)

    def reported(self, name: str, control: str, raw: float, now: float) -> None:
        """Note what a device reported."""
        self._write(now, "report", device=name, control=control, raw=raw)

    def lost(self, name: str, reason: str, now: float) -> None:
        """Note that a device went."""
        self._write(now, "lost", device=name, reason=reason)

    def decided(self, output: TeleopOutput, now: float) -> None:
        """Note what was decided, where it is another thing than before."""
        wanted = output.setpoint
        shown = None if wanted is None else {"kind": wanted.kind, **wanted.fields}
        if (shown, output.reason) != self._setpoint:
            self._setpoint = (shown, output.reason)
            self._write(now, "output", reason=output.reason, setpoint=shown)

    def _write(self, now: float, event: str, **fields: Any) -> None:
        line = {"t": round(now - self._began, 6), "event": event, **fields}
        self._file.write(json.dumps(line, separators=(",", ":")) + "\n")
        self._file.flush()


def read_recording(path: Path) -> list[PadLine]:
    """Read a recording; a last line that was cut short is left out.

    Raises:
        ConfigError: it cannot be read, or is none; names file, line and what is wrong.
    """
    try:
        texts = read_text(path, limit=LONGEST).splitlines(keepends=True)
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise ConfigError(f"{path}: cannot be read: {reason}") from error
    if texts and not texts[-1].endswith("\n"):
        texts.pop()
    lines = [_read_line(path, number, text) for number, text in enumerate(texts, 1)]
    if not lines or lines[0].event != "start" or lines[0].version != 1:
        raise ConfigError(f"{path}: no recording of `mkctl teleop --record`, or of another version")
    backwards = next((n for n in range(1, len(lines)) if lines[n].t < lines[n - 1].t), None)
    if backwards is not None:
        raise ConfigError(f"{path}:{backwards + 1}: time goes backwards")
    return lines


def _read_line(path: Path, number: int, text: str) -> PadLine:
    try:
        line = PadLine.model_validate_json(text)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        raise ConfigError(f"{path}:{number}: {place + ': ' if place else ''}{first['msg']}") from error
    if line.event == "attach" and (line.facts is None or line.mapping is None):
        raise ConfigError(f"{path}:{number}: a device without facts and mapping")
    return line
