"""MikroKopter requests as queries: `cmd/<board>/<message>` to a typed reply or a refusal."""

from __future__ import annotations

import asyncio
import difflib
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Final

from pydantic import ValidationError

from mkdaemon.bus.codec import Payload, first_mistake, schema_name
from mkdaemon.clock import Clock
from mkdaemon.config.commands import CommandsConfig
from mkdaemon.control.admission.beginnings import BoardRequest
from mkdaemon.control.events import Feed, MotorTestSent
from mkdaemon.control.vehicle import VehicleFacts
from mkdaemon.daemon.answering import answer_query
from mkdaemon.daemon.audit import Audit
from mkdaemon.daemon.discovery import require_discovery
from mkdaemon.daemon.procedures.interlock import Interlock
from mkdaemon.errors import CommandRejectedError, LinkLostError, RequestTimeoutError
from mkdaemon.link.discovery import PORTS, redirection
from mkdaemon.link.link import Link
from mkdaemon.link.procedures import is_behind, way_to
from mkdaemon.protocol.flags import RedirectPort
from mkdaemon.protocol.messages import Beep, Redirect, VersionRequest, WriteSettings
from mkdaemon.protocol.wire import MESSAGES, Board, Direction, WireMessage
from mkdaemon.telemetry.command import CommandResult, refused
from mkdaemon.telemetry.danger import Danger, Switch
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.status import Status

PASSAGE: Final = 5.0
"""How long a bare redirection lasts [s]; a client waits 15 s for an answer."""
MOTORS_FRESH: Final = 0.5
"""Largest age of the motors' state for a request that must not meet running motors [s]."""
MOTORS_WAIT: Final = 1.5
"""How long to wait for telemetry to say it again, where it is slower [s]."""
_BOARDS = {board.word: board for board in Board if board is not Board.ANY}


class BoardRequests:
    """Answers queries under `cmd/`."""

    def __init__(
        self,
        cfg: CommandsConfig,
        link: Link,
        facts: VehicleFacts,
        feed: Feed,
        audit: Audit,
        clock: Clock,
        interlock: Interlock,
    ) -> None:
        """Answer for one line.

        Args:
            cfg: what is enabled.
            link: the line.
            facts: what is known about the vehicle.
            feed: tells the flight core of a motor test.
            audit: hears of every command.
            clock: of the daemon.
            interlock: says what may be sent.
        """
        self._cfg = cfg
        self._interlock = interlock
        self._link = link
        self._facts, self._feed = facts, feed
        self._audit = audit
        self._clock = clock

    def reconfigure(self, cfg: CommandsConfig) -> None:
        """Take up what is enabled from now on."""
        self._cfg = cfg

    async def answer(self, suffix: str, payload: Payload) -> CommandResult:
        """Answer one query; every one is mirrored under `event/command`, whatever becomes of it."""

        async def work(fields: dict[str, Any]) -> CommandResult:
            try:
                return await self._ask(suffix, dict(fields))
            except LinkLostError as error:
                return self._link_down(error)

        return await answer_query(self._audit, suffix, payload, work)

    async def _ask(self, suffix: str, fields: dict[str, Any]) -> CommandResult:
        board, name = _place(suffix)
        confirmed = fields.pop("confirm", False) is True
        message = self._build(board, name, fields)
        danger = _danger_of(message)

        def admit() -> None:
            self._interlock.require(self._beginning(board, message, is_confirmed=confirmed, is_early=True))

        admit()
        if danger is not None:
            await require_discovery(self._link, self._facts.link)
            if danger.stopped:
                await self._wait_for_motors()
        running = self._facts.motors_running(self._clock.now(), MOTORS_FRESH)
        self._interlock.require(self._beginning(board, message, is_confirmed=confirmed), motors_running=running)
        try:
            return await self._send(board, message, admit, is_confirmed=confirmed)
        except CommandRejectedError as error:
            # A NaviCtrl confirms no redirection: one that the line lost is seen by the board that does not answer.
            if error.token != Token.BOARD_UNPROVEN or not is_behind(self._link, board, message):
                raise
        return await self._send(board, message, admit, is_confirmed=confirmed)

    async def _send(
        self, board: Board, message: WireMessage, admit: Callable[[], None], *, is_confirmed: bool
    ) -> CommandResult:
        async with way_to(self._link, board, message, admit):
            await self.prove_board(board, message)
            # Seconds may have passed: a client may hold the lease by now, or the pilot may have started the motors.
            self._interlock.require(self._beginning(board, message, is_confirmed=is_confirmed))
            if message.spec.danger is not None and message.spec.danger.turns_motors:
                self._feed(MotorTestSent(), self._clock.now())
            if isinstance(message, Redirect):
                return await self._pass_through(message.port, admit)
            return await self._converse(board, message)

    def _beginning(self, board: Board, message: WireMessage, **known: Any) -> BoardRequest:
        """A request as admission looks at it; `known`: further fields that the caller knows."""
        danger, dialect, spec = _danger_of(message), self._link.dialect, message.spec
        # Nothing on the line tells the fork from stock firmware: who enables its commands says that it is one.
        unsupported = None if spec.is_fork else dialect.unsupported.get((board, spec.key))
        read_only = dialect.read_only_reason if danger is not None else None
        if read_only is None and isinstance(message, WriteSettings):
            read_only = dialect.settings_read_only_reason
        return BoardRequest(
            board=board.word,
            name=spec.key,
            danger=danger,
            switches=frozenset(switch for switch in Switch if getattr(self._cfg, switch)),
            is_slow=self._is_slow(board, message, danger),
            is_to_flightctrl=board is Board.FC,
            unsupported=unsupported or "",
            read_only=read_only or "",
            deaf_time=message.deaf_time if isinstance(message, Beep) else 0.0,
            **known,
        )

    def _is_slow(self, board: Board, message: WireMessage, danger: Danger | None) -> bool:
        """Whether the request keeps stick frames from the aircraft while it runs.

        A board that writes, beeps or calibrates is deaf; a NaviCtrl that passes the line through sends nothing else;
        what must not meet running motors is no request for a flight either.
        """
        is_deaf = message.spec.policy(board).deaf > 0 or isinstance(message, Redirect)
        return is_deaf or is_behind(self._link, board, message) or (danger is not None and danger.stopped)

    async def _wait_for_motors(self) -> None:
        """If the motors' state is known, wait for a fresh report of it."""
        if self._facts.motors_running(self._clock.now()) is None:
            return
        with suppress(TimeoutError):
            async with asyncio.timeout(MOTORS_WAIT):
                # Telemetry is a state, not an event.
                while self._facts.motors_running(self._clock.now(), MOTORS_FRESH) is None:  # noqa: ASYNC110
                    await asyncio.sleep(0.02)

    async def check_step(self, board: Board, message: WireMessage) -> None:
        """Admit a step of a procedure, or refuse it; it waits while the boards are identified again.

        Args:
            board: the addressee.
            message: the request.

        Raises:
            CommandRejectedError: what admission says.
        """
        if _danger_of(message) is not None and self._link.is_up:
            await require_discovery(self._link, self._facts.link)
        self._interlock.require(self._beginning(board, message, is_confirmed=True, is_step=True))

    async def prove_board(self, board: Board, message: WireMessage) -> None:
        """Make sure that the board asked hears us, where the request needs that: another may read the same letter.

        Raises:
            CommandRejectedError: `board_unproven`, or what the link refuses.
        """
        danger = _danger_of(message)
        if danger is None or not danger.proven or self._link.is_proven(board):
            return
        try:
            await self._link.request(VersionRequest(), board=board)
        except (RequestTimeoutError, LinkLostError) as error:
            found = str(error)
        else:
            proof = self._link.proof
            found = "no board answered one" if proof is None else f"{proof.board.word} answered it"
            found = "" if self._link.is_proven(board) else found
        self._interlock.require(self._beginning(board, message, is_confirmed=True, is_step=True, unproven=found))

    async def _pass_through(self, port: RedirectPort, admit: Callable[[], None]) -> CommandResult:
        """Answer a bare redirection: it ends after a while, or the line would be lost for ever.

        Raises:
            CommandRejectedError: `not_redirectable`, `motors_not_known_off`.
        """
        async with redirection(self._link, PORTS[port], admit):
            await asyncio.sleep(PASSAGE)
        reason = (
            f"the line led to the {port.name} for {PASSAGE:g} s and is back; received bytes are under raw/rx. "
            "Requests to cmd/fc and cmd/mag are passed through automatically."
        )
        return CommandResult(status=Status.NOT_OBSERVABLE, reason=reason)

    def _build(self, board: Board, name: str, fields: dict[str, Any]) -> WireMessage:
        """Make the message from a client's fields, in the layout this aircraft speaks.

        Raises:
            CommandRejectedError: `unknown_message`, `bad_field`.
        """
        wanted = fields.pop("layout", None)
        layouts = [
            cls
            for (owner, _, _), cls in MESSAGES.items()
            if owner is board and cls.spec.key == name and cls.spec.direction is Direction.TO_BOARD
        ]
        if not layouts:
            raise refuse(Token.UNKNOWN_MESSAGE, board=board.word, name=name, near=_near(board, name))
        spoken = wanted or self._link.dialect.layouts.get((board, layouts[0].spec.id))
        layouts.sort(key=lambda cls: cls.spec.layout != spoken)
        if wanted is not None and layouts[0].spec.layout != wanted:
            known = ", ".join(cls.spec.layout for cls in layouts)
            raise refuse(Token.BAD_FIELD, name=name, detail=f"layout {wanted!r} is none of {known}")
        mistake: ValidationError | None = None
        for cls in layouts:
            try:
                return cls.model_validate(fields)
            except ValidationError as error:
                mistake = mistake or error
        assert mistake is not None
        raise refuse(Token.BAD_FIELD, name=layouts[0].__name__, detail=first_mistake(mistake)) from mistake

    async def _converse(self, board: Board, message: WireMessage) -> CommandResult:
        spec = message.spec
        try:
            if spec.reply is None:
                await self._link.send(message, board=board)
                return CommandResult(
                    status=Status.NOT_OBSERVABLE, reason=f"sent; {board.word} never answers {spec.key}."
                )
            reply = await self._link.request(message, board=board)
        except RequestTimeoutError as error:
            return refused(refuse(Token.TIMEOUT, board=board.word, name=spec.key, detail=str(error)))
        return CommandResult(status=Status.ACCEPTED, reply=dict(reply.__dict__), reply_type=schema_name(type(reply)))

    def _link_down(self, error: LinkLostError) -> CommandResult:
        state = self._facts.link
        condition = "absent" if state is None else state.condition.value
        return refused(refuse(Token.LINK_DOWN, state=condition, detail=str(error)))


def _danger_of(message: WireMessage) -> Danger | None:
    """What makes this request dangerous; None where it is harmless as it stands."""
    danger = message.spec.danger
    return danger if danger is not None and danger.applies(message.__dict__) else None


def _place(suffix: str) -> tuple[Board, str]:
    """Board and message of `cmd/<board>/<message>`."""
    parts = suffix.split("/")
    if len(parts) != 3 or parts[1] not in _BOARDS:
        raise refuse(
            Token.UNKNOWN_MESSAGE,
            board=parts[1] if len(parts) > 1 else "?",
            name=parts[-1],
            near="cmd/fc/..., cmd/nc/...",
        )
    return _BOARDS[parts[1]], parts[2]


def _near(board: Board, name: str) -> str:
    """What the client may have meant."""
    known = {cls.spec.key: owner for (owner, _, _), cls in MESSAGES.items() if cls.spec.direction is Direction.TO_BOARD}
    here = [key for (owner, _, _), cls in MESSAGES.items() if owner is board for key in [cls.spec.key] if key in known]
    if name in known:
        return f"cmd/{known[name].word}/{name}"
    near = difflib.get_close_matches(name, here, n=1, cutoff=0.4)
    return repr(near[0]) if near else "none of them"
