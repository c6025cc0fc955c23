"""Clients that stop or vanish while bytes wait for them hold up nobody else."""

from __future__ import annotations

import socket
import struct
import threading
from contextlib import ExitStack, closing, contextmanager, suppress

import zenoh

from lab.rigs.waiting import PATIENCE, wait_until
from mkdaemon.bus.linger import LingerSweep
from mkdaemon.bus.session import close_session, session_config
from tests.bus.support import client, free_endpoint

LINGER = struct.Struct("ii")
LEASE = 0.5
"""Of the clients that vanish [s]: so long after their last word their connections are closed."""
HELD_UP = 5.0
"""Zenoh waits for twice as long [s]."""


def lingering(one):
    return LINGER.unpack(one.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, LINGER.size))


def call(take):
    return zenoh.handlers.Callback(take, indirect=False)


class Relay:
    """A machine between one client and a server that stops: a notebook that sleeps, a switch without power."""

    def __init__(self, server):
        host, _, port = server.removeprefix("tcp/").rpartition(":")
        self.server, self.is_stopped = (host, int(port)), False
        self.sockets = [socket.create_server(("127.0.0.1", 0))]
        self.endpoint = f"tcp/127.0.0.1:{self.sockets[0].getsockname()[1]}"
        threading.Thread(target=self.serve, daemon=True).start()

    def serve(self):
        with suppress(OSError):
            ends = (self.sockets[0].accept()[0], socket.create_connection(self.server))
            self.sockets += ends
            for source, sink in (ends, ends[::-1]):
                threading.Thread(target=self.pass_on, args=(source, sink), daemon=True).start()

    def pass_on(self, source, sink):
        """Pass nothing on and read nothing once it is stopped; the connections stay."""
        with suppress(OSError):
            while (data := source.recv(65536)) and not self.is_stopped:
                sink.sendall(data)
            if not self.is_stopped:
                sink.shutdown(socket.SHUT_WR)

    def close(self):
        self.is_stopped = True
        for one in self.sockets:
            with suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
            one.close()


@contextmanager
def subscriber_behind_relay(endpoint, number):
    """A client that hears everything, until its relay is stopped."""
    with closing(Relay(endpoint)) as between:
        config = session_config("client", connect=[between.endpoint], patience=PATIENCE, lease=LEASE)
        with zenoh.open(config) as session, session.liveliness().declare_token(f"mk/t1/client/{number}"):
            session.declare_subscriber("mk/t1/**", call(lambda sample: None))
            yield between
            between.close()


async def test_setpoints_arrive_when_clients_have_vanished_without_a_word():
    endpoint, here, heard = free_endpoint(), set(), []
    server = zenoh.open(session_config("peer", listen=[endpoint], lease=PATIENCE))

    def token_changed(sample):
        (here.add if sample.kind == zenoh.SampleKind.PUT else here.discard)(str(sample.key_expr))

    server.declare_subscriber("mk/t1/setpoint/stick", call(heard.append))
    server.liveliness().declare_subscriber("mk/t1/client/*", call(token_changed))
    try:
        with client(endpoint) as pilot, ExitStack() as vanishing:
            relays = [vanishing.enter_context(subscriber_behind_relay(endpoint, number)) for number in range(4)]
            await wait_until(lambda: len(here) == len(relays))
            LingerSweep().sweep()
            for one in relays:
                one.is_stopped = True
            for _ in range(100):
                server.put("mk/t1/state/attitude", bytes(60_000))
            await wait_until(lambda: not here)
            heard.clear()
            pilot.put("mk/t1/setpoint/stick", b"sticks")
            await wait_until(lambda: heard, HELD_UP)
    finally:
        await close_session(server)


def test_only_sockets_that_would_wait_are_changed():
    with closing(socket.socket()) as waits, closing(socket.socket()) as resets, closing(socket.socket()) as plain:
        waits.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, LINGER.pack(1, 10))
        resets.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, LINGER.pack(1, 0))
        sweep = LingerSweep()
        assert sweep.sweep() >= 1
        assert [lingering(one)[0] for one in (waits, resets, plain)] == [0, 1, 0]
        waits.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, LINGER.pack(1, 10))
        assert sweep.sweep() == 0, "each is looked at once"
        assert waits.fileno() >= 0, "it is still open"
