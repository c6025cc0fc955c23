"""Endpoints as users write them, what is said about wrong ones, and who in the network can reach the bus."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest

from mkdaemon.bus.exposure import is_local, open_endpoints
from mkdaemon.bus.gateway import Bus
from mkdaemon.bus.session import open_session, session_config
from mkdaemon.config.bus import BusConfig
from mkdaemon.errors import ConfigError, MkError
from tests.bus.support import free_endpoint
from tests.places import CONFIGS


@pytest.mark.parametrize(
    "endpoint",
    [
        "",
        "foo",
        "7447",
        "127.0.0.1:7447",
        "tcp:127.0.0.1:7447",
        "tcp/127.0.0.1",
        "tcp/127.0.0.1:99999",
        "tcp/:x",
        "tcp/",
    ],
)
def test_a_wrong_endpoint_is_named_with_its_place_and_a_sample(endpoint):
    for mode, arguments, place in (
        ("peer", {"listen": [endpoint]}, "bus.listen"),
        ("peer", {"connect": [endpoint]}, "bus.connect"),
        ("client", {"connect": [endpoint]}, "--connect"),
    ):
        with pytest.raises(ConfigError) as caught:
            session_config(mode, **arguments)
        assert str(caught.value) == f"{place}: {endpoint!r} is not a Zenoh endpoint; write it like tcp/127.0.0.1:7447"


async def test_a_host_that_nobody_knows_is_named():
    with pytest.raises(MkError, match=r"^no machine is known by the name nobody\.invalid: correct it"):
        await open_session(session_config("client", connect=["tcp/nobody.invalid:7447"], patience=0.1))


async def test_an_unknown_protocol_is_a_configuration_error():
    with pytest.raises(ConfigError, match="tpc"):
        await open_session(session_config("peer", listen=["tpc/127.0.0.1:7447"]))


async def test_nobody_there_is_said_with_the_endpoint():
    endpoint = free_endpoint()
    with pytest.raises(MkError, match=f"^no program answers at {endpoint}: is mkdaemon running there"):
        await open_session(session_config("client", connect=[endpoint], patience=0.05))


async def test_a_program_that_listens_and_has_no_time_is_not_told_as_nobody():
    with socket.socket() as stopped:
        stopped.bind(("127.0.0.1", 0))
        stopped.listen()
        endpoint = f"tcp/127.0.0.1:{stopped.getsockname()[1]}"
        with pytest.raises(MkError, match=f"^a program listens at {endpoint} but does not answer: .* busy"):
            await open_session(session_config("client", connect=[endpoint], patience=0.3))


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
