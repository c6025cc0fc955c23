"""Commands of earlier versions: an old name is answered with the new one. This is the one table of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

RENAMED: Final[Mapping[str, Mapping[str, str]]] = {
    "mkctl": {
        "record": "log record",
        "play": "log play",
        "export": "log export",
        "report": "log report",
        "log check": "log verify",
        "log recover": "log repair",
        "navi goto": "goto --frame home",
        "navi route": "waypoints fly",
        "navi home": "waypoints home",
        "navi status": "waypoints status",
        "navi": "waypoints status, home and fly",
        "route start": "waypoints start",
        "route end": "waypoints end",
        "route": "waypoints start, end and fly",
        "mixer": "board mixer",
        "motors": "board motors",
        "motor-controllers": "board motor-controllers",
        "nc-param": "board parameters",
        "labels": "board labels",
        "display": "board display",
        "rates": "board rates",
        "send": "board send",
        "stop": "board motors stop",
        "gains": "preflight --gains",
        "lease release": "release",
        "target check": "mkdaemon calibrate check-print",
        "target": "mkdaemon calibrate check-print",
    },
    "mkdaemon": {
        "target": "calibrate print",
    },
}
"""Old words and new words by program; new words that begin with `mkdaemon` are another program's."""


def new_name(program: str, tokens: Sequence[str]) -> str | None:
    """Say what the command is called now; None where it has kept its name.

    Args:
        program: `mkctl` or `mkdaemon`.
        tokens: the command line without the program's name.
    """
    table = RENAMED.get(program, {})
    for length in (2, 1):
        old = " ".join(tokens[:length])
        if len(tokens) >= length and old in table:
            new = table[old]
            return f"`{program} {old}` is now `{new if new.startswith('mkdaemon ') else f'{program} {new}'}`"
    return None
