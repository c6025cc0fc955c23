"""Whether a line will do, and what would make it better. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from mkdaemon.client.linktest.measures import LoadRun, Measures, measure
from mkdaemon.client.linktest.probes import RADIO_TRIP, ProbeKind

GOOD_LOSS: Final = 1.0
"""Loss up to which a line is good [%]: a radio of 2010 under light load (docs/link.md)."""
USABLE_LOSS: Final = 5.0
"""Loss above which the daemon calls the link degraded [%]: `link.max_loss_percent`."""
GOOD_TRIP: Final = 125.0
"""99th percentile of the round trip up to which a line is good [ms]: a radio's longest way there and back."""
USABLE_SILENCE: Final = 1.0
"""A link without an answer for this time ends the lease in flight [s]; docs/link.md."""
TIMER_DELAY: Final = (4.0, 12.0)
"""A median under light load longer than the shortest round trips of a wire by this is that of answers that wait
for a USB adapter's timer of 16 ms, half of it on average [ms]; without one half of them do not wait at all."""
ENOUGH: Final = 3
"""Fewer losses say nothing [1]."""
BUSY: Final = 0.05
"""A daemon that did not run for more of the time measures itself [0..1]."""
CROWDED: Final = 0.7
"""A line that is fuller has no room for what is sent again [0..1]."""


class Grade(StrEnum):
    """The one word."""

    GOOD = "good"
    """Losses and latencies are those of a good radio, or better."""
    USABLE = "usable"
    """It flies; there is something to improve."""
    POOR = "poor"
    """Do not fly over it."""
    UNKNOWN = "unknown"
    """Nothing was measured."""


@dataclass(frozen=True, slots=True)
class LineVerdict:
    """What is thought of a line.

    Attributes:
        grade: the one word.
        reason: what it rests on, one sentence.
        advice: what to do, each a sentence; empty where nothing has to be done.
    """

    grade: Grade
    reason: str
    advice: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class _Load:
    run: LoadRun
    echo: Measures
    control: Measures


def judge(runs: Sequence[LoadRun]) -> LineVerdict:
    """Judge what was measured under every load of one line."""
    loads = [_Load(run, measure(run.of(ProbeKind.ECHO)), measure(run.of(ProbeKind.CONTROL))) for run in runs]
    loads = [load for load in loads if load.echo.sent]
    if not loads:
        return LineVerdict(Grade.UNKNOWN, "no link test was seen", ("Set link.echo_hz, or give --tests 5.",))
    grade, reason = min((_grade(load) for load in loads), key=lambda found: _ORDER.index(found[0]))
    return LineVerdict(grade, reason, tuple(_advice(loads)))


_ORDER: Final = (Grade.POOR, Grade.USABLE, Grade.GOOD)


def _grade(load: _Load) -> tuple[Grade, str]:
    echo, control = load.echo, load.control
    loss = max(echo.loss_percent, control.line_loss_percent)
    if echo.p99_ms is None:
        return Grade.POOR, f"{load.run.load} load: not one link test was answered"
    words = f"{load.run.load} load: {loss:.2f} % lost, 99 of 100 round trips within {echo.p99_ms:.0f} ms"
    if loss > USABLE_LOSS or echo.silence > USABLE_SILENCE:
        silent = f", {echo.silence:.1f} s without an answer" if echo.silence > USABLE_SILENCE else ""
        return Grade.POOR, words + silent
    return (Grade.GOOD if loss <= GOOD_LOSS and echo.p99_ms <= GOOD_TRIP else Grade.USABLE), words


def _advice(loads: Sequence[_Load]) -> Iterator[str]:
    calmest, fullest = loads[0], loads[-1]
    is_radio = (calmest.echo.p50_ms or 0.0) > 1000 * RADIO_TRIP
    stalled = max(load.run.stalled for load in loads)
    if stalled > BUSY:
        yield (
            f"Machine: the daemon did not run for {100 * stalled:.0f} % of the time, so these figures are not the "
            "line's: measure again with nothing else running there."
        )
        return
    yield from _timer(calmest, is_radio=is_radio)
    yield from _gap(fullest, is_radio=is_radio)
    yield from _rate(calmest, fullest)
    yield from _interference(loads, is_radio=is_radio)


def _timer(load: _Load, *, is_radio: bool) -> Iterator[str]:
    """A USB adapter that holds answers back; behind a radio its own scatter hides it."""
    trips = sorted(1000 * probe.trip for probe in load.run.of(ProbeKind.ECHO) if probe.trip is not None)
    if is_radio or len(trips) < 20:
        return
    delay = trips[len(trips) // 2] - trips[len(trips) // 20]
    if TIMER_DELAY[0] <= delay <= TIMER_DELAY[1]:
        yield (
            f"Latency timer: half of the answers are {delay:.0f} ms late and more, as behind a USB adapter with its "
            "timer at 16 ms; set it to 1 ms (`mkdaemon doctor` has the command)."
        )


def _gap(load: _Load, *, is_radio: bool) -> Iterator[str]:
    """Stick frames that are lost where link tests are not: the FlightCtrl had no time for them."""
    echo, control = load.echo, load.control
    if is_radio or control.lost - control.replaced < ENOUGH or control.line_loss_percent < 2 * echo.loss_percent + 0.2:
        return
    yield (
        f"Gap: {control.line_loss_percent:.1f} % of the stick frames are lost and {echo.loss_percent:.1f} % of the "
        "link tests, so the board has no time for them: raise link.gap_ms (12 by default) to 16, or lower control.rate."
    )


def _rate(calmest: _Load, fullest: _Load) -> Iterator[str]:
    share = fullest.run.line_share
    if share is not None and share > CROWDED:
        yield f"Rate: the line is {100 * share:.0f} % full; ask for slower streams (`mkctl board rates`)."
        return
    if calmest is fullest or calmest.echo.p95_ms is None or fullest.echo.p95_ms is None:
        return
    more_lost = fullest.echo.lost >= ENOUGH and fullest.echo.loss_percent > 2 * calmest.echo.loss_percent + 1.0
    if more_lost or fullest.echo.p95_ms > 2 * calmest.echo.p95_ms + 20.0:
        yield (
            f"Rate: full load costs {fullest.echo.loss_percent - calmest.echo.loss_percent:+.1f} % of loss and "
            f"{fullest.echo.p95_ms - calmest.echo.p95_ms:+.0f} ms (95 of 100): slower streams: `mkctl board rates`."
        )


def _interference(loads: Sequence[_Load], *, is_radio: bool) -> Iterator[str]:
    worst = max(loads, key=lambda load: load.echo.loss_percent)
    damaged = sum(load.run.damaged or 0 for load in loads)
    if not is_radio and damaged:
        yield (
            f"Noise: {damaged} bytes arrived damaged over a wire: look at ground, plug and shield, and whether a "
            "second program has the port."
        )
    if worst.echo.lost < ENOUGH or worst.echo.loss_percent <= GOOD_LOSS:
        return
    if worst.echo.mean_run >= 1.5 or worst.echo.longest_run >= ENOUGH:
        yield (
            f"Interference: losses come {worst.echo.mean_run:.1f} in a row on average, up to {worst.echo.longest_run}: "
            "use another channel, switch other transmitters off, set antennas upright, or reduce the distance."
        )
    elif is_radio:
        yield "Range: single packets are lost all the time: set antennas upright, reduce the distance, use more power."
    else:
        yield "Wire: answers are lost one at a time: look at plugs and wires towards the board."
