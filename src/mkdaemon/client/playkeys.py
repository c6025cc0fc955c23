"""Under which keys a recording is played: never under one that commands.

A `PlayKey` can only be made of a key that carries published values. Setpoints, requests, liveliness tokens and the pads
of other machines have none, and neither has a key with a wildcard, which would reach other keys too. So nothing that
could move an aircraft or reach a port can leave a player, whatever is in the file.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

from mkdaemon.bus.keys import Use, find
from mkdaemon.bus.names import ROOT
from mkdaemon.config.names import VEHICLE_NAME
from mkdaemon.errors import ConfigError

REPLAY: Final = "replay"
"""Root of everything that is played without a name of its own."""
_SHOWN: Final = frozenset({Use.PUBLISHED, Use.CLIENT})
_HANDS: Final = "joy/"
"""Keys of pads, by which a program on another machine flies."""
_WILD: Final = frozenset("*$?#")
"""Characters by which a key expression of Zenoh means more than one key."""


@dataclass(frozen=True, slots=True)
class PlayKey:
    """A key that a player may put.

    Attributes:
        whole: the Zenoh key.
    """

    whole: str

    def __post_init__(self) -> None:
        """Refuse what commands.

        Raises:
            ValueError: this key does not carry published values.
        """
        suffix = shown_suffix(self.whole)
        if suffix is None:
            msg = f"{self.whole} is no key of published values: a player cannot put it"
            raise ValueError(msg)


def shown_suffix(whole: str) -> str | None:
    """What follows `mk/<vehicle>/` or `replay/<vehicle>/` in a key of published values; None for any other key."""
    root, _, rest = whole.partition("/")
    vehicle, _, suffix = rest.partition("/")
    is_plain = root in {ROOT, REPLAY} and re.fullmatch(VEHICLE_NAME, vehicle) is not None and not _WILD & set(suffix)
    spec = find(suffix) if is_plain and not suffix.startswith(_HANDS) else None
    return suffix if spec is not None and spec.use in _SHOWN else None


def play_key(key: str, name: str | None) -> PlayKey | None:
    """The key under which a recorded one is played; None where it is not played at all.

    Args:
        key: as recorded, `mk/<vehicle>/...`.
        name: vehicle to play as; None for `replay/<vehicle>/...`.
    """
    if shown_suffix(key) is None:
        return None
    _, vehicle, suffix = key.split("/", 2)
    return PlayKey(f"{REPLAY}/{vehicle}/{suffix}" if name is None else f"{ROOT}/{name}/{suffix}")


def check_name(name: str | None) -> None:
    """Make sure that a name can be a vehicle's.

    Raises:
        ConfigError: it cannot.
    """
    if name is not None and re.fullmatch(VEHICLE_NAME, name) is None:
        msg = f"--as {name!r}: a name has lower-case letters, digits, - and _"
        raise ConfigError(msg)
