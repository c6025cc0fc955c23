"""Sources of poses, where the configuration has any: reports come in from the bus, and go on as a camera's poses do."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from functools import partial
from typing import Final, NamedTuple, Protocol

from mkdaemon.bus.codec import Payload, TooLate, check_command, decode_map
from mkdaemon.bus.intake import Taker, Verifier
from mkdaemon.clock import Clock
from mkdaemon.config.positions import PositionSource
from mkdaemon.control.core import FlightCore
from mkdaemon.control.events import EyeStats, Feed, PoseSeen, SightRefused
from mkdaemon.daemon.audit import Audit, Outlet
from mkdaemon.errors import CommandRejectedError
from mkdaemon.positions.positioneye import PositionEye
from mkdaemon.telemetry.position import PositionReport, report_key
from mkdaemon.telemetry.signature import Signature
from mkdaemon.telemetry.state import Attitude
from mkdaemon.telemetry.tone import Tone
from mkdaemon.telemetry.vision import EyeState, PoseRefusal, PoseRefused, VisionPose

LOOK: Final = 0.1
"""Between two looks at the state of a source [s]."""
PERIOD: Final = 1.0
"""It is published at least this often [s]."""


class ReportsBus(Protocol):
    """The bus as sources of poses need it."""

    def receive_reports(self, suffix: str, take: Taker, verify: Verifier, secret: str | None) -> None:
        """Hand the reports of a source to `take`; see `Bus.receive_reports`."""


class _Shown(NamedTuple):
    """State that was published last, and when [s]."""

    state: EyeState
    at: float


class PositionSources:
    """All sources of poses of the vehicle."""

    def __init__(
        self, sources: Sequence[PositionSource], core: FlightCore, feed: Feed, audit: Audit, bus: Outlet, clock: Clock
    ) -> None:
        """Prepare.

        Args:
            sources: sections of the configuration.
            core: says whether the aircraft is flown.
            feed: tells the flight core, before the bus hears of it.
            audit: hears of a new state of a source.
            bus: where values go.
            clock: stamps.
        """
        self._core, self._feed, self._audit, self._bus, self._clock = core, feed, audit, bus, clock
        self._eyes = {cfg.name: PositionEye(cfg) for cfg in sources}
        for eye in self._eyes.values():
            eye.compare_with(self._eyes.values())
        self._shown: dict[str, _Shown] = {}

    def receive_from(self, bus: ReportsBus) -> None:
        """Take reports from the bus.

        Raises:
            ConfigError: a secret cannot be read.
        """
        for name, eye in self._eyes.items():
            secret, suffix = eye.cfg.secret(), report_key(name)
            bus.receive_reports(suffix, partial(self.arrived, name), partial(clock_of, suffix, secret), secret)

    def attitude_received(self, attitude: Attitude) -> None:
        """Take how the boards report the vehicle to lie."""
        for eye in self._eyes.values():
            eye.attitude_received(attitude.stamp.monotonic, attitude.pitch, attitude.roll)

    def arrived(self, name: str, at: float, payload: Payload, signed_for: int | None) -> CommandRejectedError | None:
        """Take a report; see `Taker`. What is refused is counted, and shows in the state of the source."""
        eye, now = self._eyes[name], self._clock.now()
        if signed_for is None:
            eye.refused(PoseRefusal.UNSIGNED, now)
            return None
        try:
            report = check_command(PositionReport, decode_map(payload))
        except CommandRejectedError as error:
            eye.refused(PoseRefusal.LATE if isinstance(payload, TooLate) else PoseRefusal.MALFORMED, now)
            return error
        for suffix, value in eye.take(report, at, now, self._clock.stamp(now), is_flown=self._core.is_in_air):
            if "flight" not in eye.cfg.trusted_for:
                pass
            elif isinstance(value, VisionPose):
                self._feed(PoseSeen(value), now)
            elif isinstance(value, PoseRefused):
                self._feed(SightRefused(value), now)
            self._bus.publish(suffix, value)
        return None

    async def run(self) -> None:
        """Publish the state of each source for ever: once a second, and at once when it changes."""
        while True:
            now = self._clock.now()
            for name, eye in self._eyes.items():
                self._show(name, eye, now)
            await asyncio.sleep(LOOK)

    def _show(self, name: str, eye: PositionEye, now: float) -> None:
        stats, shown = eye.stats(now, self._clock.stamp(now)), self._shown.get(name)
        is_new = shown is None or shown.state is not stats.state
        if shown is not None and not is_new and now - shown.at < PERIOD - LOOK / 2.0:
            return
        self._shown[name] = _Shown(stats.state, now)
        if "flight" in eye.cfg.trusted_for:
            self._feed(EyeStats(stats), now)
        self._bus.publish(f"vision/{name}/stats", stats)
        if is_new:
            level = "info" if stats.state.tone is Tone.OK else "warning"
            self._audit.log(level, f"source {name}: {stats.state.words}{stats.reason and f': {stats.reason}'}")


def clock_of(suffix: str, secret: str | None, payload: Payload, proof: bytes) -> int | None:
    """Epoch of a report, which names the clock of its stamp; None where the owner of the secret did not sign it.

    Args:
        suffix: key without `mk/<vehicle>/`.
        secret: of the source; None: any program may report.
        payload: as it came.
        proof: its signature.
    """
    if not isinstance(payload, bytes) or (secret is not None and not Signature(suffix, payload, proof).is_by(secret)):
        return None
    try:
        epoch = decode_map(payload).get("epoch")
    except CommandRejectedError:
        return 0
    return epoch if isinstance(epoch, int) else 0
