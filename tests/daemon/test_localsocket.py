"""The Unix socket: releases with the answers of the bus, whoever else is connected, and only for whom it is meant."""

from __future__ import annotations

import asyncio
import json
import os
import stat

import pytest

from lab.rigs.waiting import wait_until
from mkdaemon.bus.codec import decode_map
from mkdaemon.bus.localsocket import REQUEST_BYTES, socket_folders, socket_name
from mkdaemon.client.localsocket import ask_locally, find_socket
from mkdaemon.daemon import localsocket
from mkdaemon.daemon.localsocket import CONNECTIONS, WORKED_ON, LocalSocket
from mkdaemon.errors import ConfigError, MkError
from mkdaemon.telemetry.command import CommandResult, refused
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.status import Status


class Desk:
    """Answers like the daemon's verbs."""

    def __init__(self):
        self.asked = []

    async def answer(self, suffix, payload):
        self.asked.append((suffix, decode_map(payload)))
        if suffix == "do/cancel":
            return refused(refuse(Token.NOT_LEASED))
        return CommandResult(status=Status.ACCEPTED, reply={"status": "confirmed"})


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run" / "mk1-7447.sock"


@pytest.fixture
async def desk(path):
    desk = Desk()
    async with LocalSocket(desk.answer).serve(path):
        yield desk


async def test_it_releases_with_the_answer_of_the_bus(desk, path):
    answer = await ask_locally(path, "release", "enough\nof this")
    assert answer.require() == {"status": "confirmed"}
    assert desk.asked == [("do/release", {"reason": "enough of this"})]


async def test_a_refusal_is_the_one_of_the_bus_and_other_verbs_are_refused(desk, path):
    answer = await ask_locally(path, "cancel")
    assert (answer.token, bool(answer.fix)) == (Token.NOT_LEASED, True)
    assert (await ask_locally(path, "lease")).token == Token.UNKNOWN_VERB
    assert [verb for verb, _ in desk.asked] == ["do/cancel"]


async def test_it_is_for_this_user_alone_or_for_a_group_that_exists(path):
    group = localsocket.grp.getgrgid(os.getgid()).gr_name
    for given, mode in ((None, 0o600), (group, 0o660)):
        async with LocalSocket(Desk().answer).serve(path, given):
            assert stat.S_IMODE(path.stat().st_mode) == mode
            assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700 or given
            assert path.stat().st_gid == os.getgid()
    with pytest.raises(ConfigError, match="no group"):
        async with LocalSocket(Desk().answer).serve(path, "nobody-has-this-group"):
            pass


async def test_a_silent_connection_is_closed(desk, path, monkeypatch):
    monkeypatch.setattr(localsocket, "REQUEST_TIME", 0.05)
    reader, writer = await asyncio.open_unix_connection(str(path))
    assert await reader.read() == b""
    writer.close()


@pytest.mark.parametrize("request_line", [b"x" * (4 * REQUEST_BYTES), b"\n", b"\0\xff\xfe\n", b"release \xff\n"])
async def test_whatever_is_sent_it_answers_or_hangs_up_and_goes_on(desk, path, request_line):
    reader, writer = await asyncio.open_unix_connection(str(path))
    writer.write(request_line)
    writer.write_eof()
    answer = await reader.read()
    writer.close()
    assert answer == b"" or json.loads(answer)["status"]
    assert (await ask_locally(path, "release")).is_accepted


async def test_the_socket_of_a_killed_daemon_is_taken_over_and_that_of_a_living_one_is_not(desk, path):
    with pytest.raises(MkError, match="another daemon"):
        async with LocalSocket(desk.answer).serve(path):
            pass
    dead = path.with_name("dead.sock")
    localsocket._listen(dead, None).close()
    async with LocalSocket(desk.answer).serve(dead):
        assert (await ask_locally(dead, "release")).is_accepted
    assert not dead.exists()


async def test_nobody_there_is_one_error(tmp_path):
    with pytest.raises(MkError, match="No such file"):
        await ask_locally(tmp_path / "none.sock", "release")


async def test_a_client_finds_it_and_trusts_no_other_users_folder(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    endpoint = "tcp/127.0.0.1:7447"
    path = socket_folders()[0] / socket_name("mk1", endpoint)
    assert find_socket("mk1", endpoint) is None
    async with LocalSocket(Desk().answer).serve(path):
        assert find_socket("mk1", endpoint) == path
        assert find_socket("mk2", endpoint) is None
        assert find_socket("mk1", "tcp/192.168.7.1:7447") is None
        monkeypatch.setattr(os, "getuid", lambda: 12345)
        if path.parent.stat().st_uid != 0:
            assert find_socket("mk1", endpoint) is None
    await wait_until(lambda: not path.exists())


async def test_a_folder_of_another_user_is_no_place_for_the_socket(path, monkeypatch):
    path.parent.mkdir(parents=True)
    if os.getuid() == 0:  # what belongs to root is everybody's
        os.chown(path.parent, 4242, -1)
    monkeypatch.setattr(localsocket.os, "getuid", lambda: 4243)
    with pytest.raises(MkError, match="belongs to another user"):
        async with LocalSocket(Desk().answer).serve(path):
            pytest.fail("it listens")
    assert not path.exists()


async def test_who_has_most_silent_connections_loses_one(monkeypatch, path):
    """A client that has not asked yet is not shut out by those of another process."""
    monkeypatch.setattr(localsocket, "REQUEST_TIME", 60.0)  # a busy machine takes longer to connect them all
    numbers = iter([1] + [2] * 3 * CONNECTIONS)
    monkeypatch.setattr(localsocket, "_process_of", lambda connection: next(numbers, 3))
    async with LocalSocket(Desk().answer).serve(path):
        reader, writer = await asyncio.open_unix_connection(str(path))
        others = [await asyncio.open_unix_connection(str(path)) for _ in range(3 * CONNECTIONS)]
        assert (await ask_locally(path, "cancel")).token == Token.NOT_LEASED  # taken after them all
        writer.write(b"release\n")
        assert json.loads(await reader.readline())["status"] == "accepted"
        for _, other in [*others, (None, writer)]:
            other.close()


async def test_requests_that_are_worked_on_shut_out_no_release(path):
    gate = asyncio.Event()

    async def answer(suffix, payload):
        if suffix == "do/cancel":
            await gate.wait()
        return CommandResult(status=Status.ACCEPTED)

    async with LocalSocket(answer).serve(path):
        cancels = [asyncio.ensure_future(ask_locally(path, "cancel")) for _ in range(2 * WORKED_ON)]
        ended = asyncio.as_completed(cancels)
        assert {(await next(ended)).token for _ in range(WORKED_ON)} == {Token.BUSY}
        assert (await ask_locally(path, "release")).is_accepted
        gate.set()
        answers = await asyncio.gather(*cancels)
        assert sum(one.is_accepted for one in answers) == WORKED_ON
