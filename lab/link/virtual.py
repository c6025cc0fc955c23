"""The cases of `python -m lab link` in virtual time: exact, seeded, undisturbed by whatever else this machine does."""

from __future__ import annotations

import asyncio
from bisect import bisect_left
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any, Final

from lab.link.cases import Case
from lab.link.sim import Witness
from lab.rigs.boardport import TICK_TIME
from lab.rigs.linkrig import rig
from lab.rigs.sticks import build_sticks
from mkdaemon.config.link import LinkConfig
from mkdaemon.errors import ConfigError
from mkdaemon.link.link import Link
from mkdaemon.link.session.evidence import percentile
from mkdaemon.link.session.traffic import Lost, Purpose, Received, Sent, SetpointQueued
from mkdaemon.telemetry.link import LinkHealth, LinkState, LinkTraffic, RoundTripStats
from mkdaemon.virtualtime import run_virtually
from mksim.config import PilotPlan, SimConfig


class Waits:
    """A sink that notes how long setpoints waited for the line.

    Attributes:
        handed_in: times at which they were handed in, in order [s].
        left: times at which one left, in order [s].
    """

    def __init__(self) -> None:
        self.handed_in: list[float] = []
        self.left: list[float] = []

    @property
    def waits(self) -> list[float]:
        """Time until each one, or a newer one that replaced it, had left [s], ascending."""
        places = ((at, bisect_left(self.left, at)) for at in self.handed_in)
        return sorted(self.left[place] - at for at, place in places if place < len(self.left))

    @property
    def replaced(self) -> float | None:
        """Share of those that a newer one replaced [0..1]; None where none was handed in."""
        handed_in = len(self.handed_in)
        return round(1.0 - len(self.left) / handed_in, 5) if handed_in else None

    def received(self, frame: Received) -> None:
        """Not of interest."""

    def sent(self, frame: Sent) -> None:
        """Note the wait of a setpoint."""
        if frame.purpose is Purpose.SETPOINT:
            self.left.append(frame.at)

    def dropped(self, loss: Lost) -> None:
        """Not of interest."""

    def state_changed(self, state: LinkState) -> None:
        """Not of interest."""

    def health_measured(self, health: LinkHealth) -> None:
        """Asked at the end."""

    def stream_ended(self, key: str) -> None:
        """Nothing is kept of it."""

    def traffic_counted(self, traffic: LinkTraffic) -> None:
        """Not of interest."""


FASTEST_SPACED: Final = 60.0
"""More stick frames a second do not keep the gap that a FlightCtrl needs in flight [Hz]."""


def configurations(case: Case) -> tuple[SimConfig, dict[str, Any]]:
    """The simulator of a case, and the link's options."""
    sim = SimConfig.model_validate({"pilot_plan": PilotPlan.NOTHING, "calibrated": True, "connect": (), **case.sim})
    options = {"rates": case.streams, "echo_hz": case.echo_hz, "window": 120.0}
    if case.setpoint_hz:
        options["setpoint_hz"] = max(case.setpoint_hz, LinkConfig().setpoint_hz)
    if case.setpoint_hz > FASTEST_SPACED:
        options["gap_ms"] = 5.0  # at rest nothing is lost so; the experiment of 2010 asks for that rate
    return sim, options


def play(case: Case, seconds: float) -> dict[str, Any]:
    """Play one case and return its exact figures."""
    return run_virtually(_play(case, seconds))


@asynccontextmanager
async def running_link(case: Case, witness: Witness, options: dict[str, Any], sink: Waits) -> AsyncIterator[Link]:
    """A link that runs and knows the boards of a case, in the time of the running loop."""
    async with rig(lambda: witness, seed=0, sink=sink, tick=TICK_TIME, **options) as running:
        await asyncio.sleep(case.settle)
        await until_steerable(running.link, case)
        yield running.link


async def _play(case: Case, seconds: float) -> dict[str, Any]:
    sim, options = configurations(case)
    witness, sink = Witness(sim), Waits()
    async with running_link(case, witness, options, sink) as link:
        before, came, delivered = link.health(), witness.came["b"], witness.delivered["b"]
        await steer_steadily(link, case, seconds, sink.handed_in)
        await asyncio.sleep(0.4)
        after, came, delivered = link.health(), witness.came["b"] - came, witness.delivered["b"] - delivered
    channels = witness.channels()
    return {
        "exact_echo_loss": loss_between(before.echo, after.echo),
        "exact_control_loss": loss_between(before.confirm, after.confirm),
        "exact_control_undelivered": undelivered(came, delivered),
        "exact_confirms_replaced": after.stick_frames.replaced - before.stick_frames.replaced,
        "exact_echo_p50_ms": after.echo.p50_ms,
        "exact_echo_p99_ms": after.echo.p99_ms,
        "exact_setpoint_wait_p50_ms": wait_ms(sink.waits, 0.50),
        "exact_setpoint_wait_p99_ms": wait_ms(sink.waits, 0.99),
        "exact_setpoints_replaced": sink.replaced,
        "exact_radio_loss": radio_loss([c.packets for c in channels], [c.packets_lost for c in channels]),
    }


async def steer_steadily(link: Link, case: Case, seconds: float, handed_in: list[float]) -> int:
    """Hand in the setpoints of a case for a time [s], or wait where it has none; notes when, returns how many."""
    loop = asyncio.get_running_loop()
    began, steps = loop.time(), int(case.setpoint_hz * seconds)
    layout = link.dialect.extern_control
    for step in range(steps):
        assert layout is not None
        await asyncio.sleep(max(0.0, began + step / case.setpoint_hz - loop.time()))
        handed_in.append(loop.time())
        setpoint = build_sticks(layout, pitch=step % 21 - 10)
        fate = link.send_setpoint(setpoint, deadline=loop.time() + 0.1)
        assert isinstance(fate, SetpointQueued)
    await asyncio.sleep(began + seconds - loop.time())
    return steps


async def until_steerable(link: Link, case: Case) -> None:
    """Wait until the FlightCtrl's release is known, where the case steers.

    Raises:
        ConfigError: it stays unknown.
    """
    for _ in range(100):
        if not case.setpoint_hz or link.dialect.extern_control is not None:
            return
        await asyncio.sleep(0.05)
    raise ConfigError(f"the simulator's FlightCtrl was not recognised: {link.dialect.read_only_reason}")


def loss_between(before: RoundTripStats, after: RoundTripStats) -> float | None:
    """Share lost of what was sent between two measurements; None where nothing was."""
    sent = after.sent_total - before.sent_total
    return round((after.lost_total - before.lost_total) / sent, 5) if sent else None


def undelivered(sent: int, arrived: int) -> float | None:
    """Share of frames that did not reach the board; None where none were sent."""
    return round(1 - arrived / sent, 5) if sent else None


def wait_ms(waits: list[float], share: float) -> float | None:
    """A percentile of ascending times [ms]."""
    found = percentile(waits, share)
    return None if found is None else round(1000 * found, 3)


def radio_loss(packets: list[int], lost: list[int]) -> float:
    """Share of conversations the radio took: there, or back."""
    kept = 1.0
    for sent, gone in zip(packets, lost, strict=True):
        kept *= 1 - gone / sent if sent else 1.0
    return round(1 - kept, 5)
