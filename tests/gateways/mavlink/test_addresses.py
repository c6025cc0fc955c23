"""Addresses as a user writes them, and who may be met at them."""

from __future__ import annotations

import pytest

from mkdaemon.errors import ConfigError
from mkdaemon.gateways.mavlink.addresses import DEFAULTS, Address, AddressKind, check_addresses, read_address
from mkdaemon.gateways.mavlink.modes import Numbering


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("udpout:127.0.0.1:14550", Address(AddressKind.UDP_OUT, "127.0.0.1", 14550)),
        ("udpin:[::1]:14550", Address(AddressKind.UDP_IN, "::1", 14550)),
        ("tcpin:localhost:5760,ardupilot", Address(AddressKind.TCP_IN, "localhost", 5760, Numbering.ARDUPILOT)),
        ("tcpout:127.0.0.1:5790,as-px4", Address(AddressKind.TCP_OUT, "127.0.0.1", 5790, Numbering.AS_PX4)),
        ("serial:/dev/serial/by-id/usb-1:57600, px4", Address(AddressKind.SERIAL, "/dev/serial/by-id/usb-1", 57600)),
    ],
)
def test_addresses(text, address):
    assert read_address(text) == address
    assert address.is_local


@pytest.mark.parametrize(
    "text", ["", "udp:127.0.0.1:1", "udpin:127.0.0.1", "udpin::1", "tcpin:host:99999", "tcpin:host:0", "udpin:h:1,px5"]
)
def test_what_is_no_address(text):
    with pytest.raises(ConfigError, match="--link"):
        read_address(text)


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.1.7", "ground.example", "::"])
def test_a_network_needs_a_key_or_leave(host):
    address = (Address(AddressKind.UDP_IN, host, 14550),)
    with pytest.raises(ConfigError, match="any program in that network could fly"):
        check_addresses(address, has_key=False, allow_open=False)
    check_addresses(address, has_key=True, allow_open=False)
    check_addresses(address, has_key=False, allow_open=True)


def test_loopback_by_default():
    check_addresses(tuple(map(read_address, DEFAULTS)), has_key=False, allow_open=False)
