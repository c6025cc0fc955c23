"""Cancellation, a lost port and refusals crossed at every step of a session, not by luck.

A session with a scripted board runs in virtual time, and its loop counts its turns. Every await of the link is
resumed in one of them, so a fault injected before each turn meets every await in every state.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import suppress
from functools import cache, partial

import pytest

from lab.rigs.linkrig import Log
from lab.rigs.sticks import build_sticks
from mkdaemon.clock import Clock
from mkdaemon.config.link import LinkConfig
from mkdaemon.errors import CommandRejectedError, LinkError, LinkLostError
from mkdaemon.link.discovery import discover
from mkdaemon.link.link import Link
from mkdaemon.protocol.framing import Frame, FrameDecoder, encode_frame
from mkdaemon.protocol.messages import ExternControlV2, LabelRequest
from mkdaemon.protocol.wire import Board
from mkdaemon.virtualtime import VirtualLoop, end_loop

ANSWER_TIME = 0.005
"""Of the scripted board [s]."""
SESSION = 0.4
"""Length of a session before anything is injected [s]; with a NaviCtrl all of its discovery is in it."""
VERSION_FC = bytes((2, 12, 11, 0, 0, 0, 0, 0, 0, 0, 0, 0))
VERSION_NC = bytes((0, 24, 11, 0, 0, 0, 0, 0, 0, 0, 0, 0))


class CountingLoop(VirtualLoop):
    """Counts its turns, and lets something happen before chosen ones."""

    def __init__(self) -> None:
        super().__init__()
        self.turns = 0
        self.plan: dict[int, list[Callable[[], None]]] = {}

    def _run_once(self) -> None:
        self.turns += 1
        for happen in self.plan.pop(self.turns, ()):
            happen()
        super()._run_once()  # type: ignore[misc]  # not in the stub of the loop


class ScriptedPort:
    """A board that answers version requests, stick frames and labels at once; see `Port`."""

    name, descriptor, is_recording, backlog = "scripted", 0, False, 0

    def __init__(self, board: Board) -> None:
        self._loop = asyncio.get_running_loop()
        self._decoder = FrameDecoder()
        self._inbox = b""
        self._arrived = asyncio.Event()
        self._board, self._end = board, board
        self.loss = ""
        self.is_closed = False
        self.written: list[Frame] = []

    async def read(self) -> bytes:
        while not self._inbox:
            if self.loss:
                raise LinkLostError(self.loss)
            self._arrived.clear()
            await self._arrived.wait()
        data, self._inbox = self._inbox, b""
        return data

    def write(self, data: bytes) -> None:
        if self.loss:
            raise LinkLostError(self.loss)
        if b"\x1b" in data:
            self._end = self._board
        for item in self._decoder.feed(data):
            if isinstance(item, Frame):
                self.written.append(item)
                self._answer(item)

    def _answer(self, frame: Frame) -> None:
        address, version = (1, VERSION_FC) if self._end is Board.FC else (2, VERSION_NC)
        if frame.id == "v":
            self._say(encode_frame(address, "V", version))
        elif frame.id == "b" and self._end is Board.FC:
            self._say(encode_frame(1, "B", frame.payload[5:6] + bytes(2)))
        elif frame.id == "a":
            self._say(encode_frame(address, "A", frame.payload[:1] + b"name" + bytes(13)))
        elif frame.id == "z":
            self._say(encode_frame(2, "Z", frame.payload[:2] + bytes(1)))
        elif frame.id == "u":
            self._end = Board.FC if frame.payload[0] == 0 else Board.MAG

    def _say(self, raw: bytes) -> None:
        self._loop.call_later(ANSWER_TIME, self._deliver, raw)

    def _deliver(self, raw: bytes) -> None:
        self._inbox += raw
        self._arrived.set()

    def discard(self) -> None:
        pass

    async def drain(self) -> None:
        await asyncio.sleep(0.001)

    async def close(self) -> None:
        self.loss = self.loss or "closed"
        self.is_closed = True
        self._arrived.set()
        await asyncio.sleep(0)

    def lose(self) -> None:
        """The device disappears."""
        self.loss = "unplugged"
        self._arrived.set()


class Session:
    """A link, a flight loop that steers whenever the line says that it may, and somebody who asks.

    Attributes:
        raised: what `send_setpoint` raised; nothing, whatever happens.
        may_open: the device is there.
    """

    def __init__(self, board: Board) -> None:
        self.loop = CountingLoop()
        self.raised: list[BaseException] = []
        self.may_open = True
        self.ports: list[ScriptedPort] = []
        self.task: asyncio.Task[None] | None = None
        self._board = board
        cfg = LinkConfig.model_validate(
            {"port": "/dev/scripted", "wait_for_port": True, "reopen_min": 0.02, "reopen_max": 0.05}
        )
        self.link = Link(
            cfg,
            Log(),
            opener=self._open,
            clock=Clock(monotonic=self.loop.time),
            motors_running=lambda now, within: False,
        )

    async def _open(self, url: str, *, baud: int) -> ScriptedPort:
        await asyncio.sleep(0.001)
        if not self.may_open:
            raise LinkLostError("not there")
        self.ports.append(ScriptedPort(self._board))
        return self.ports[-1]

    def steer(self) -> None:
        """Hand a frame in, whatever the line says."""
        build = build_sticks(self.link.dialect.extern_control or ExternControlV2, throttle=60)
        try:
            self.link.send_setpoint(build, deadline=self.loop.time() + 0.1)
        except Exception as error:  # noqa: BLE001 - every one is a fault
            self.raised.append(error)

    async def _fly(self) -> None:
        """What `FlightControl.run` does: it asks the line, and hands a frame in."""
        while True:
            if self.link.control_line().obstacle is None:
                self.steer()
            await asyncio.sleep(0.02)

    async def _ask(self) -> None:
        while True:
            with suppress(LinkError, CommandRejectedError):
                await self.link.request(LabelRequest(index=3), timeout=0.05, retries=0)
            await asyncio.sleep(0.03)

    async def _main(self, seconds: float) -> bool:
        task = self.task = asyncio.create_task(self.link.run(discover), name="link")
        others = [asyncio.create_task(self._fly()), asyncio.create_task(self._ask())]
        await asyncio.wait([task], timeout=seconds)
        has_ended = task.done()
        for other in (task, *others):
            other.cancel()
        await asyncio.wait(others)
        await asyncio.wait([task], timeout=1.0)
        return has_ended

    def run(self, seconds: float = SESSION) -> bool:
        """Play it; returns whether the link ended by itself, or by what was injected."""
        try:
            return self.loop.run_until_complete(self._main(seconds))
        finally:
            end_loop(self.loop)

    # -- what can be injected -------------------------------------------------------------------------------------

    def cancel(self) -> None:
        """Whoever started the link ends it."""
        if self.task is not None:
            self.task.cancel()

    def lose_port(self) -> None:
        """The device disappears, and the reader is told."""
        if self.ports:
            self.ports[-1].lose()

    def fail_writes(self) -> None:
        """The device disappears, and the next write finds out."""
        if self.ports:
            self.ports[-1].loss = "unplugged"

    def release(self) -> None:
        """Somebody releases the aircraft."""
        self.link.release("test")

    def stand_still(self) -> None:
        """Nothing runs for so long that the boards may be others."""
        self.loop.let_pass(1.2)


@cache
def turns_of(board: Board) -> int:
    """Turns of a session that nothing disturbs."""
    session = Session(board)
    assert not session.run()
    assert session.link.dialect.extern_control is not None, "the session reaches stick frames"
    assert any(frame.id == "b" for frame in session.ports[0].written)
    assert session.raised == []
    return session.loop.turns


OTHER_TURNS = (-3, -2, -1, 1, 2, 3)
"""So many turns after a cancellation a port may be lost, too; less than nothing for before."""
LOSSES = (Session.lose_port, Session.fail_writes)
BOARDS = pytest.mark.parametrize("board", [Board.FC, Board.NC], ids=["fc", "nc"])


def assert_cancelled(session: Session, turn: int) -> None:
    """The link has ended because it was cancelled, and holds no port."""
    assert session.run(SESSION + 2.0), f"the link lives on after turn {turn}"
    assert session.task is not None
    assert session.task.cancelled(), turn
    assert all(port.is_closed for port in session.ports), turn
    assert session.raised == [], turn


@BOARDS
@pytest.mark.parametrize("lose", LOSSES)
@pytest.mark.parametrize("may_open", [True, False], ids=["", "gone"])
def test_a_cancellation_ends_the_link_whatever_port_error_comes_with_it(board, lose, may_open):
    """The port is lost three turns before, or in the same turn as the cancellation, before or after it, or later."""
    step = {(Session.lose_port, True): 9, (Session.fail_writes, True): 13}.get((lose, may_open), 19)
    first = 4 if board is Board.FC else 5  # what both boards wait for is met before every turn
    for turn in range(first, turns_of(board), step):
        for after in (0,) if turn % 4 else (0, OTHER_TURNS[turn // 4 % 6]):
            session = Session(board)

            def disappear(session: Session = session) -> None:
                session.may_open = may_open
                lose(session)

            session.loop.plan.setdefault(turn + after, []).append(disappear)
            session.loop.plan.setdefault(turn, []).insert(turn % 2, session.cancel)
            assert_cancelled(session, turn)


@BOARDS
@pytest.mark.parametrize("later", [1, 20])
def test_a_second_cancellation_ends_an_exit_that_takes_its_time(board, later):
    for turn in range(4, turns_of(board), 29):
        session = Session(board)
        session.loop.plan[turn] = session.loop.plan[turn + later] = [session.cancel]
        assert_cancelled(session, turn)


@BOARDS
@pytest.mark.parametrize("lose", LOSSES)
def test_a_port_error_alone_ends_nothing_and_the_next_port_begins_with_a_release(board, lose):
    for turn in range(4, turns_of(board), 29):
        session = Session(board)
        session.loop.plan[turn] = [partial(lose, session)]
        assert not session.run(SESSION + 0.5), turn
        for port in session.ports:
            letters = [frame.id for frame in port.written]
            assert letters[: letters.index("b")] in ([], ["v"]) if "b" in letters else letters in ([], ["v"]), turn
        assert session.ports[-1].written, turn
        assert session.raised == [], turn


@BOARDS
@pytest.mark.parametrize("happen", [*LOSSES, Session.release, Session.stand_still, Session.cancel])
def test_handing_in_a_frame_never_raises_whatever_the_line_is_doing(board, happen):
    """The refusal of a frame is a value: nothing of it may end the loop that flies."""
    for turn in range(4, turns_of(board), 37):
        session = Session(board)
        for later in range(6):
            session.loop.plan[turn + later] = [session.steer]
        session.loop.plan[turn + 2].insert(0, partial(happen, session))
        session.run(SESSION + 0.3)
        assert session.raised == [], turn
