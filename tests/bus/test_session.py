"""Endpoints as users write them, and what is said about wrong ones."""

from __future__ import annotations

import socket

import pytest

from mkdaemon.bus.session import check_endpoint, open_session, session_config
from mkdaemon.errors import ConfigError, MkError
from tests.bus.support import free_endpoint


@pytest.mark.parametrize(
    "endpoint",
    [
        "tcp/127.0.0.1:7447",
        "tcp/[::1]:7447",
        "tcp/[fe80::1%eth0]:7447",
        "tcp/0.0.0.0:0",
        "tls/copter.local:65535",
        "quic/10.0.0.1:7447",
        "tcp/127.0.0.1:7447?prio=1-3",
        "udp/127.0.0.1:7447#iface=lo",
        "unixsock-stream//run/mkdaemon.sock",
    ],
)
def test_endpoints_zenoh_understands(endpoint):
    check_endpoint(endpoint, "here")
    session_config("client", connect=[endpoint])


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
