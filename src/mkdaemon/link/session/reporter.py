"""Turns what the dialogue knows into the values that are published."""

from __future__ import annotations

import math
from collections import deque
from typing import Final

from mkdaemon.clock import Clock
from mkdaemon.config.link import LinkConfig
from mkdaemon.link.session import budget
from mkdaemon.link.session.dialogue import Dialogue
from mkdaemon.telemetry.link import LinkHealth, LinkState, LinkTraffic

HEALTH_PERIOD: Final = 0.2
"""Health is published at 5 Hz."""
TRAFFIC_PERIOD: Final = 1.0
"""Traffic counters are published at 1 Hz."""
_FRESH: Final = 0.5
"""A proof that the board hears us counts for this long [s]."""


class Reporter:
    """Builds state, health and traffic."""

    def __init__(self, cfg: LinkConfig, dialogue: Dialogue, clock: Clock) -> None:
        """Read from a dialogue, and stamp with the link's clock."""
        self._health_at = -math.inf
        self._traffic_at = -math.inf
        self._cfg = cfg
        self._dialogue = dialogue
        self._clock = clock
        self._port = cfg.port
        self._openings = 0
        self._published: object = None
        self._bytes: deque[tuple[float, int, int]] = deque(maxlen=4)

    def port_opened(self, name: str) -> None:
        """A port is open under this name."""
        self._port = name
        self._openings += 1
        self._bytes.clear()

    def take_state_change(self) -> bool:
        """Whether the state differs from the one published last; notes it as published."""
        dialogue, peers = self._dialogue, self._dialogue.peers
        verdict = dialogue.health.verdict
        # While the port is open the reason follows the measurements; it changes too often to be an event.
        reason = "" if dialogue.is_open else verdict.reason
        shown = (verdict.condition, reason, peers.dialect, peers.redirected, self._openings, len(peers.boards))
        differs, self._published = shown != self._published, shown
        return differs

    def health_is_due(self, now: float) -> bool:
        """Whether it is time for the next health; notes it as published."""
        due = now >= self._health_at
        if due:
            self._health_at = max(self._health_at + HEALTH_PERIOD, now + HEALTH_PERIOD / 2)
        return due

    def traffic_is_due(self, now: float) -> bool:
        """Whether it is time for the next counters; notes them as published."""
        due = now >= self._traffic_at
        if due:
            self._traffic_at = max(self._traffic_at + TRAFFIC_PERIOD, now + TRAFFIC_PERIOD / 2)
        return due

    def state(self, now: float) -> LinkState:
        """The state of the line."""
        dialogue = self._dialogue
        verdict = dialogue.health.verdict
        answered = dialogue.health.answer_age(now)
        return LinkState(
            stamp=self._clock.stamp(now),
            condition=verdict.condition,
            reason=verdict.reason,
            since=self._clock.stamp(verdict.since),
            port=self._port,
            baud=dialogue.rules.baud,
            hears_board=verdict.condition.hears_board,
            board_hears_us=verdict.condition.is_usable and answered < _FRESH,
            boards=tuple(board.word for board in sorted(dialogue.peers.boards)),
            firmware=_firmware(dialogue),
            external_control=dialogue.dialect.extern_control_layout or "",
            redirected_to="" if dialogue.peers.redirected is None else dialogue.peers.redirected.word,
            openings=self._openings,
        )

    def health(self, now: float) -> LinkHealth:
        """Everything measured."""
        dialogue, monitor = self._dialogue, self._dialogue.health
        silence, answered = monitor.heard_age(now), monitor.answer_age(now)
        garbage, checksums = monitor.damage_rates(now)
        return LinkHealth(
            stamp=self._clock.stamp(now),
            state=self.state(now),
            echo=monitor.echo.statistics(now),
            confirm=monitor.confirm.statistics(now),
            link_tests=monitor.echo.tally.fates(),
            requests=dialogue.questions.book.tally.fates(),
            stick_frames=monitor.confirm.tally.fates(),
            heard_age=silence if math.isfinite(silence) else None,
            answer_age=answered if math.isfinite(answered) else None,
            garbage_bytes_per_s=garbage,
            checksum_error_rate=checksums,
            backlog_bytes=monitor.backlog,
            kinds=monitor.kinds(now),
        )

    def traffic(self, now: float) -> LinkTraffic:
        """Traffic of the line."""
        dialogue = self._dialogue
        counters = dialogue.counters
        self._bytes.append((now, counters.rx_bytes, counters.tx_bytes))
        began, rx, tx = self._bytes[0]
        span = now - began
        per_byte = dialogue.rules.wire_time(b"#")
        renewal = dialogue.streams.renewal
        planned = budget.plan(dialogue.demand(dialogue.streams.wanted), dialogue.rules, renew=renewal)
        return LinkTraffic(
            stamp=self._clock.stamp(now),
            rx_bytes=counters.rx_bytes,
            tx_bytes=counters.tx_bytes,
            rx_frames=counters.rx.total(),
            tx_frames=counters.tx.total(),
            rx_share=(counters.rx_bytes - rx) * per_byte / span if span > 0 else 0.0,
            tx_share=(counters.tx_bytes - tx) * per_byte / span if span > 0 else 0.0,
            rx_planned=planned.rx,
            tx_planned=planned.tx,
            renewal=renewal,
            delivered_share=dialogue.health.share.delivered,
            request_distance=dialogue.scheduler.distance,
            rx_kinds=dict(counters.rx),
            tx_kinds=dict(counters.tx),
            dropped=dict(counters.dropped),
        )


def _firmware(dialogue: Dialogue) -> str:
    """What the boards said about themselves, in words."""
    dialect = dialogue.dialect
    names = []
    if dialect.nc_release is not None:
        names.append(f"NaviCtrl {dialect.nc_release}")
    if dialect.fc_release is not None:
        names.append(f"FlightCtrl {dialect.fc_release}")
    words = ", ".join(names)
    if dialect.read_only_reason is not None:
        return f"{words}; read only: {dialect.read_only_reason}" if words else f"read only: {dialect.read_only_reason}"
    return words
