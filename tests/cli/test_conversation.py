from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from typing import Any

import pytest

from mkdaemon.cli.mkctl.conversation import converse, request
from mkdaemon.cli.mkctl.waypoints import _guarded
from mkdaemon.client import Answer
from mkdaemon.client.samples import message_from
from mkdaemon.errors import CommandRejectedError, MkError, ProtocolError
from mkdaemon.protocol.messages import SettingsRequest, VersionRequest
from mkdaemon.protocol.procedures import Patience, Procedure
from mkdaemon.protocol.procedures.settings import backup_settings
from mkdaemon.protocol.procedures.steps import Ask, Pause, Progress
from mkdaemon.protocol.procedures.waypoints import upload_points
from mkdaemon.protocol.wire import MESSAGES, Board, Direction, WireMessage

from ..protocol.procedures.talk import FlightCtrl, NaviCtrl, Reply
from ..protocol.procedures.test_waypoints import route

TIMEOUT = Answer("timeout", {}, "timeout", "fc did not answer.", "Check.")


class Daemon:
    """Answers as the daemon does: a map of fields, or a refusal."""

    def __init__(self, board: Callable[[WireMessage], Reply], refusals: list[Answer | None] | None = None) -> None:
        self.board = board
        self.refusals = refusals or []
        self.asked: list[tuple[str, str, dict[str, Any]]] = []

    async def command(self, target: str, name: str, fields: Mapping[str, Any] | None = None) -> Answer:
        given = dict(fields or {})
        self.asked.append((target, name, dict(given)))
        refusal = self.refusals.pop(0) if self.refusals else None
        if refusal is not None:
            return refusal
        given.pop("confirm", None)
        place = Board[target.upper()]
        for (board, _, _), cls in MESSAGES.items():
            if board is place and cls.spec.key == name and cls.model_fields.keys() >= given.keys():
                if cls.spec.direction is not Direction.TO_BOARD:
                    continue
                reply = self.board(cls(**given))
                await asyncio.sleep(0)
                return TIMEOUT if reply is None else _accepted(reply)
        raise AssertionError(name)


def _accepted(reply: WireMessage) -> Answer:
    return Answer("accepted", _as_msgpack(reply), reply_type=f"{type(reply).__name__}.v1")


def _as_msgpack(reply: WireMessage) -> dict[str, Any]:
    """Arrays come back from the bus as lists."""
    return {name: list(value) if isinstance(value, tuple) else value for name, value in reply.__dict__.items()}


async def test_an_upload_over_queries_is_the_same_procedure() -> None:
    board, seen = NaviCtrl(), list[Progress]()
    done = await converse(Daemon(board), upload_points(route(7), Patience(3)), seen.append)
    assert (done.count, len(board.points), seen[-1].what) == (7, 7, "verified")


async def test_a_timeout_is_asked_again_and_a_busy_daemon_too() -> None:
    busy = Answer("busy", {}, "busy", "two commands are being worked on.", "Try again.")
    daemon = Daemon(FlightCtrl(), [TIMEOUT, busy])
    backup = await converse(daemon, backup_settings(Patience(3)))
    assert backup.active == 3
    assert [name for _, name, _ in daemon.asked[:4]] == ["version_request"] * 3 + ["settings_request"]


async def test_dangerous_requests_carry_the_confirmation_and_others_do_not() -> None:
    daemon = Daemon(FlightCtrl())
    await request(daemon, Board.FC, SettingsRequest(index=2))
    await request(daemon, Board.FC, VersionRequest())
    assert [fields for _, _, fields in daemon.asked] == [{"index": 2, "confirm": True}, {}]


async def test_an_upload_without_the_flag_carries_no_confirmation() -> None:
    daemon = Daemon(NaviCtrl())
    await converse(daemon, upload_points(route(2), Patience(1)), confirm=False)
    assert not any("confirm" in fields for _, _, fields in daemon.asked)


async def test_a_refusal_ends_the_procedure_after_it_has_cleaned_up() -> None:
    """Motors start during a backup: the sets cannot be read, and nobody can prove the live set."""
    denied = Answer("denied", {}, "motors_running", "motors are running.", "Stop them.")
    # version, active twice, set 1 twice, then the refusal
    board = FlightCtrl(active=2)
    with pytest.raises(CommandRejectedError) as caught:
        await converse(Daemon(board, [None] * 5 + [denied]), backup_settings(Patience(2)))
    assert caught.value.token == "motors_running"
    assert board.live == board.sets[2]


async def test_an_interruption_lets_the_procedure_leave_the_board_as_it_was() -> None:
    board = FlightCtrl(active=4)
    reading = asyncio.Event()

    def talk(message: WireMessage) -> Reply:
        if isinstance(message, SettingsRequest) and message.index == 2:
            reading.set()
        return board(message)

    task = asyncio.create_task(converse(Daemon(talk), backup_settings(Patience(2))))
    await reading.wait()
    task.cancel()
    with pytest.raises(MkError, match="interrupted"):
        await task
    assert board.live == board.sets[4]


async def test_an_upload_that_does_not_come_to_its_end_says_what_is_left() -> None:
    def deaf(message: WireMessage) -> Reply:
        return None

    task = asyncio.create_task(
        _guarded(Daemon(deaf), upload_points(route(3), Patience(1)), in_flight=True)  # type: ignore[arg-type]
    )
    with pytest.raises(MkError, match="the board's list may be incomplete: repeat, or `mkctl waypoints clear`"):
        await task


async def test_no_daemon_is_told_through_the_procedure() -> None:
    class Nobody:
        async def command(self, target: str, name: str, fields: Mapping[str, Any] | None = None) -> Answer:
            raise MkError("no daemon at tcp/127.0.0.1:7447")

    with pytest.raises(MkError, match="no daemon"):
        await converse(Nobody(), backup_settings(Patience(2)))


async def test_pauses_and_answers_that_do_not_fit() -> None:
    def procedure() -> Procedure[WireMessage | None]:
        yield Pause(0.0)
        return (yield Ask(Board.FC, VersionRequest(), lambda message: False, 0.1))

    assert await converse(Daemon(FlightCtrl()), procedure()) is None


@pytest.mark.parametrize("cls", dict.fromkeys(MESSAGES.values()), ids=lambda cls: cls.__name__)
def test_every_answer_survives_the_bus(cls: type[WireMessage]) -> None:
    if cls.spec.direction is not Direction.FROM_BOARD:
        assert cls.spec.direction is Direction.TO_BOARD
        return
    wanted = cls.decode(bytes(7 * n % 251 for n in range(cls.spec.size)))
    again = message_from(f"{cls.__name__}.v1", _as_msgpack(wanted))
    assert again.encode() == wanted.encode()


@pytest.mark.parametrize("kind", ["Label.v1", "Colour.v1", None])
def test_what_nobody_knows_is_named(kind: str | None) -> None:
    with pytest.raises(ProtocolError, match=rf"answers with {kind} \(index, colour\), unknown here; update mkctl"):
        message_from(kind, {"index": 1, "colour": 2})
