"""MAVLink commands: what each does to a MikroKopter, and what is answered.

Every COMMAND_LONG and COMMAND_INT is answered at once, or with IN_PROGRESS at once and every half second until it is
decided; a refusal's words follow as STATUSTEXT. Source: https://mavlink.io/en/services/command.html
"""

from __future__ import annotations

import asyncio
import math
from collections import OrderedDict
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any, Final

from mkdaemon.errors import CommandRejectedError, ManoeuvreError, MkError, NotEngagedError
from mkdaemon.gateways.faults import Faults
from mkdaemon.gateways.mavlink.dialect import Message, mavlink
from mkdaemon.gateways.mavlink.stations import By
from mkdaemon.gateways.mavlink.texts import INFO, WARNING, Notify, words_of
from mkdaemon.telemetry.refusals import Token
from mkdaemon.telemetry.status import Status

AT_ONCE: Final = 0.25
"""A command that is not decided within this is in progress [s]."""
PROGRESS: Final = 0.5
"""Between two IN_PROGRESS [s]; MAVSDK waits half a second for an answer."""
_REMEMBERED: Final = 64
"""Answers kept for a command that is repeated because its answer was lost."""
_MOST_RUNNING: Final = 16
LOCAL_FRAMES: Final = frozenset({mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_LOCAL_FRD})
"""Frames of a command whose place is the daemon's to fly."""
LOCAL_SCALE: Final = 1e4
"""Of a place in a local frame, where MAVLink has whole numbers [1/m]."""
_GLOBAL_SCALE: Final = 1e7
_MODES: Final = frozenset({mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_DO_SET_STANDARD_MODE})
"""Commands that ask for a mode: HEARTBEAT says when it is entered, STATUSTEXT why it is not."""
_NOT_GIVEN: Final = 0x7FFF_FFFF
"""Fifth and sixth number of a COMMAND_INT that are not given."""
_LATER: Final = frozenset(
    {
        *(Token.FLYING, Token.LEASE_HELD, Token.NOT_READY, Token.LINK_DOWN, Token.SLOW_PATH),
        *(Token.DISCOVERING, Token.CAMERA_OPENING, Token.MOTORS_UNKNOWN),
    }
)
"""Refusals that may pass by themselves."""


_BY_STATUS: Final = {
    Status.BUSY: mavlink.MAV_RESULT_TEMPORARILY_REJECTED,
    Status.UNSUPPORTED: mavlink.MAV_RESULT_UNSUPPORTED,
    Status.TIMEOUT: mavlink.MAV_RESULT_FAILED,
}


@dataclass(frozen=True, slots=True)
class Asked:
    """A command as both messages carry it.

    Attributes:
        by: who sent it.
        command: of `MAV_CMD`.
        params: seven numbers; of a COMMAND_INT the fifth and sixth are scaled as its frame says, and are so here.
        frame: of `MAV_FRAME`; None for a COMMAND_LONG.
        confirmation: how often it was repeated.
    """

    by: By
    command: int
    params: tuple[float, ...]
    frame: int | None
    confirmation: int

    def number(self, index: int) -> float | None:
        """A parameter, counted from 1; None where it is NaN, the mark of one that is not given."""
        value = self.params[index - 1]
        return value if math.isfinite(value) else None


@dataclass(frozen=True, slots=True)
class CommandAnswered:
    """What becomes of a command.

    Attributes:
        result: of `MAV_RESULT`.
        words: text for the station that asked; empty for none.
    """

    result: int
    words: str = ""


ACCEPTED: Final = CommandAnswered(int(mavlink.MAV_RESULT_ACCEPTED))
UNSUPPORTED: Final = CommandAnswered(int(mavlink.MAV_RESULT_UNSUPPORTED))


def accepted(words: str = "") -> CommandAnswered:
    """It is done, or begun."""
    return CommandAnswered(int(mavlink.MAV_RESULT_ACCEPTED), words)


def denied(words: str) -> CommandAnswered:
    """It cannot be done."""
    return CommandAnswered(int(mavlink.MAV_RESULT_DENIED), words)


def asked_from(by: By, message: Message) -> Asked:
    """Read a COMMAND_LONG or COMMAND_INT."""
    is_int = message.get_type() == "COMMAND_INT"
    if is_int:
        scale = LOCAL_SCALE if message.frame in LOCAL_FRAMES else _GLOBAL_SCALE
        last = (_place(message.x, scale), _place(message.y, scale), message.z)
    else:
        last = (message.param5, message.param6, message.param7)
    return Asked(
        by,
        message.command,
        (message.param1, message.param2, message.param3, message.param4, *last),
        message.frame if is_int else None,
        0 if is_int else message.confirmation,
    )


def _place(number: int, scale: float) -> float:
    return math.nan if number == _NOT_GIVEN else number / scale


Handler = Callable[[Asked], Awaitable[CommandAnswered] | CommandAnswered]
"""Does a command; raises an `MkError` for a refusal."""


class CommandDesk:
    """Answers commands; the same one asked again while it runs, or because its answer was lost, is done once."""

    def __init__(self, handlers: dict[int, Handler], notify: Notify, faults: Faults) -> None:
        """Answer commands.

        Args:
            handlers: by the number of the command; others are unsupported.
            notify: tells a ground station why.
            faults: counts what a handler fails by.
        """
        self._handlers, self._notify, self._faults = handlers, notify, faults
        self._running: dict[tuple[Any, ...], asyncio.Task[None]] = {}
        self._answered: OrderedDict[tuple[Any, ...], CommandAnswered] = OrderedDict()

    def take(self, asked: Asked) -> None:
        """Do a command and answer it."""
        key = (asked.by, asked.command)
        if key in self._running:
            _acknowledge(asked, _meanwhile(asked))
            return
        done = self._answered.get((*key, asked.params))
        if asked.confirmation > 0 and done is not None:
            _acknowledge(asked, done.result)
            return
        made = self._begin(asked)
        if isinstance(made, CommandAnswered):
            self._answer(asked, key, made)
        else:
            self._running[key] = asyncio.create_task(self._run(asked, key, made), name=f"command {asked.command}")

    def _begin(self, asked: Asked) -> Awaitable[CommandAnswered] | CommandAnswered:
        handler = self._handlers.get(asked.command)
        if handler is None:
            return UNSUPPORTED
        if len(self._running) >= _MOST_RUNNING:
            return CommandAnswered(int(mavlink.MAV_RESULT_TEMPORARILY_REJECTED), "too many commands at once")
        try:
            return handler(asked)
        except Exception as error:  # noqa: BLE001  # a fault ends this command
            return self._answer_of(asked, error)

    async def close(self) -> None:
        """End what runs."""
        for task in self._running.values():
            task.cancel()
        await asyncio.gather(*self._running.values(), return_exceptions=True)

    async def _run(self, asked: Asked, key: tuple[Any, ...], work: Awaitable[CommandAnswered]) -> None:
        doing = asyncio.ensure_future(work)
        patience = AT_ONCE
        try:
            while not (await asyncio.wait({doing}, timeout=patience))[0]:
                _acknowledge(asked, _meanwhile(asked))
                patience = PROGRESS
                if asked.command in _MODES:
                    break
            self._finish(asked, key, await doing, is_late=patience == PROGRESS)
        except Exception as error:  # noqa: BLE001  # a fault ends this command
            self._finish(asked, key, self._answer_of(asked, error), is_late=patience == PROGRESS)
        finally:
            doing.cancel()
            self._running.pop(key, None)

    def _finish(self, asked: Asked, key: tuple[Any, ...], answer: CommandAnswered, *, is_late: bool) -> None:
        """Answer a command; a mode that was accepted meanwhile is not answered again, only its words are sent."""
        if not (is_late and asked.command in _MODES):
            self._answer(asked, key, answer)
        elif answer.words:
            self._report(asked, answer)

    def _report(self, asked: Asked, answer: CommandAnswered) -> None:
        is_done = answer.result == mavlink.MAV_RESULT_ACCEPTED
        self._notify(asked.by.station, answer.words, INFO if is_done else WARNING)

    def _answer_of(self, asked: Asked, error: Exception) -> CommandAnswered:
        """The answer where a handler raised."""
        if isinstance(error, MkError):
            return answer_of(error)
        self._faults.note(f"command {asked.command}", error)
        return CommandAnswered(int(mavlink.MAV_RESULT_FAILED), f"command {asked.command}: a defect of the gateway")

    def _answer(self, asked: Asked, key: tuple[Any, ...], answer: CommandAnswered) -> None:
        self._answered[(*key, asked.params)] = answer
        while len(self._answered) > _REMEMBERED:
            self._answered.popitem(last=False)
        if answer.words:
            self._report(asked, answer)
        _acknowledge(asked, answer.result)


def answer_of(error: MkError) -> CommandAnswered:
    """The answer that an error means: denied, or for the moment, or tried and not done."""
    if isinstance(error, CommandRejectedError):
        status = error.token.status if isinstance(error.token, Token) else Status.DENIED
        result = _BY_STATUS.get(status, mavlink.MAV_RESULT_DENIED)
        if error.token in _LATER:
            result = mavlink.MAV_RESULT_TEMPORARILY_REJECTED
        return CommandAnswered(int(result), words_of(error))
    if isinstance(error, NotEngagedError | ManoeuvreError):
        return CommandAnswered(int(mavlink.MAV_RESULT_TEMPORARILY_REJECTED), str(error))
    return CommandAnswered(int(mavlink.MAV_RESULT_FAILED), str(error))


def _meanwhile(asked: Asked) -> int:
    """The result of a command that is being done: a mode is accepted, for MAVSDK 4.1 crashes at IN_PROGRESS there."""
    return int(mavlink.MAV_RESULT_ACCEPTED if asked.command in _MODES else mavlink.MAV_RESULT_IN_PROGRESS)


def _acknowledge(asked: Asked, result: int) -> None:
    asked.by.send(mavlink.MAVLink_command_ack_message(asked.command, result, 255, 0, *asked.by.program))
