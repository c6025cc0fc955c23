"""Budget of the line: shares, refusals with the arithmetic, and the best mix of streams. Pure.

Source: docs/firmware-notes, "Losses": O + D + C, all at 50 ms (84 % of the line), is the highest mix where everything
gets through; above it, the kinds a NaviCtrl sends last starve.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from mkdaemon.link.session.line import LineRules
from mkdaemon.link.session.streamkinds import KINDS, StreamKind
from mkdaemon.protocol.wire import Board
from mkdaemon.telemetry.refusals import Token, refuse

ECHO_CHARACTERS: Final = {Board.NC: (10, 10), Board.FC: (6, 22), Board.ANY: (6, 22)}
"""Link test by board: characters there and back (`z`; a FlightCtrl has none and is asked for its version)."""
CONFIRM_CHARACTERS: Final = 10
"""`B`."""
RENEWAL_CHARACTERS: Final = 10
"""A stream request."""

_LADDERS: Final[dict[str, tuple[float, ...]]] = {
    "attitude": (0.2, 0.1, 0.05, 0.04, 0.03, 0.02),
    "osd": (0.5, 0.2, 0.1, 0.05),
    "debug": (1.0, 0.5, 0.2, 0.1),
}
"""Intervals `auto` may choose, slowest first [s]."""
_WORTH: Final = {"attitude": 4.0, "osd": 3.0, "debug": 1.0}
"""What doubling a stream's rate is worth: attitude feeds control, osd the state, debug curiosity."""


@dataclass(frozen=True, slots=True)
class Demand:
    """Planned use of the line.

    Attributes:
        streams: interval by key [s].
        echo_hz: link tests a second.
        setpoint_hz: external control frames a second.
        setpoint_characters: length of one.
        confirms: whether the board confirms them.
    """

    streams: Mapping[str, float]
    echo_hz: float = 0.0
    setpoint_hz: float = 0.0
    setpoint_characters: int = 18
    confirms: bool = False


@dataclass(frozen=True, slots=True)
class LinePlan:
    """Shares of the line a demand needs.

    Attributes:
        rx: towards us [1 = the whole line].
        tx: towards the board, gaps the board needs included.
    """

    rx: float
    tx: float


def plan(demand: Demand, rules: LineRules, *, renew: float = 1.5) -> LinePlan:
    """Add up what a demand needs."""
    there, back = ECHO_CHARACTERS.get(rules.direct, ECHO_CHARACTERS[Board.ANY])
    rx = sum(share_of(KINDS[key], interval, rules) for key, interval in demand.streams.items())
    rx += demand.echo_hz * rules.reply_time(back)
    gap = rules.gap_after(reaches_fc=False)
    character = rules.wire_time(b"#")
    tx = demand.echo_hz * (there * character + gap)
    tx += (RENEWAL_CHARACTERS * character + gap) / renew if demand.streams else 0.0
    tx += demand.setpoint_hz * (demand.setpoint_characters * character + gap)
    if demand.confirms:
        rx += demand.setpoint_hz * rules.reply_time(CONFIRM_CHARACTERS)
    return LinePlan(rx, tx)


def share_of(kind: StreamKind, interval: float, rules: LineRules) -> float:
    """Share of the line one stream takes [1 = the whole line]."""
    return rules.reply_time(kind.characters) / interval


def check(demand: Demand, rules: LineRules, *, limit: float) -> LinePlan:
    """Return the plan, or refuse what the line cannot carry.

    Raises:
        CommandRejectedError: with the arithmetic, for example "O at 20 ms + D at 20 ms need 184 % of the line".
    """
    wanted = plan(demand, rules)
    if wanted.rx > limit:
        terms = [f"{KINDS[key].reply} at {interval * 1000:.0f} ms" for key, interval in demand.streams.items()]
        streams = sum(share_of(KINDS[key], interval, rules) for key, interval in demand.streams.items())
        others = wanted.rx - streams
        if others >= 0.005:
            terms.append(f"echoes and confirmations ({others * 100:.0f} %)")
        verb = "need" if len(terms) > 1 else "needs"
        # Every stream slowed by the same factor would fit; the advice is that factor, never rounded down.
        factor = math.ceil(10 * streams / max(limit - others, 0.01)) / 10
        sums = f"{' + '.join(terms)} {verb} {wanted.rx * 100:.0f} %"
        raise refuse(Token.LINE_BUDGET, terms=sums, limit=limit * 100, factor=factor)
    if wanted.tx > 1.0:
        raise refuse(Token.UPLINK_BUDGET, hz=demand.setpoint_hz, share=wanted.tx * 100)
    return wanted


def best_mix(board: Board, rules: LineRules, *, limit: float, demand: Demand | None = None) -> dict[str, float]:
    """Choose intervals for a board: the most useful mix under the limit.

    Args:
        board: who streams.
        rules: the line.
        limit: largest share towards us.
        demand: what else the line must carry (its streams are ignored).

    Returns:
        Interval by key [s]. From the slowest mix on, the step worth most for its share is taken while it fits.

    A board keeps one frame of a kind waiting: a stream faster than all kinds together take would be overtaken by its
    own next frame whenever they fall due at once. So no interval is shorter than that.
    """
    others = demand or Demand({})
    kinds = [KINDS[key] for key in _LADDERS if board in KINDS[key].boards]
    queue = rules.reply_time(sum(kind.characters for kind in kinds) + ECHO_CHARACTERS[board][1] + CONFIRM_CHARACTERS)
    offered = {kind.key: tuple(step for step in _LADDERS[kind.key] if step >= queue) for kind in kinds}
    steps = dict.fromkeys(offered, 0)

    def share(at: Mapping[str, int]) -> float:
        streams = {key: offered[key][step] for key, step in at.items()}
        wanted = Demand(
            streams, others.echo_hz, others.setpoint_hz, others.setpoint_characters, confirms=others.confirms
        )
        return plan(wanted, rules).rx

    while True:
        base = share(steps)
        best: tuple[float, str] | None = None
        for key, step in steps.items():
            ladder = offered[key]
            if step + 1 == len(ladder):
                continue
            needed = share({**steps, key: step + 1})
            if needed > limit:
                continue
            gain = _WORTH[key] * (ladder[step] / ladder[step + 1] - 1.0) / (needed - base)
            if best is None or gain > best[0]:
                best = (gain, key)
        if best is None:
            return {key: offered[key][step] for key, step in steps.items()}
        steps[best[1]] += 1
