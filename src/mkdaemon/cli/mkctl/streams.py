"""`mkctl board rates` and `labels`: streams of the boards, and the names of their debug channels."""

from __future__ import annotations

import re
from typing import Annotated, Literal

from cyclopts import Parameter

from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.errors import ConfigError

_INTERVAL = re.compile(r"(\d+(?:\.\d+)?)\s*(ms|s|hz)?", re.IGNORECASE)


def read_interval(text: str) -> float:
    """Turn `100ms`, `0.1s`, `10Hz` or `off` into an interval [s]; 0 stops a stream.

    Raises:
        ConfigError: it is none of these.
    """
    if text.lower() == "off":
        return 0.0
    match = _INTERVAL.fullmatch(text.strip())
    if match is None:
        raise ConfigError(f"{text!r} is not an interval: write 100ms, 0.1s, 10Hz or off")
    number, unit = float(match[1]), (match[2] or "ms").lower()
    if unit == "hz":
        return 1.0 / number if number else 0.0
    return number / 1000 if unit == "ms" else number


async def rates(stream: str | None = None, interval: str | None = None, *, connection: Connection = HERE) -> None:
    """Ask for a stream at an interval, or show all streams.

    The line carries 5.5 kB/s; what does not fit is refused with the arithmetic.

    Example: mkctl board rates osd 100ms

    Args:
        stream: Key of the message: `osd`, `attitude`, `debug`, `display`, ...
        interval: `100ms` (a bare number is ms), `0.1s`, `10Hz`, or `off`.

    Raises:
        ConfigError: no interval, or none that can be understood.
        CommandRejectedError: there is no such stream, or the line cannot carry it.
    """
    if stream is not None and interval is None:
        raise ConfigError(f"which interval for {stream}? For example: mkctl board rates {stream} 100ms")
    wanted = None if stream is None else read_interval(interval or "")
    async with connection.open() as uav:
        intervals = (await uav.rates(stream, wanted)).intervals
    lines = (
        f"{name:<12} {1000 * seconds:6.0f} ms  {1 / seconds if seconds else 0:6.1f} Hz"
        for name, seconds in sorted(intervals.items())
    )
    connection.show({"intervals": intervals}, "\n".join(lines))


async def labels(
    board: Annotated[Literal["fc", "nc", "mag"], Parameter(help="Board.")] = "fc",
    /,
    *,
    connection: Connection = HERE,
) -> None:
    """Read all 32 labels; the daemon keeps them by firmware, and by their checksum where the board tells one.

    Example: mkctl board labels nc
    """
    async with connection.open() as uav:
        names = (await uav.labels(board)).names
    connection.show(names, "\n".join(f"{index:2}  {name}" for index, name in enumerate(names)))
