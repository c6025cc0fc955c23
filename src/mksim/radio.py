"""One direction of the serial link, byte by byte: wire time, radio packets, loss, drop-outs, USB timer.

The only model of a radio: the simulator, the proving ground and the lab use it. Packets keep their order,
so those behind a late one arrive back to back: the receiver gets frames without a pause that were sent with one.

Pure: time is an argument, randomness comes from a seed. Bytes never overtake each other.
"""

from __future__ import annotations

import math
import random
from collections import deque
from typing import Final

from mksim.config import ChannelConfig, RadioKind

BITS_PER_BYTE: Final = 10
"""8N1: start, eight data, stop."""
PACKET_BYTES: Final = 100
"""Largest packet of an XBee 802.15.4 module (XBee product manual, transparent operation)."""
PACKET_GAP_BYTES: Final = 3
"""Silence in characters that makes the module send what it has (the same, parameter RO)."""
USB_PACKET_BYTES: Final = 62
"""Payload that makes a full-speed serial adapter deliver before its timer (FTDI AN232B-04)."""


class Air:
    """The way of packets through the air: latency, and loss alone and in bursts. Packets keep their order.

    Attributes:
        packets: sent.
        packets_lost: of these, lost.
    """

    def __init__(self, cfg: ChannelConfig, seed: int | str) -> None:
        """Start with nothing in the air.

        Args:
            cfg: the figures.
            seed: of this direction alone.
        """
        self._byte_time = BITS_PER_BYTE / cfg.baud
        self._latency_min = cfg.latency_min
        self._span = cfg.latency_max - cfg.latency_min
        self._scale = _exponential_scale(cfg.latency_mean - cfg.latency_min, self._span)
        in_bursts = cfg.loss * (1.0 - cfg.lost_alone)
        self._lost_alone = cfg.loss * cfg.lost_alone / (1.0 - in_bursts)
        self._leave_burst = 1.0 / cfg.mean_burst
        self._enter_burst = self._leave_burst * in_bursts / (1.0 - in_bursts)
        self._rng = random.Random(f"{seed} radio")
        self._alone_rng = random.Random(f"{seed} alone")
        self._in_burst = self._rng.random() < in_bursts
        self._out_until = -math.inf
        self.packets = self.packets_lost = 0

    def carry(self, size: int, last: float, at: float) -> float | None:
        """Send a packet.

        Args:
            size: of the packet [byte].
            last: when its last byte had reached the module [s].
            at: when the module sends it [s].

        Returns:
            When its first byte begins to leave the other module [s]; None if the packet is lost.
        """
        rng = self._rng
        self.packets += 1
        self._in_burst = rng.random() >= self._leave_burst if self._in_burst else rng.random() < self._enter_burst
        latency = self._latency_min + self._draw_excess()
        is_lost_alone = self._alone_rng.random() < self._lost_alone
        if self._in_burst or is_lost_alone:
            self.packets_lost += 1
            return None
        leaves = max(last + latency, at, self._out_until)
        self._out_until = leaves + size * self._byte_time
        return leaves

    def _draw_excess(self) -> float:
        """Latency above the minimum: exponential, cut off at the span, by inversion [s]."""
        reach = 1.0 - math.exp(-self._span / self._scale)
        return -self._scale * math.log(1.0 - self._rng.random() * reach)


class RadioChannel:
    """Carries bytes one way.

    Attributes:
        is_cut: nothing gets in while true (a pulled plug, a fault).
        bytes_in: accepted from the sender.
        bytes_out: handed to the receiver.
        bytes_lost: cut or lost on the air.
    """

    def __init__(self, cfg: ChannelConfig, seed: int | str) -> None:
        """Start with an idle line.

        Args:
            cfg: the figures.
            seed: of this direction alone.
        """
        self._byte_time = BITS_PER_BYTE / cfg.baud
        self._is_radio = cfg.kind is RadioKind.XBEE
        self._air = Air(cfg, seed)
        self._outage_rng = random.Random(f"{seed} outage")
        self._outage_gap = 60.0 / cfg.outages_per_minute if cfg.outages_per_minute else math.inf
        self._outage_mean = cfg.outage_duration
        self._outage = self._draw_outage(0.0)
        self._usb_timer = cfg.usb_timer
        self._usb_last = -random.Random(f"{seed} usb").uniform(0.0, cfg.usb_timer)
        self._usb_due = math.inf
        self._usb = bytearray()
        self._packet = bytearray()
        self._packet_last = 0.0
        self._packet_closes = math.inf
        self._busy_until = -math.inf
        self._arrivals: deque[tuple[float, bytes]] = deque()
        self.is_cut = False
        self.bytes_in = self.bytes_out = self.bytes_lost = 0

    @property
    def packets(self) -> int:
        """Radio packets sent."""
        return self._air.packets

    @property
    def packets_lost(self) -> int:
        """Of these, lost."""
        return self._air.packets_lost

    @property
    def next_time(self) -> float:
        """When `poll` next has something to do [s]; infinity when the channel is empty."""
        head = self._arrivals[0][0] if self._arrivals else math.inf
        return min(head, self._usb_due, self._packet_closes)

    def push(self, data: bytes, now: float) -> None:
        """Start sending at `now` [s], or as soon as the line is free."""
        self.bytes_in += len(data)
        at = max(now, self._busy_until)
        for value in data:
            at += self._byte_time
            if self.is_cut or self._is_out(at):
                self.bytes_lost += 1
            elif self._is_radio:
                self._enter_packet(value, at)
            else:
                self._arrive(value, at)
        self._busy_until = at

    def poll(self, now: float) -> list[tuple[float, bytes]]:
        """Return what has arrived by `now` [s], oldest first: the time of the last bit, and the bytes."""
        if self._packet_closes <= now:
            self._close_packet(self._packet_closes)
        if self._usb_due <= now:
            self._flush_usb(self._usb_due)
        arrived = []
        while self._arrivals and self._arrivals[0][0] <= now:
            item = self._arrivals.popleft()
            self.bytes_out += len(item[1])
            arrived.append(item)
        return arrived

    def _enter_packet(self, value: int, at: float) -> None:
        if at - self._byte_time > self._packet_closes:
            self._close_packet(self._packet_closes)
        self._packet.append(value)
        self._packet_last = at
        self._packet_closes = at + PACKET_GAP_BYTES * self._byte_time
        if len(self._packet) >= PACKET_BYTES:
            self._close_packet(at)

    def _close_packet(self, at: float) -> None:
        """Send the packet over the air, or lose it."""
        data = bytes(self._packet)
        self._packet.clear()
        self._packet_closes = math.inf
        leaves = self._air.carry(len(data), self._packet_last, at)
        if leaves is None:
            self.bytes_lost += len(data)
            return
        for value in data:
            leaves += self._byte_time
            self._arrive(value, leaves)

    def _arrive(self, value: int, at: float) -> None:
        """Take a byte at the receiving end."""
        if not self._usb_timer:
            self._arrivals.append((at, bytes((value,))))
            return
        if at > self._usb_due:
            self._flush_usb(self._usb_due)
        if not self._usb:
            # the adapter's timer runs on its own: a byte waits for its next expiry
            ticks = math.ceil((at - self._usb_last) / self._usb_timer)
            self._usb_due = self._usb_last + ticks * self._usb_timer
        self._usb.append(value)
        if len(self._usb) >= USB_PACKET_BYTES:
            self._flush_usb(at)

    def _flush_usb(self, at: float) -> None:
        if self._usb:
            self._arrivals.append((at, bytes(self._usb)))
            self._usb.clear()
        self._usb_last = at
        self._usb_due = math.inf

    def _is_out(self, at: float) -> bool:
        """Say whether a random drop-out covers `at` [s]."""
        while at >= self._outage[1]:
            self._outage = self._draw_outage(self._outage[1])
        return at >= self._outage[0]

    def _draw_outage(self, after: float) -> tuple[float, float]:
        if math.isinf(self._outage_gap):
            return math.inf, math.inf
        begins = after + self._outage_rng.expovariate(1.0 / self._outage_gap)
        return begins, begins + self._outage_rng.expovariate(1.0 / self._outage_mean)


def _exponential_scale(mean: float, span: float) -> float:
    """Return the scale of an exponential cut off at `span` whose mean is `mean`, below half of `span` [s]."""
    low, high = mean, 100.0 * span
    for _ in range(80):
        scale = 0.5 * (low + high)
        tail = math.exp(-span / scale)
        if scale - span * tail / (1.0 - tail) < mean:
            low = scale
        else:
            high = scale
    return 0.5 * (low + high)
