"""Measures a line under load: sets streams, streams neutral sticks where asked, and puts everything back.

Only on the ground: it is refused while motors run, and ends when they start. What is measured is what the daemon itself
published about its frames; nothing here adds to a round trip.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Final

from mkdaemon.client.linktest.measures import LoadRun
from mkdaemon.client.linktest.probes import PATTERNS, TIMEOUT, Ledger
from mkdaemon.client.samples import Sample
from mkdaemon.client.taskerrors import beside
from mkdaemon.errors import CommandRejectedError, MkError
from mkdaemon.telemetry.link import Fates

if TYPE_CHECKING:
    from mkdaemon.client.vehicle import Vehicle
    from mkdaemon.telemetry.link import LinkHealth

LIGHT: Final = "light"
FULL: Final = "full"
CHOSEN: Final = "chosen"
STREAMS: Final[dict[str, dict[str, dict[str, float]]]] = {
    "nc": {LIGHT: {"osd": 0.5}, FULL: {"osd": 0.1, "debug": 0.2, "attitude": 0.05}},
    "fc": {LIGHT: {"debug": 0.5}, FULL: {"debug": 0.2, "attitude": 0.05}},
}
"""Intervals of the streams of the experiments of 2010, by the board at the end of the line [s]; docs/link.md."""
WITNESS: Final = {"nc": ("osd", 0.5), "fc": ("debug", 0.5)}
"""The stream that says whether motors run, and its slowest interval [s]."""
SETTLING: Final = 1.0
"""Time for which streams run before the measurement [s]."""
BEAT: Final = 0.25
"""Longest period of `link/health` from a daemon that runs [s]: 5 Hz, and what a busy loop costs."""
LOOKING: Final = 0.2
"""Between two looks at the clock [s]."""
LOWEST: Final = -100.0
"""Throttle of the stick frames [stick from the centre]: the lowest that the limiter lets through by default."""
FOREIGN_TOKEN: Final = 0x8000
"""Patterns of our link tests count from here; the daemon's begin at 1."""
_EXTRA: Final = ("link/health", "link/traffic", "health")


@dataclass(frozen=True, slots=True)
class Load:
    """What the line carries while it is measured.

    Attributes:
        name: `light`, `full` or `chosen`.
        streams: interval of each stream [s]; all others are off.
        control_hz: stick setpoints a second [Hz]; 0 for none. They are neutral, at the lowest throttle; the daemon
            repeats them at its own rate where that is higher.
    """

    name: str
    streams: dict[str, float]
    control_hz: float = 0.0


@dataclass(frozen=True, slots=True)
class LinkTestPlan:
    """What is to be measured.

    Attributes:
        label: whose line, for tables and pictures.
        loads: names of loads, or one of chosen streams.
        streams: of the load `chosen` [s].
        control_hz: stick setpoints a second under full or chosen load [Hz]; see `Load`.
        seconds: of each load [s].
        tests_hz: link tests beside the daemon's own [Hz].
        motors_off: the user has checked that the motors stand still, so no measurement of it is needed.
    """

    label: str
    loads: tuple[str, ...] = (LIGHT, FULL)
    streams: dict[str, float] = field(default_factory=dict)
    control_hz: float = 0.0
    seconds: float = 60.0
    tests_hz: float = 0.0
    motors_off: bool = False


@dataclass(frozen=True, slots=True)
class LinkTestProgress:
    """How far a measurement is.

    Attributes:
        load: name of the load that is measured.
        done: loads that are done.
        of: all of them.
        elapsed: of the present one [s].
        sent: probes of it whose fate is known.
        lost: of these, lost.
    """

    load: str
    done: int
    of: int
    elapsed: float
    sent: int
    lost: int


@dataclass(frozen=True, slots=True)
class LinkTestFound:
    """What was measured.

    Attributes:
        runs: one for each load that was measured, the last one perhaps for a shorter time.
        ended_by: why it ended early, a sentence; empty where everything was measured.
    """

    runs: tuple[LoadRun, ...]
    ended_by: str = ""


OnLinkTest = Callable[[LinkTestProgress], None]


async def run_link_test(
    uav: Vehicle, plan: LinkTestPlan, *, on_progress: OnLinkTest | None = None, stop: asyncio.Event | None = None
) -> LinkTestFound:
    """Measure the line under every load, then put its streams back as they were.

    Args:
        uav: the vehicle; motors off.
        plan: what is measured.
        on_progress: called a few times a second.
        stop: ends the measurement in order; what was measured is returned.

    Returns:
        What was measured; a load that fails after others ends it with its reason.

    Raises:
        MkError: motors run, or nothing says that they do not; no daemon.
        CommandRejectedError: the line cannot carry a stream, or the lease for stick frames is refused.
        LeaseLostError: the lease was lost while stick frames were streamed.
    """
    await _require_still(uav, plan)
    stop = stop or asyncio.Event()
    board = await _board(uav)
    loads = _loads(plan, board)
    runs: list[LoadRun] = []
    ended_by = ""
    async with _streams_restored(uav):
        for number, load in enumerate(loads):
            await _set_streams(uav, load.streams)

            def report(elapsed: float, ledger: Ledger, load: Load = load, number: int = number) -> None:
                if on_progress is not None:
                    on_progress(LinkTestProgress(load.name, number, len(loads), elapsed, *ledger.counts()))

            try:
                runs.append(await _measure(uav, plan, load, board, report, stop))
            except MkError as error:
                if not runs:
                    raise
                ended_by = f"{load.name} load: {error}"
                break
            if stop.is_set():
                ended_by = "asked to"
                break
    return LinkTestFound(tuple(runs), ended_by)


async def _require_still(uav: Vehicle, plan: LinkTestPlan) -> None:
    """Refuse while motors run.

    Raises:
        MkError: they do, or nothing says that they do not.
    """
    known = await uav.health.latest()
    if known is None:
        raise MkError(await uav.absence() or f"vehicle {uav.vehicle} has not reported yet whether it is alive")
    if known.value.motors_running:
        raise MkError("motors run: the line is measured on the ground only, motors off")
    if known.value.motors_running is None and not plan.motors_off:
        raise MkError(
            "no stream shows whether the motors run: request one (`mkctl board rates osd 500ms`; debug where "
            "there is no NaviCtrl), or check them and give --motors-off"
        )


async def _board(uav: Vehicle) -> str:
    """The board at the end of the line.

    Raises:
        MkError: none has answered.
    """
    known = await uav.link.state.latest()
    boards = () if known is None else known.value.boards
    found = next((board for board in ("nc", "fc") if board in boards), None)
    if found is None or known is None or not known.value.condition.hears_board:
        state = "unknown" if known is None else f"{known.value.condition}: {known.value.reason}"
        raise MkError(f"there is no line to measure: the link is {state}")
    return found


def _loads(plan: LinkTestPlan, board: str) -> list[Load]:
    """The loads of a plan; what says whether motors run is a part of each."""
    stream, slowest = WITNESS[board]
    found = []
    for name in plan.loads:
        streams = dict(plan.streams if name == CHOSEN else STREAMS[board][name])
        streams[stream] = min(streams.get(stream) or slowest, slowest)
        found.append(Load(name, streams, 0.0 if name == LIGHT else plan.control_hz))
    return found


@asynccontextmanager
async def _streams_restored(uav: Vehicle) -> AsyncIterator[None]:
    """Ask for the streams of now again at the end, whatever happens."""
    before = (await uav.rates()).intervals
    try:
        yield
    finally:
        await asyncio.shield(asyncio.ensure_future(_set_streams(uav, before)))


async def _set_streams(uav: Vehicle, wanted: Mapping[str, float]) -> None:
    """Ask for some streams and for no others: what ends first makes room."""
    now = (await uav.rates()).intervals
    for stream in now.keys() - wanted.keys():
        await uav.rates(stream, 0.0)
    for stream, interval in sorted(wanted.items(), key=lambda pair: -pair[1]):
        if now.get(stream) != interval:
            await uav.rates(stream, interval)


class _Line:
    """What is noted beside the probes."""

    def __init__(self) -> None:
        self.share: float | None = None
        self._damages: list[int] = []
        self.motors_run = False
        self._beats: list[float] = []
        self._first: LinkHealth | None = None
        self._last: LinkHealth | None = None

    @property
    def counted(self) -> dict[str, Fates]:
        """What the daemon says became of what it sent since the first look, by what it was."""
        if self._first is None or self._last is None:
            return {}
        none = Fates()
        found = {title: fates.since(self._first.fates.get(title, none)) for title, fates in self._last.fates.items()}
        return {title: fates for title, fates in found.items() if fates.sent}

    @property
    def stalled(self) -> float:
        """Part of the time in which the daemon did not measure its own line as often as it does [0..1]."""
        if len(self._beats) < 2:
            return 0.0
        late = sum(max(after - before - BEAT, 0.0) for before, after in pairwise(self._beats))
        return late / (self._beats[-1] - self._beats[0])

    @property
    def damaged(self) -> int | None:
        """Losses of bytes since the first look."""
        return self._damages[-1] - self._damages[0] if self._damages else None

    def take(self, sample: Sample, ledger: Ledger) -> None:
        match sample.suffix:
            case "link/health":
                self._first, self._last = self._first or sample.value, sample.value
                self._beats.append(sample.value.stamp.monotonic)
                ledger.take_replaced(sample.value.stick_frames.replaced)
            case "link/traffic":
                traffic = sample.value
                self.share = max(self.share or 0.0, traffic.rx_share, traffic.tx_share)
                self._damages.append(sum(number for reason, number in traffic.dropped.items() if reason in _DAMAGE))
            case "health":
                self.motors_run = self.motors_run or sample.value.motors_running is True
            case _:
                ledger.take(sample.suffix, sample.value)


_DAMAGE: Final = frozenset({"checksum", "length", "characters"})
"""Reasons of `link/traffic` that are damage on the way."""


async def _measure(
    uav: Vehicle,
    plan: LinkTestPlan,
    load: Load,
    board: str,
    report: Callable[[float, Ledger], None],
    stop: asyncio.Event,
) -> LoadRun:
    ledger, line = Ledger(), _Line()
    loop = asyncio.get_running_loop()
    async with AsyncExitStack() as stack:
        if load.control_hz:
            lease = await stack.enter_async_context(uav.lease())
            await lease.stick(throttle=LOWEST, seconds=0.1, rate=load.control_hz)
            wanted = lease.stick(throttle=LOWEST, seconds=SETTLING + plan.seconds + 1.0, rate=load.control_hz)
            await stack.enter_async_context(beside(wanted))
        await _wait(stop, SETTLING)
        samples = await stack.enter_async_context(uav.watch(*PATTERNS, *_EXTRA, are_known=True))
        await stack.enter_async_context(beside(_listen(samples, ledger, line)))
        if plan.tests_hz:
            await stack.enter_async_context(beside(_send_tests(uav, board, plan.tests_hz)))
        began = loop.time()
        while not stop.is_set() and (elapsed := loop.time() - began) < plan.seconds:
            report(elapsed, ledger)
            await _wait(stop, min(LOOKING, plan.seconds - elapsed))
            if line.motors_run:
                raise MkError("motors run: the measurement has ended, and sticks are the pilot's")
        ledger.end()
        control_hz = round(ledger.stick_frames / max(ledger.elapsed, LOOKING), 1)
        await asyncio.sleep(TIMEOUT + 0.1)
        report(plan.seconds, ledger)
    return LoadRun(
        plan.label,
        load.name,
        control_hz,
        tuple(ledger.probes()),
        line_share=line.share,
        damaged=line.damaged,
        counted=line.counted,
        stalled=line.stalled,
    )


async def _listen(samples: AsyncIterator[Sample], ledger: Ledger, line: _Line) -> None:
    async for sample in samples:
        line.take(sample, ledger)


async def _send_tests(uav: Vehicle, board: str, rate: float) -> None:
    """Ask a NaviCtrl for echoes; a question that waits too long for its turn is not made up for.

    Raises:
        MkError: a FlightCtrl has no link test that others could send.
    """
    if board != "nc":
        raise MkError("--tests: a FlightCtrl has no link test; set link.echo_hz in the configuration")
    pattern, due = FOREIGN_TOKEN, asyncio.get_running_loop().time()
    while True:
        with suppress(CommandRejectedError):  # not answered in time: a loss, which the frames tell
            await uav.command("nc", "echo_request", {"pattern": pattern})
        pattern = FOREIGN_TOKEN + (pattern + 1) % FOREIGN_TOKEN
        now = asyncio.get_running_loop().time()
        due = max(due + 1 / rate, now)
        await asyncio.sleep(due - now)


async def _wait(stop: asyncio.Event, patience: float) -> None:
    """Wait for a while, or until it is to stop."""
    with suppress(TimeoutError):
        async with asyncio.timeout(patience):
            await stop.wait()
