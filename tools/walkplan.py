"""How a newcomer reads each tutorial: what runs on in a terminal, what Ctrl-C ends, what is typed again until it shows.

Whatever has no row here is typed, must end by itself with exit code 0, and must answer as the page shows. A row that
meets no line of its page is an error: the page has changed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Final


class Kind(Enum):
    """How a line of a page is carried out."""

    TO_END = "to its end"
    STAYS = "runs on"
    """In a separate terminal, until the page is done or says that Ctrl-C ends it; it must first show its line."""
    INTERRUPTED = "until Ctrl-C"
    """Ctrl-C comes when it has shown what it must."""
    ENTERED = "until Enter"
    REPEATED = "again, until it shows it"
    LEFT_OUT = "not run"


@dataclass(frozen=True)
class Manner:
    """How the lines of a page that begin with some words are carried out.

    Attributes:
        begins: the words; of a block of Python, words that stand in it.
        kind: how.
        shows: what its output holds (a regular expression).
        codes: exit codes that are right.
        patience: longest time for it [s]; a loaded machine is slow, not wrong.
        why: why it is not run, or what of it is not seen here.
    """

    begins: str
    kind: Kind = Kind.TO_END
    shows: str = ""
    codes: tuple[int, ...] = (0,)
    patience: float = 180.0
    why: str = ""


@dataclass(frozen=True)
class Page:
    """How a page is followed: the manners of its lines, and what must run before, which its sentences say."""

    manners: tuple[Manner, ...]
    before: tuple[Manner, ...] = ()


SIMULATOR: Final = r'\{"port": "(?P<port>/dev/pts/\d+)"'
DAEMON: Final = "up: both directions proven"
NO_DISPLAY: Final = "its page is served; no browser looks at it here (`make check-view` does)"
NO_AIRCRAFT: Final = "it needs the radio or the USB adapter of a real aircraft"

STAND_IN: Final = "the simulated aircraft, whose pilot does nothing, stands for a real one with its transmitter"

PAGES: Final[Mapping[str, Page]] = {
    "README.md": Page(
        manners=(
            Manner("make demo", shows="landed on the target, motors off", patience=1800.0),
            Manner("make test", shows=r"\d+ passed", patience=7200.0),
            Manner("uav.fly(", Kind.LEFT_OUT, why="docs/library.md has such a program, with what it needs"),
        ),
    ),
    "docs/quickstart.md": Page(
        manners=(
            Manner("make demo", shows="landed on the target, motors off", patience=1800.0),
            Manner(".venv/bin/mkdaemon sim", Kind.STAYS, SIMULATOR),
            Manner(".venv/bin/mkdaemon run --config configs/sim.toml", Kind.STAYS, DAEMON),
            Manner(".venv/bin/mkctl status  ", Kind.REPEATED, r"no client holds the lease(.|\n)*external control v2"),
            Manner(".venv/bin/mkctl watch", Kind.INTERRUPTED, r"state/\w+"),
            Manner(".venv/bin/mkctl get rx/nc/osd", shows=r"^rx/nc/osd"),
            Manner(".venv/bin/mkctl get state/position", Kind.REPEATED, r"altitude_above_start\W+(1\.[89]|2)"),
            Manner(".venv/bin/mkctl lease show", shows="no client holds the lease"),
            Manner(".venv/bin/mkctl stick", shows=r"setpoints; last stick frame: pitch 8,"),
            Manner(".venv/bin/mkctl get sim/truth", shows=r"crashed\W+no"),
            Manner(".venv/bin/mkdaemon doctor", codes=(0, 1, 2, 3), shows="serial"),
            Manner(".venv/bin/mkdaemon run --config configs/cyberquad.toml", Kind.LEFT_OUT, why=NO_AIRCRAFT),
            Manner("export MK_VEHICLE=cyberquad", Kind.LEFT_OUT, why=NO_AIRCRAFT),
            Manner(".venv/bin/mkctl status\n", Kind.LEFT_OUT, why=NO_AIRCRAFT),
            Manner("import msgpack, zenoh", Kind.ENTERED, r"position_enu"),
        ),
    ),
    "docs/first-flight.md": Page(
        manners=(
            Manner("mkdaemon sim", Kind.STAYS, SIMULATOR),
            Manner("mkdaemon run", Kind.STAYS, DAEMON),
            Manner("mkctl status --vehicle mk2", codes=(1, 2)),
            Manner("mkctl status", Kind.REPEATED, r"link tests +\d\d+ of \d+ answered(.|\n)*camera down +\d+ images/s"),
        ),
    ),
    "docs/first-aircraft.md": Page(
        before=(
            Manner(
                ".venv/bin/mkdaemon sim --config configs/sim.toml --pilot nothing", Kind.STAYS, SIMULATOR, why=STAND_IN
            ),
        ),
        manners=(
            Manner(".venv/bin/mkdaemon doctor", codes=(0, 1, 2, 3), shows="serial"),
            Manner(".venv/bin/mkdaemon run", Kind.STAYS, DAEMON),
            Manner(".venv/bin/mkctl status", shows=r"link +up: both directions proven"),
            Manner(".venv/bin/mkctl watch state/attitude", Kind.INTERRUPTED, r"roll deg .*\n.*\d"),
            Manner(".venv/bin/mkctl watch 'state", Kind.INTERRUPTED, r"state/\w+"),
            Manner(".venv/bin/mkctl preflight", codes=(0, 1), shows="│ link "),
            Manner(".venv/bin/mkctl linktest", codes=(0, 1), shows="GOOD|USABLE|POOR", patience=400.0),
        ),
    ),
    "docs/record-and-look.md": Page(
        manners=(
            Manner("mkctl view", Kind.INTERRUPTED, r"http://", why=NO_DISPLAY),
            Manner("mkctl log report room.mcap", Kind.LEFT_OUT, why="the recording of the tests has no second source"),
            Manner("mkctl log mark", Kind.LEFT_OUT, why="nothing flies on this page; docs/first-flight.md has it"),
        ),
    ),
    "docs/library.md": Page(
        before=(Manner(". .venv/bin/activate"),),
        manners=(
            Manner("mkdaemon sim", Kind.STAYS, SIMULATOR),
            Manner("mkdaemon run", Kind.STAYS, DAEMON),
            Manner("watch_attitude", Kind.INTERRUPTED, r"roll [+-](.|\n)* V .* link \w"),
            Manner("uav.fly(height", shows=r"(?m)^landed: "),
            Manner("uav.rates", shows="active parameter set"),
            Manner("decode_capture", shows=r"(?m)^\[\("),
        ),
    ),
}
"""By their paths from the root of the tree: a newcomer begins with the first."""
