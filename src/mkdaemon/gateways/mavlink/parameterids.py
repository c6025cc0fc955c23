"""The settings of a FlightCtrl under 16 characters: the English name in capitals, its words cut where it is too long.

`ids` of a layout never change for a name: programs keep files of parameters by them.
"""

from __future__ import annotations

from functools import cache
from typing import Final, NamedTuple

from mkdaemon.gateways.boardset import numbers_of
from mkdaemon.protocol.settings import ParameterSet, Value, known_revisions, layout_of

NEWEST: Final = max(known_revisions())
"""Newest revision of the sets that is known."""
LONGEST: Final = 16
_CUT: Final = {
    "acceleration": "acc",
    "accelerometer": "acc",
    "altitude": "alt",
    "camera": "cam",
    "channel": "ch",
    "compensation": "comp",
    "compass": "comps",
    "control": "ctrl",
    "correction": "corr",
    "counter": "cnt",
    "coupling": "cpl",
    "descend": "desc",
    "emergency": "emer",
    "external": "ext",
    "failsafe": "fs",
    "filter": "filt",
    "gimbal": "gmbl",
    "influence": "infl",
    "landing": "land",
    "neutral": "ntrl",
    "operating": "oper",
    "orientation": "orient",
    "output": "out",
    "pattern": "pat",
    "pitch": "pit",
    "positions": "pos",
    "satellites": "sats",
    "servo": "srv",
    "single": "sgl",
    "stability": "stab",
    "switch": "sw",
    "threshold": "thrsh",
    "throttle": "thr",
    "voltage": "volt",
    "warning": "warn",
    "waypoint": "wp",
}
"""Words that are cut in a name of more than 16 characters."""


class ParameterId(NamedTuple):
    """Where a parameter of MAVLink stands in a set.

    Attributes:
        id: of at most 16 characters.
        name: of the setting.
        place: in a setting that is a list, from 0; None for one that is a number.
    """

    id: str
    name: str
    place: int | None


def short(name: str, index: int | None = None) -> str:
    """The id of a setting.

    Args:
        name: of the setting.
        index: in a list, from 0; None for a number. Ids count from 1.
    """
    tail = "" if index is None else f"_{index + 1}"
    if len(name) + len(tail) > LONGEST:
        name = "_".join(_CUT.get(word, word) for word in name.split("_"))
    return f"{name}{tail}".upper()


@cache
def ids_of(revision: int) -> tuple[ParameterId, ...]:
    """The parameters of a revision of the sets, in wire order, without texts and spare bytes.

    Args:
        revision: of a known layout; none for an unknown one.
    """
    layout = layout_of(revision)
    found = []
    for name, _, length in () if layout is None else numbers_of(layout):
        places = (None,) if length is None else range(length)
        found += [ParameterId(short(name, place), name, place) for place in places]
    return tuple(found)


def value_of(stored: ParameterSet, parameter: ParameterId) -> int:
    """The number of a parameter.

    Raises:
        ProtocolError: the set has another layout.
    """
    value = stored[parameter.name]
    if isinstance(value, tuple) and parameter.place is not None:
        return value[parameter.place]
    return int(value) if isinstance(value, int) else 0


def change_to(stored: ParameterSet, parameter: ParameterId, value: int) -> Value:
    """The setting of a parameter, with the parameter changed.

    Args:
        stored: the set as it is.
        parameter: which one.
        value: 0 to 255.

    Raises:
        ProtocolError: the set has another layout.
    """
    whole = stored[parameter.name]
    if isinstance(whole, tuple) and parameter.place is not None:
        return (*whole[: parameter.place], value, *whole[parameter.place + 1 :])
    return value
