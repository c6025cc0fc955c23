"""`mkctl board parameters`: parameters of the NaviCtrl."""

from __future__ import annotations

from typing import Annotated, Final

from cyclopts import App, Parameter, validators

from mkdaemon.cli.mkctl.board_request import try_request
from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.errors import ConfigError, MkError, RequestTimeoutError
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

_WORDS: Final = ", ".join(member.name.lower() for member in NaviParameterId)
_UNITS: Final = ", ".join(f"{member.name.lower()} [{unit}]" for member, unit in UNITS.items())
Name = Annotated[str, Parameter(help=f"One of {_WORDS}. Units: {_UNITS}.")]


@app.command
async def get(name: Name, /, *, connection: Connection = HERE) -> None:
    """Show a parameter. One that was never set answers garbage: the NaviCtrl does not say so.

    Example: mkctl board parameters get heading_setpoint
    """
    answer = await _ask(connection, NaviParameterRequest(id=_read(name)))
    _show(connection, answer)


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
    answer = await _ask(connection, WriteNaviParameter(id=_read(name), value=value))
    if answer.value != value:
        raise MkError(f"{name}: the NaviCtrl answers {answer.value}, not {value}; read it again before flying")
    _show(connection, answer)


async def _ask(connection: Connection, message: WireMessage) -> NaviParameter:
    async with connection.open() as client:
        answer = await try_request(client, Board.NC, message)
    if not isinstance(answer, NaviParameter):
        raise RequestTimeoutError("the NaviCtrl did not answer; it must be 0.24 or later (`mkctl status`)")
    return answer


def _read(name: str) -> NaviParameterId:
    try:
        return NaviParameterId[name.upper().replace("-", "_")]
    except KeyError:
        raise ConfigError(f"there is no NaviCtrl parameter {name!r}; use one of {_WORDS}") from None


def _show(connection: Connection, answer: NaviParameter) -> None:
    unit = UNITS.get(answer.id, "")
    word = NaviParameterId(answer.id).name.lower()
    connection.show({word: answer.value, "unit": unit}, f"{word} {answer.value} {unit}".rstrip())
