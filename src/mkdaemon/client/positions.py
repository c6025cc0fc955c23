"""Reports of a source of poses, signed and put: what any program needs that knows where a vehicle is."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from mkdaemon.bus.codec import encode, encoding_of
from mkdaemon.bus.names import key
from mkdaemon.client.transport import Transport
from mkdaemon.telemetry.position import PositionHealth, PositionReport, report_key
from mkdaemon.telemetry.signature import private_key, stamped_proof

if TYPE_CHECKING:
    from mkdaemon.client.transport import SetpointPublisher


class PositionSender:
    """Puts the reports of one source.

    Attributes:
        sequence: number of the last report.
    """

    def __init__(
        self,
        transport: Transport,
        name: str,
        secret: str | None,
        *,
        clock: Callable[[], float] = time.monotonic,
        epoch: int | None = None,
    ) -> None:
        """Make a publisher.

        Args:
            transport: a client of the daemon.
            name: of the source, as `[[positions]]` has it.
            secret: of the source; None where its section has no `secret_file`.
            clock: of the stamps [s]; it is never set.
            epoch: number of this start, larger than that of the last; Unix time [ms] if None.
        """
        self._suffix, self._secret, self._clock = report_key(name), secret, clock
        self._epoch = int(time.time() * 1000) if epoch is None else epoch
        self._encoding = encoding_of(PositionReport)
        whole = key(transport.vehicle, self._suffix)
        place = whole if secret is None else private_key(secret, whole)
        self._reports: SetpointPublisher = transport.stream(place.removeprefix(key(transport.vehicle, "")))
        self._health: SetpointPublisher = transport.stream(f"positions/{name}/health")
        self.sequence = 0

    def send(
        self,
        position: Sequence[float],
        quaternion: Sequence[float],
        *,
        age: float = 0.0,
        covariance: Sequence[float] | None = None,
    ) -> None:
        """Put a measurement; never one a second time.

        Args:
            position: of the tracked body in the frame of the source (3,) [m].
            quaternion: its attitude there (w, x, y, z).
            age: of the measurement, as far as it is known [s].
            covariance: `(6, 6)` by rows, see `PositionReport`; None for the configured one.

        Raises:
            ValidationError: it is no pose.
        """
        self.sequence += 1
        report = PositionReport(
            epoch=self._epoch,
            sequence=self.sequence,
            age=age,
            position=tuple(map(float, position)),
            quaternion=tuple(map(float, quaternion)),
            covariance=None if covariance is None else tuple(map(float, covariance)),
        )
        payload = encode(report)
        proof = stamped_proof(self._secret or "", self._suffix, payload, self._clock())
        self._reports.put(payload, encoding=self._encoding, attachment=proof)

    def publish_health(self, health: PositionHealth) -> None:
        """Put what the sender says of itself."""
        self._health.put(encode(health), encoding=encoding_of(PositionHealth))
