"""`mkctl board parameters`: parameters of the NaviCtrl."""

from __future__ import annotations

from typing import Annotated, Final

from cyclopts import App, Parameter, validators

from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.errors import MkError
from mkdaemon.protocol.flags import NaviParameterId
from mkdaemon.protocol.messages import NaviParameter, NaviParameterRequest, WriteNaviParameter
from mkdaemon.protocol.wire import Board, WireMessage

app = App(
    name="parameters", help="Parameters of the NaviCtrl (0.24 and later). Setting one acts at once, in flight too."
)

VALUE: Final = WriteNaviParameter.spec.wire("value")
UNITS: Final = {
    NaviParameterId.TARGET_SPEED: "0.1 m/s",
    NaviParameterId.HEADING_SETPOINT: "deg, -1 none",
    NaviParameterId.ALTITUDE_SETPOINT: "dm",
}
"""Units of the values. Source: docs/protocol.md, "NaviCtrl commands"."""

_UNITS: Final = ", ".join(f"{member.name.lower()} [{unit}]" for member, unit in UNITS.items())
Name = Annotated[NaviParameterId, Parameter(help=f"Units: {_UNITS}.")]


@app.command
async def get(name: Name, /, *, connection: Connection = HERE) -> None:
    """Show a parameter. One that was never set answers garbage: the NaviCtrl does not say so.

    Example: mkctl board parameters get heading_setpoint
    """
    await _show(connection, NaviParameterRequest(id=name))


@app.command(name="set")
async def set_value(
    name: Name,
    value: Annotated[
        int,
        Parameter(
            help=f"Counts on the wire, {VALUE.minimum}..{VALUE.maximum}.",
            allow_leading_hyphen=True,
            validator=validators.Number(gte=VALUE.minimum, lte=VALUE.maximum),
        ),
    ],
    /,
    *,
    connection: Connection = HERE,
) -> None:
    """Set a parameter and compare the answer.

    Example: mkctl board parameters set heading_setpoint 50

    Raises:
        MkError: the NaviCtrl did not answer, or answers another value.
    """
    answer = await _show(connection, WriteNaviParameter(id=name, value=value))
    if answer.value != value:
        raise MkError(f"the NaviCtrl answers {answer.value}, not {value}; read it again before flying")


async def _show(connection: Connection, message: WireMessage) -> NaviParameter:
    """Ask, and print the answer. What the user has typed confirms what the message does."""
    async with connection.open() as client:
        answer = await client.request(Board.NC, message, NaviParameter, confirm=message.spec.danger is not None)
    word, unit = NaviParameterId(answer.id).name.lower(), UNITS.get(answer.id, "")
    connection.show({word: answer.value, "unit": unit}, f"{word} {answer.value} {unit}".rstrip())
    return answer
