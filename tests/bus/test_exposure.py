"""Who in the network can reach the bus."""

from __future__ import annotations

from pathlib import Path

import pytest

from mkdaemon.bus.exposure import is_local, open_endpoints
from mkdaemon.bus.gateway import Bus
from mkdaemon.bus.session import session_config
from mkdaemon.config.bus import BusConfig
from mkdaemon.errors import ConfigError
from tests.places import CONFIGS

TLS = CONFIGS / "zenoh" / "daemon-tls.json5"


@pytest.mark.parametrize(
    ("endpoint", "local"),
    [
        ("tcp/127.0.0.1:7447", True),
        ("tcp/127.8.0.1:7447", True),
        ("tcp/localhost:7447", True),
        ("tcp/[::1]:7447", True),
        ("unixsock-stream//run/mkdaemon.sock", True),
        ("tcp/0.0.0.0:7447", False),
        ("tcp/[::]:7447", False),
        ("tcp/192.168.7.1:7447?retries=3", False),
        ("udp/0.0.0.0:7447#iface=lo", False),
        ("tls/ground.example:7447", False),
    ],
)
def test_what_only_this_machine_reaches(endpoint, local):
    assert is_local(endpoint) is local


def own_file(folder: Path, text: str) -> Path:
    path = folder / "zenoh.json5"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("text", "listen", "reachable"),
    [
        ("{}", ["tcp/127.0.0.1:1", "tcp/0.0.0.0:2", "tls/0.0.0.0:3"], ("tcp/0.0.0.0:2", "tls/0.0.0.0:3")),
        (TLS, ["tls/0.0.0.0:1"], ()),
        (TLS, ["tls/0.0.0.0:1", "tcp/0.0.0.0:2"], ("tcp/0.0.0.0:2",)),
        ('{transport: {auth: {usrpwd: {dictionary_file: "users.txt"}}}}', ["tcp/0.0.0.0:1"], ()),
        ('{listen: {endpoints: ["tcp/0.0.0.0:1"]}}', [], ("tcp/0.0.0.0:1",)),
        ('{listen: {endpoints: {router: ["tcp/0.0.0.0:1"], peer: ["tcp/0.0.0.0:2"]}}}', [], ("tcp/0.0.0.0:2",)),
    ],
)
def test_open_is_what_the_network_reaches_and_what_asks_nobody(text, listen, reachable, tmp_path):
    file = text if isinstance(text, Path) else own_file(tmp_path, text)
    assert open_endpoints(session_config("peer", listen=listen, zenoh_file=file)) == reachable


def test_with_a_zenoh_file_that_says_nothing_about_listening_nobody_is_listened_to(tmp_path):
    """Zenoh itself then listens everywhere."""
    assert open_endpoints(session_config("peer", zenoh_file=own_file(tmp_path, "{}"))) == ()


async def test_an_open_bus_is_refused_unless_it_is_allowed():
    with pytest.raises(ConfigError, match=r"tcp/0\.0\.0\.0:0: every program .* could fly .* bus\.allow_open = true"):
        async with Bus.open(BusConfig(listen=("tcp/0.0.0.0:0",)), "t1"):
            pytest.fail("open")
    async with Bus.open(BusConfig(listen=("tcp/0.0.0.0:0",), allow_open=True), "t1") as bus:
        assert bus.open_endpoints == ("tcp/0.0.0.0:0",)
    async with Bus.open(BusConfig(listen=("tcp/127.0.0.1:0",)), "t1") as bus:
        assert bus.open_endpoints == ()
