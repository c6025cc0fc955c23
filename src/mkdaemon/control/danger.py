"""Whether a dangerous request may be sent. Pure; the request's declaration says what it must meet.

Source: docs/safety.md, "The last function before the wire".
"""

from __future__ import annotations

from collections.abc import Collection

from mkdaemon.telemetry.danger import Confirm, Danger, Switch
from mkdaemon.telemetry.refusals import Token, refuse


def check_danger(
    name: str,
    danger: Danger,
    *,
    is_confirmed: bool,
    switches: Collection[Switch],
    motors_running: bool | None,
    is_testing_motors: bool,
) -> None:
    """Let a dangerous request pass or refuse it; whether the board is proven is asked last, see `check_proof`.

    Args:
        name: board and request, for the refusal.
        danger: what it must meet.
        is_confirmed: the request carries `confirm = true`.
        switches: what the configuration turns on.
        motors_running: whether motors run; None where nobody has said so lately.
        is_testing_motors: motors that run may turn because of a motor test a moment ago.

    Raises:
        CommandRejectedError: `never`, `not_enabled`, `motors_running`, `motors_unknown`, `not_confirmed`.
    """
    if danger.never:
        raise refuse(Token.NEVER, name=name, detail=danger.never, instead=danger.instead)
    if danger.switch is not None and danger.switch not in switches:
        raise refuse(Token.NOT_ENABLED, name=name, detail=danger.effect, option=danger.switch.value)
    is_own_doing = danger.turns_motors and is_testing_motors
    running = False if motors_running and is_own_doing else motors_running
    if danger.stopped and running:
        raise refuse(Token.MOTORS_RUNNING, detail=f"{name} needs them stopped: {danger.effect}")
    if danger.stopped and running is None:
        raise refuse(Token.MOTORS_UNKNOWN, detail=f"{name} needs them stopped")
    is_wanted = danger.confirm is Confirm.ALWAYS or (danger.confirm is Confirm.IN_FLIGHT and running is not False)
    if is_wanted and not is_confirmed:
        raise refuse(Token.NOT_CONFIRMED, name=name, detail=danger.effect, confirm=True)


def check_proof(board: str, danger: Danger, *, is_proven: bool, found: str) -> None:
    """Refuse a request whose board has not proven that it is the one on the line.

    Args:
        board: who is asked.
        danger: what the request must meet.
        is_proven: the last version reply, not long ago, came from this board.
        found: what that reply was, in words.

    Raises:
        CommandRejectedError: `board_unproven`.
    """
    if danger.proven and not is_proven:
        raise refuse(Token.BOARD_UNPROVEN, board=board, detail=found)
