"""MikroKopter requests as queries: `cmd/<board>/<message>` to a typed reply or a refusal."""

from __future__ import annotations

import asyncio
import difflib
from typing import Any, Final

from pydantic import ValidationError

from mkdaemon.bus.codec import decode_map, first_mistake, schema_name
from mkdaemon.bus.gateway import refused
from mkdaemon.clock import Clock
from mkdaemon.config.commands import CommandsConfig
from mkdaemon.daemon.audit import Audit
from mkdaemon.daemon.gate import Rule, check, rule_for
from mkdaemon.daemon.meeting import meet
from mkdaemon.daemon.vitals import Vitals
from mkdaemon.errors import CommandRejectedError, LinkLostError, RequestTimeoutError
from mkdaemon.link.discovery import PORTS, redirection
from mkdaemon.link.link import Link
from mkdaemon.link.procedures import way_to
from mkdaemon.protocol.flags import RedirectPort
from mkdaemon.protocol.messages import Redirect, VersionRequest
from mkdaemon.protocol.wire import MESSAGES, Board, Direction, WireMessage
from mkdaemon.telemetry.command import CommandResult, Status, refuse

PASSAGE: Final = 5.0
"""How long a bare redirection lasts [s]; a client waits 15 s for an answer."""
_BOARDS = {board.word: board for board in Board if board is not Board.ANY}


class BoardRequests:
    """Answers queries under `cmd/`."""

    def __init__(self, cfg: CommandsConfig, link: Link, vitals: Vitals, audit: Audit, clock: Clock) -> None:
        self._cfg = cfg
        self._link = link
        self._vitals = vitals
        self._audit = audit
        self._clock = clock

    async def answer(self, suffix: str, raw: bytes) -> CommandResult:
        """Answer one query; every one is mirrored under `event/command`, whatever becomes of it."""
        fields: dict[str, Any] = {}
        try:
            fields = decode_map(raw)
            result = await self._ask(suffix, dict(fields))
        except CommandRejectedError as error:
            result = refused(error)
        except LinkLostError as error:
            result = self._link_down(error)
        self._audit.command(suffix, fields, result)
        return result

    async def _ask(self, suffix: str, fields: dict[str, Any]) -> CommandResult:
        board, name = _place(suffix)
        confirmed = fields.pop("confirm", False) is True
        message = self._build(board, name, fields)
        rule = rule_for(board, message)
        if rule is not None:
            await meet(self._link, self._vitals.link)
        self._check_dialect(board, message, rule)
        if rule is not None:
            check(
                board,
                message,
                rule,
                confirmed=confirmed,
                cfg=self._cfg,
                vitals=self._vitals,
                now=self._clock.now(),
            )
        async with way_to(self._link, board, message):
            if rule is not None and rule.proven:
                await self._prove(board)
            if message.spec.key == "motor_test":
                self._vitals.motor_test_sent(self._clock.now())
            if isinstance(message, Redirect):
                return await self._pass_through(message.port)
            return await self._converse(board, message)

    async def _pass_through(self, port: RedirectPort) -> CommandResult:
        """Answer a bare redirection: for a while and back again, or the line would be lost to everybody for ever.

        Raises:
            CommandRejectedError: `not_redirectable`, `motors_not_known_off`.
        """
        async with redirection(self._link, PORTS[port]):
            await asyncio.sleep(PASSAGE)
        reason = (
            f"the line led to the {port.name} for {PASSAGE:g} s and is back; what came is under raw/rx. "
            "Requests to cmd/fc and cmd/mag are passed through by themselves."
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
            raise refuse("unknown_message", board=board.word, name=name, near=_near(board, name))
        spoken = wanted or self._link.dialect.layouts.get((board, layouts[0].spec.id))
        layouts.sort(key=lambda cls: cls.spec.layout != spoken)
        if wanted is not None and layouts[0].spec.layout != wanted:
            known = ", ".join(cls.spec.layout for cls in layouts)
            raise refuse("bad_field", name=name, detail=f"layout {wanted!r} is none of {known}")
        mistake: ValidationError | None = None
        for cls in layouts:
            try:
                return cls.model_validate(fields)
            except ValidationError as error:
                mistake = mistake or error
        assert mistake is not None
        raise refuse("bad_field", name=layouts[0].__name__, detail=first_mistake(mistake)) from mistake

    def _check_dialect(self, board: Board, message: WireMessage, rule: Rule | None) -> None:
        dialect, spec = self._link.dialect, message.spec
        # Nothing on the line tells the fork from stock firmware: who enables its commands says that it is one.
        reason = None if spec.is_fork else dialect.unsupported.get((board, spec.key))
        if reason is not None:
            raise refuse("unsupported", name=f"{board.word}/{spec.key}", detail=reason)
        if rule is not None and dialect.read_only_reason is not None:
            raise refuse("read_only", detail=dialect.read_only_reason)
        if spec.key == "write_settings" and dialect.settings_read_only_reason is not None:
            raise refuse("read_only", detail=dialect.settings_read_only_reason)

    async def _prove(self, board: Board) -> None:
        """Make sure that the board asked is the one that hears us: another may read the same letter as a motor test.

        Raises:
            CommandRejectedError: `board_unproven`, or what the link refuses.
        """
        if self._vitals.is_proven(board, self._clock.now()):
            return
        try:
            await self._link.request(VersionRequest(), board=board)
        except (RequestTimeoutError, LinkLostError) as error:
            raise refuse("board_unproven", board=board.word, detail=str(error)) from error
        if not self._vitals.is_proven(board, self._clock.now()):
            raise refuse("board_unproven", board=board.word, detail=self._vitals.last_named())

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
            return refused(refuse("timeout", board=board.word, name=spec.key, detail=str(error)))
        return CommandResult(status=Status.ACCEPTED, reply=dict(reply.__dict__), reply_type=schema_name(type(reply)))

    def _link_down(self, error: LinkLostError) -> CommandResult:
        state = self._vitals.link
        condition = "absent" if state is None else state.condition.value
        return refused(refuse("link_down", state=condition, detail=str(error)))


def _place(suffix: str) -> tuple[Board, str]:
    """Board and message of `cmd/<board>/<message>`."""
    parts = suffix.split("/")
    if len(parts) != 3 or parts[1] not in _BOARDS:
        raise refuse(
            "unknown_message", board=parts[1] if len(parts) > 1 else "?", name=parts[-1], near="cmd/fc/..., cmd/nc/..."
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
