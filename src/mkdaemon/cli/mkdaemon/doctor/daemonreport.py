"""What a running daemon and the routers on the way to it tell the doctor: asked once, as any client can."""

from __future__ import annotations

import asyncio
import json
import os
import time
from collections.abc import Mapping, Sequence
from contextlib import AsyncExitStack, suppress
from pathlib import Path
from typing import Final, NamedTuple, TypeVar

import zenoh

from mkdaemon.client import Vehicle, connect
from mkdaemon.client.samples import Sample
from mkdaemon.config.root import Config
from mkdaemon.errors import MkError
from mkdaemon.telemetry.base import Telemetry
from mkdaemon.telemetry.link import LinkState
from mkdaemon.telemetry.preflight import Blocks
from mkdaemon.telemetry.record import RecordStatus
from mkdaemon.telemetry.vehicle import VehicleHealth
from mkdaemon.telemetry.vision import VisionStats

_Value = TypeVar("_Value", bound=Telemetry)

ASKED: Final = ("health", "link/state", "record/status", "vision/*/stats")
"""Keys that the checks look at."""
ROUTERS: Final = "@/*/router"
"""Where Zenoh routers describe themselves, their version among it."""
_CERTIFIED: Final = ("tls/", "quic/")
PATIENCE: Final = 2.0
"""Longest wait for an answer [s]."""


class DaemonReport(NamedTuple):
    """Answer of a daemon, without values that it did not send or that this release cannot read.

    Attributes:
        endpoint: where the query went; empty if there was none.
        failure: why no answer came; empty if one came.
        clock: its clock when it answered [s; Unix time].
        between: when it was asked and had answered, by this machine's clock [s; Unix time].
        line: state of the serial line.
        recorder: what its recorder does.
        eyes: of each camera.
        standing: findings of its preflight that stand, by token: name, reason and fix.
        daemons: how many speak for this vehicle.
        routers: Zenoh versions of the routers.
    """

    endpoint: str = ""
    failure: str = ""
    clock: float | None = None
    between: tuple[float, float] = (0.0, 0.0)
    line: LinkState | None = None
    recorder: RecordStatus | None = None
    eyes: tuple[VisionStats, ...] = ()
    standing: Mapping[str, tuple[str, str, str]] = {}
    daemons: int = 0
    routers: tuple[str, ...] = ()


NO_DAEMON: Final = DaemonReport()


def client_endpoint(endpoint: str) -> str:
    """Where a client of this machine meets who listens there."""
    for everywhere in ("0.0.0.0:", "[::]:"):
        endpoint = endpoint.replace(f"/{everywhere}", "/localhost:")
    return endpoint


def ask_daemon(cfg: Config, endpoints: Sequence[str]) -> DaemonReport:
    """Ask the daemon of a vehicle about itself.

    Args:
        cfg: names the vehicle.
        endpoints: where to ask, in this order; the first that answers counts. If a certificate is needed, there is no
            query without one (`MK_ZENOH_FILE`).
    """
    report = NO_DAEMON
    file = os.environ.get("MK_ZENOH_FILE")
    for endpoint in endpoints:
        if endpoint.startswith(_CERTIFIED) and not file:
            continue
        report = asyncio.run(_ask(cfg, client_endpoint(endpoint), Path(file) if file else None))
        if not report.failure:
            break
    return report


async def _ask(cfg: Config, endpoint: str, file: Path | None) -> DaemonReport:
    try:
        async with AsyncExitStack() as stack:
            uav = await stack.enter_async_context(connect(cfg.vehicle.name, endpoint, zenoh_file=file))
            asked_at = time.time()
            found = await asyncio.gather(*(uav.get_past(key, 0.0) for key in ASKED))
            between = asked_at, time.time()
            report = _read([sample for samples in found for sample in samples])
            standing = await _standing(uav) if report.daemons else {}
            routers = await asyncio.to_thread(_routers, uav.session)
            return report._replace(endpoint=endpoint, between=between, standing=standing, routers=routers)
    except MkError as error:
        return DaemonReport(endpoint, str(error))


def _read(samples: Sequence[Sample]) -> DaemonReport:
    """What the last values of a daemon say; one that this release cannot read says nothing."""

    def of(kind: type[_Value]) -> list[_Value]:
        return [value for sample in samples if isinstance(value := sample.known, kind)]

    clocks = (
        health.stamp.wall + sample.age
        for sample in samples
        if isinstance(health := sample.known, VehicleHealth) and sample.age is not None
    )
    return DaemonReport(
        clock=next(clocks, None),
        line=next(iter(of(LinkState)), None),
        recorder=next(iter(of(RecordStatus)), None),
        eyes=tuple(of(VisionStats)),
        daemons=sum(sample.suffix == "health" for sample in samples),
    )


async def _standing(uav: Vehicle) -> dict[str, tuple[str, str, str]]:
    """What its preflight finds; nothing where it may not be asked."""
    with suppress(MkError):
        report = await uav.preflight()
        return {
            finding.token: (finding.name, finding.reason, finding.fix)
            for finding in report.findings
            if finding.token is not None and finding.blocks is not Blocks.NOTHING
        }
    return {}


def _routers(session: zenoh.Session) -> tuple[str, ...]:
    """Versions of the routers that say something of themselves."""
    found = []
    for reply in session.get(ROUTERS, timeout=PATIENCE):
        if reply.ok is not None:
            with suppress(ValueError, AttributeError):
                found.append(str(json.loads(reply.ok.payload.to_bytes()).get("version", "")))
    return tuple(filter(None, found))
