"""Network namespaces on one machine: the ground's, which this process enters, and one for each aircraft.

Nothing has a name outside this process and nothing is left behind: a namespace ends with the processes in it.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from lab.fleet.radio import RadioLink, open_device
from lab.rigs.waiting import wait_blocking
from mkdaemon.errors import ConfigError

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
        """Make it.

        Args:
            number: 1 to 254.
            is_radio: its link is a radio, else a cable.

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
