"""`mkctl release` where the bus does not answer."""

from __future__ import annotations

import asyncio

import pytest

from mkdaemon.bus.localsocket import socket_folders, socket_name
from mkdaemon.cli.mkctl import release
from mkdaemon.cli.mkctl.connection import Connection
from mkdaemon.daemon.localsocket import LocalSocket
from mkdaemon.errors import CommandRejectedError, MkError
from mkdaemon.telemetry.command import CommandResult
from mkdaemon.telemetry.control import ReleaseReport
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.status import Status

HERE = Connection(vehicle="alone", connect="tcp/127.0.0.1:7999")
DONE = {"status": "confirmed", "sent": 5, "confirmed": 5, "reason": "enough"}


@pytest.fixture
async def asked():
    """What the daemon's socket was asked."""
    asked = []

    async def answer(suffix, payload):
        asked.append(suffix)
        return CommandResult(status=Status.ACCEPTED, reply=DONE)

    async with LocalSocket(answer).serve(socket_folders()[0] / socket_name(HERE.vehicle, HERE.connect)):
        yield asked


def bus_that(monkeypatch, outcome):
    """A bus that never answers (None), fails or answers."""

    async def over_bus(connection, reason):
        if outcome is None:
            await asyncio.Event().wait()
        if isinstance(outcome, Exception):
            raise outcome
        return outcome

    monkeypatch.setattr(release, "_release_over_bus", over_bus)


@pytest.mark.parametrize(
    "outcome", [None, MkError("nobody answers"), refuse(Token.BUSY, detail="too many queries wait for an answer")]
)
async def test_a_bus_that_does_not_answer_leaves_the_socket(monkeypatch, asked, capsys, outcome):
    monkeypatch.setattr(release, "BUS_TIME", 0.05)
    bus_that(monkeypatch, outcome)
    assert await release.release(connection=HERE) == 0
    assert asked == ["do/release"]
    assert "FlightCtrl confirmed it" in capsys.readouterr().out


async def test_a_bus_that_answers_is_enough(monkeypatch, asked):
    bus_that(monkeypatch, ReleaseReport.model_validate(DONE))
    assert await release.release(connection=HERE) == 0
    assert asked == []


async def test_a_refusal_of_the_bus_counts(monkeypatch, asked):
    bus_that(monkeypatch, CommandRejectedError("timeout", "no end in 5 s.", "Look."))
    with pytest.raises(CommandRejectedError):
        await release.release(connection=HERE)
    assert asked == []


async def test_without_a_socket_the_bus_has_the_last_word(monkeypatch):
    bus_that(monkeypatch, MkError("nobody answers"))
    with pytest.raises(MkError, match="nobody answers"):
        await release.release(connection=HERE)
