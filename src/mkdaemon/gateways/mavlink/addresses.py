"""Where ground stations are met: `udpout:127.0.0.1:14550`, `tcpin:127.0.0.1:5760,ardupilot`."""

from __future__ import annotations

import ipaddress
import re
from dataclasses import dataclass
from enum import Enum
from typing import Final

from mkdaemon.errors import ConfigError
from mkdaemon.gateways.mavlink.modes import Numbering

DEFAULTS: Final = ("udpout:127.0.0.1:14550", "tcpin:127.0.0.1:5760")
"""QGroundControl, MAVSDK and MAVProxy listen at the first; any number of programs may connect to the second."""
_FORM: Final = (
    "udpout:HOST:PORT, udpin:HOST:PORT, tcpin:HOST:PORT, tcpout:HOST:PORT or serial:DEVICE:BAUD, "
    "and ,ardupilot or ,as-px4"
)


class AddressKind(Enum):
    """How bytes are carried."""

    UDP_OUT = "udpout"
    """To one program that listens there."""
    UDP_IN = "udpin"
    """Receives from any sender; each source address is a station."""
    TCP_IN = "tcpin"
    """Accepts any connection; each is a station."""
    TCP_OUT = "tcpout"
    """To one program that listens there, as mavlink-router does; again and again while there is none."""
    SERIAL = "serial"
    """A cable or a telemetry radio."""


@dataclass(frozen=True, slots=True)
class Address:
    """Where ground stations are met.

    Attributes:
        kind: how.
        host: address or name of a machine; of a serial line the device.
        port: of the machine; of a serial line the baud rate.
        numbering: whose numbers the modes have there.
    """

    kind: AddressKind
    host: str
    port: int
    numbering: Numbering = Numbering.PX4

    @property
    def is_local(self) -> bool:
        """Whether only this machine can be met there; a serial line is what its owner made it."""
        if self.kind is AddressKind.SERIAL or self.host == "localhost":
            return True
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return False

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.kind.value}:{host}:{self.port}"


def read_address(text: str) -> Address:
    """Read an address.

    Raises:
        ConfigError: it is none; says what one looks like.
    """
    where, _, word = text.partition(",")
    found = re.fullmatch(r"(?P<kind>[a-z]+):(?P<host>.+):(?P<port>\d{1,7})", where.strip())
    numbers = {numbering.value: numbering for numbering in Numbering}
    kinds = {kind.value: kind for kind in AddressKind}
    numbering = numbers.get(word.strip()) if word else Numbering.PX4
    kind = kinds.get(found["kind"]) if found else None
    if found is None or kind is None or numbering is None:
        raise ConfigError(f"--link {text!r} is not an address: {_FORM}")
    port = int(found["port"])
    if kind is not AddressKind.SERIAL and not 0 < port < 65_536:
        raise ConfigError(f"--link {text!r}: a port is 1 to 65535")
    return Address(kind, found["host"].removeprefix("[").removesuffix("]"), port, numbering)


def check_addresses(addresses: tuple[Address, ...], *, has_key: bool, allow_open: bool) -> None:
    """Refuse addresses that would let any program in a network fly.

    Raises:
        ConfigError: an address is reachable from other machines, without signed messages and without `--allow-open`.
    """
    for address in addresses:
        if not (address.is_local or has_key or allow_open):
            raise ConfigError(
                f"--link {address}: any program in that network could fly; give --signing-key FILE to both ends, "
                "or --allow-open, knowing why"
            )
