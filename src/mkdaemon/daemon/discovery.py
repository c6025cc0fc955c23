"""Lets a request wait until the aircraft is identified."""

from __future__ import annotations

from mkdaemon.errors import CommandRejectedError
from mkdaemon.link.discovery import wait_for_discovery
from mkdaemon.link.link import Link
from mkdaemon.telemetry.link import LinkState
from mkdaemon.telemetry.refusals import Token, refuse


async def require_discovery(link: Link, state: LinkState | None) -> None:
    """Wait a while for an aircraft whose boards are being asked who they are; returns at once for one that is known.

    A daemon that has just started, or an aircraft just switched on, is no read-only aircraft: it is known in a second.

    Args:
        link: to the aircraft.
        state: what is known about the line.

    Raises:
        CommandRejectedError: `other_aircraft`, `aircraft_unproven`; `link_down`: no board can be asked any more;
            `discovering`: no answer yet.
    """
    if link.doubt is not None:
        raise link.doubt
    if link.dialect.read_only_reason is None:
        return
    if not link.is_up and not link.boards:
        condition = "absent" if state is None else state.condition.value
        raise refuse(Token.LINK_DOWN, state=condition, detail="" if state is None else state.reason)
    if not await wait_for_discovery(link):
        if not link.is_up:
            lost = link.health().state
            raise refuse(Token.LINK_DOWN, state=lost.condition.value, detail=lost.reason)
        raise refuse(Token.DISCOVERING, detail=link.dialect.read_only_reason)


async def require_flightctrl(link: Link, state: LinkState | None, *, use_remembered: bool) -> None:
    """Wait a while until it is known how to steer; a FlightCtrl that cannot be asked in flight may be confirmed.

    Args:
        link: to the aircraft.
        state: what is known about the line.
        use_remembered: a client confirms that the FlightCtrl is the one before; without a meaning where it is known.

    Raises:
        CommandRejectedError: as `require_discovery`; `remembered_only`: the FlightCtrl cannot be asked but is
            remembered; `nothing_remembered`: it is not.
    """
    unknown: CommandRejectedError | None = None
    try:
        await require_discovery(link, state)
    except CommandRejectedError as error:
        if error.token != Token.DISCOVERING:
            raise
        unknown = error
    if link.dialect.extern_control is not None:
        return
    memory = link.offered_memory()
    if use_remembered:
        link.confirm_memory()
    elif memory is not None:
        raise refuse(Token.REMEMBERED_ONLY, firmware=f"FlightCtrl {memory.firmware}")
    elif unknown is not None:
        raise unknown
