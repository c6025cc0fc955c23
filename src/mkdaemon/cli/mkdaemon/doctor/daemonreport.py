"""What a running daemon and the routers on the way to it tell the doctor: asked once, as any client can."""

from __future__ import annotations

import asyncio
import json
import os
import time
from collections.abc import Mapping, Sequence
from contextlib import AsyncExitStack, suppress
from pathlib import Path
from typing import Any, Final, NamedTuple

import zenoh

from mkdaemon.client import Vehicle, connect
from mkdaemon.config.root import Config
from mkdaemon.errors import MkError
from mkdaemon.telemetry.preflight import Blocks

ASKED: Final = ("health", "link/state", "record/status", "vision/*/stats")
"""Keys that the checks look at."""
ROUTERS: Final = "@/*/router"
"""Where Zenoh routers describe themselves, their version among it."""
_CERTIFIED: Final = ("tls/", "quic/")
PATIENCE: Final = 2.0
"""Longest wait for an answer [s]."""


class DaemonReport(NamedTuple):
    """What was told.

    Attributes:
        endpoint: where somebody was asked; empty where nobody could be.
        failure: why nobody answered there; empty where somebody did.
        values: last values of the daemon by key.
        standing: findings of its preflight that stand, by token: name, reason and fix.
        daemons: how many speak for this vehicle.
        routers: Zenoh versions of the routers.
        between: when it was asked and had answered, by this machine's clock [s; Unix time].
    """

    endpoint: str = ""
    failure: str = ""
    values: Mapping[str, Mapping[str, Any]] = {}
    standing: Mapping[str, tuple[str, str, str]] = {}
    daemons: int = 0
    routers: tuple[str, ...] = ()
    between: tuple[float, float] = (0.0, 0.0)

    def under(self, prefix: str) -> list[Mapping[str, Any]]:
        """Values of the keys that begin so."""
        return [value for key, value in sorted(self.values.items()) if key.startswith(prefix)]


NOBODY: Final = DaemonReport()


def client_endpoint(endpoint: str) -> str:
    """Where a client of this machine meets who listens there."""
    for everywhere in ("0.0.0.0:", "[::]:"):
        endpoint = endpoint.replace(f"/{everywhere}", "/localhost:")
    return endpoint


def ask_daemon(cfg: Config, endpoints: Sequence[str]) -> DaemonReport:
    """Ask the daemon of a vehicle about itself.

    Args:
        cfg: names the vehicle.
        endpoints: where to ask, in this order; the first that answers counts. Where a certificate is needed, nobody is
            asked without one (`MK_ZENOH_FILE`).
    """
    report = NOBODY
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
            opening = connect(cfg.vehicle.name, endpoint, zenoh_file=file)
            uav = await stack.enter_async_context(opening)
            asked_at = time.time()
            found = await asyncio.gather(*(uav.get_past(key, 0.0) for key in ASKED))
            between = asked_at, time.time()
            samples = [sample for answers in found for sample in answers]
            values = {sample.suffix: sample.fields for sample in samples}
            daemons = sum(sample.suffix == "health" for sample in samples)
            standing = await _standing(uav) if values else {}
            routers = await asyncio.to_thread(_routers, uav.session)
            return DaemonReport(endpoint, "", values, standing, daemons, routers, between)
    except MkError as error:
        return DaemonReport(endpoint, str(error))


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
