"""Network namespaces on one machine, the ground's and one for each aircraft, and the links between them.

This process enters the ground's. Nothing has a name outside this process and nothing is left behind: a namespace ends
with the processes in it. A radio link is two TUN devices, one in each namespace; a thread carries what comes out of one
into the other, delays packets, loses some, and can be cut. The kernels' own TCP sees loss and delay as on the air.
Linux's `netem` does the same, and is missing from many kernels.
"""

from __future__ import annotations

import ctypes
import fcntl
import os
import random
import select
import shutil
import struct
import subprocess
import threading
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

from lab.rigs.waiting import wait_blocking
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
LOSS: Final = 0.05
"""Share of packets that are lost, each way."""
DELAY: Final = 0.03
"""Each way [s]."""


class DelayLine:
    """One direction: packets come out later, in order, or not at all. Pure.

    Attributes:
        is_cut: everything that comes now is lost, and what is under way, too.
    """

    def __init__(self, seed: int, loss: float = LOSS) -> None:
        self.is_cut = False
        self._loss, self._rng = loss, random.Random(seed)
        self._under_way: deque[tuple[float, bytes]] = deque()

    def put(self, packet: bytes, now: float) -> None:
        """Take a packet at a time [s]."""
        if self._rng.random() >= self._loss and not self.is_cut:
            self._under_way.append((now + DELAY, packet))

    def due(self, now: float) -> list[bytes]:
        """Packets that have arrived by a time [s]."""
        found = []
        while self._under_way and self._under_way[0][0] <= now:
            found.append(self._under_way.popleft()[1])
        return [] if self.is_cut else found

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
    """Carries packets between two TUN devices, the aircraft's and the ground's, whose descriptors it closes."""

    def __init__(self, aircraft: int, ground: int) -> None:
        self._ends = ((aircraft, ground, DelayLine(2)), (ground, aircraft, DelayLine(3)))
        self._has_ended = False
        self._thread = threading.Thread(target=self._run, name="radio link", daemon=True)
        self._thread.start()

    @property
    def is_cut(self) -> bool:
        """Whether everything is lost."""
        return self._ends[0][2].is_cut

    @is_cut.setter
    def is_cut(self, is_cut: bool) -> None:
        for *_, line in self._ends:
            line.is_cut = is_cut

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


PROGRAMS: Final = ("ip", "unshare", "nsenter")
_NEW_NETWORK: Final = 0x40000000
"""`CLONE_NEWNET` of linux/sched.h."""


def enter_ground() -> None:
    """Give this thread, and all that it starts from now on, a network of its own with nothing but loopback.

    Raises:
        ConfigError: network namespaces are not permitted here, or a program is missing.
    """
    missing = [name for name in PROGRAMS if shutil.which(name) is None]
    if missing:
        raise ConfigError(f"no program {', '.join(missing)}: `sudo apt install iproute2 util-linux`")
    system = ctypes.CDLL(None, use_errno=True)
    if system.unshare(_NEW_NETWORK) != 0:
        reason = os.strerror(ctypes.get_errno())
        raise ConfigError(f"no network namespaces here ({reason}): run it as root, on a machine that permits them")
    _ip("link", "set", "lo", "up")


def _ip(*words: str, inside: Sequence[str] = ()) -> None:
    done = subprocess.run([*inside, "ip", *words], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise ConfigError(f"ip {' '.join(words)}: {done.stderr.strip()}")


class Place:
    """The network of one aircraft, with a link to the ground.

    Attributes:
        ground: address of the ground's end.
        prefix: what a program is started with to run in it.
        radio: its link; None for a cable.
    """

    def __init__(self, number: int, *, is_radio: bool) -> None:
        """Make it, by a number from 1 to 254.

        Raises:
            ConfigError: it cannot be made.
        """
        self.ground, interface = f"10.77.{number}.1", f"g{number}"
        self.radio: RadioLink | None = None
        # It keeps the namespace, and ends when this process has ended: its input is closed then.
        self._keeper = subprocess.Popen(["unshare", "--net", "cat"], stdin=subprocess.PIPE)
        namespace = Path(f"/proc/{self._keeper.pid}/ns/net")
        own = Path("/proc/thread-self/ns/net").readlink()
        wait_blocking(lambda: namespace.readlink() != own)
        self.prefix = ("nsenter", f"--net={namespace}", "--")
        there, aircraft = str(self._keeper.pid), f"v{number}"
        if not is_radio:
            _ip("link", "add", interface, "type", "veth", "peer", "name", aircraft, "netns", there)
        else:
            self.radio = RadioLink(open_device(aircraft), open_device(interface))
            _ip("link", "set", aircraft, "netns", there)
        _ip("address", "add", f"{self.ground}/24", "dev", interface)
        _ip("link", "set", interface, "up")
        for words in (
            ("link", "set", "lo", "up"),
            ("address", "add", f"10.77.{number}.2/24", "dev", aircraft),
            ("link", "set", aircraft, "up"),
        ):
            _ip(*words, inside=self.prefix)

    def close(self) -> None:
        """End it; programs in it must have ended."""
        if self.radio is not None:
            self.radio.close()
        assert self._keeper.stdin is not None
        self._keeper.stdin.close()
        self._keeper.wait()
