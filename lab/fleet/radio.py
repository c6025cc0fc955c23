"""A radio link between two network namespaces: it delays packets, loses some, and can be cut.

Two TUN devices, one in each namespace; a thread carries what comes out of one into the other. The kernels' own TCP sees
loss and delay as on the air. Linux's `netem` does the same, and is missing from many kernels.
"""

from __future__ import annotations

import fcntl
import os
import random
import select
import struct
import threading
import time
from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

from mkdaemon.errors import ConfigError

DEVICE: Final = "/dev/net/tun"
_SET_INTERFACE: Final = 0x400454CA
"""`TUNSETIFF` of linux/if_tun.h."""
_PACKETS: Final = 0x1001
"""`IFF_TUN | IFF_NO_PI`: whole IP packets and nothing in front of them."""
LARGEST: Final = 65536
"""Of a packet [bytes]."""
IDLE: Final = 0.5
"""Longest sleep of the thread [s]."""


@dataclass(frozen=True, slots=True)
class Air:
    """What the way through the air does.

    Attributes:
        loss: share of packets that are lost, each way.
        delay: each way [s].
    """

    loss: float
    delay: float


class DelayLine:
    """One direction: packets come out later, in order, or not at all. Pure.

    Attributes:
        is_cut: everything that comes now is lost.
        lost: packets that did not come out.
    """

    def __init__(self, air: Air, seed: int) -> None:
        self.is_cut = False
        self.lost = 0
        self._air = air
        self._rng = random.Random(seed)
        self._under_way: deque[tuple[float, bytes]] = deque()

    def put(self, packet: bytes, now: float) -> None:
        """Take a packet at a time [s]."""
        if self.is_cut or self._rng.random() < self._air.loss:
            self.lost += 1
        else:
            self._under_way.append((now + self._air.delay, packet))

    def due(self, now: float) -> list[bytes]:
        """Packets that have arrived by a time [s]; what is under way when the link is cut is lost."""
        found = []
        while self._under_way and self._under_way[0][0] <= now:
            _, packet = self._under_way.popleft()
            if self.is_cut:
                self.lost += 1
                continue
            found.append(packet)
        return found

    def next_time(self) -> float | None:
        """When the next packet arrives [s]; None while none is under way."""
        return self._under_way[0][0] if self._under_way else None


def open_device(name: str) -> int:
    """Make a TUN device in the namespace of the caller; it goes with its descriptor.

    Raises:
        ConfigError: this machine does not allow it.
    """
    try:
        descriptor = os.open(DEVICE, os.O_RDWR | os.O_NONBLOCK)
        fcntl.ioctl(descriptor, _SET_INTERFACE, struct.pack("16sH22x", name.encode(), _PACKETS))
    except OSError as error:
        raise ConfigError(f"{DEVICE}: {error.strerror}; the lossy link needs it: `sudo modprobe tun`") from error
    return descriptor


class RadioLink:
    """Carries packets between two TUN devices.

    Attributes:
        up: from the first device, the aircraft's.
        down: from the second, the ground's.
    """

    def __init__(self, aircraft: int, ground: int, air: Air, seed: int) -> None:
        """Begin; both descriptors are closed in the end."""
        self.up, self.down = DelayLine(air, 2 * seed), DelayLine(air, 2 * seed + 1)
        self._ends = ((aircraft, ground, self.up), (ground, aircraft, self.down))
        self._has_ended = False
        self._thread = threading.Thread(target=self._run, name="radio link", daemon=True)
        self._thread.start()

    def cut(self) -> None:
        """Lose everything from now on."""
        self.up.is_cut = self.down.is_cut = True

    def restore(self) -> None:
        """Carry again."""
        self.up.is_cut = self.down.is_cut = False

    def close(self) -> None:
        """End."""
        self._has_ended = True
        self._thread.join()
        for source, _, _ in self._ends:
            os.close(source)

    def _run(self) -> None:
        while not self._has_ended:
            now = time.monotonic()
            for _, sink, line in self._ends:
                for packet in line.due(now):
                    with suppress(OSError):  # a device that is down, or full, as any network card
                        os.write(sink, packet)
            times = [at for *_, line in self._ends if (at := line.next_time()) is not None]
            wait = min([IDLE, *(max(at - now, 0.0) for at in times)])
            ready, _, _ = select.select([source for source, _, _ in self._ends], [], [], wait)
            for source, _, line in self._ends:
                if source in ready:
                    with suppress(OSError):
                        line.put(os.read(source, LARGEST), time.monotonic())
