"""Which firmware generation speaks how: the compatibility tables of FlightCtrl and NaviCtrl.

Source: docs/protocol.md, "Compatibility"; the dead-man generations: docs/safety.md,
docs/firmware-notes.md, section 6.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Final, Literal, NamedTuple

ControlLayout = Literal["v1", "v2", "v3"]

PROTOCOL_MAJORS: Final = range(7, 12)
"""Serial protocol generations of MikroKopter firmware; anything else is foreign."""


class Release(NamedTuple):
    """A firmware release."""

    major: int
    minor: int
    patch: int = 0

    def __str__(self) -> str:
        letter = chr(ord("a") + self.patch) if 0 <= self.patch < 26 else f"+{self.patch}"
        return f"{self.major}.{self.minor:02d}{letter}"


class DeadMan(Enum):
    """The FlightCtrl's dead-man timer: its length, and the frames that refresh it."""

    ANY_COMMAND_0S5 = "any_command_0s5"
    """Oldest: about 0.5 s after the last serial command of any kind."""
    POLLING_5S3 = "polling_5s3"
    """Up to 2.08: 5.3 s (255 ticks of nominally 20 ms; 0.84a run) after the last of a b d h l p t."""
    CONTROL_2S = "control_2s"
    """2.12a: 2.0 s (100 ticks of 20 ms) after the last b."""
    UNKNOWN = "unknown"
    """Not verified: taken as the worst of all."""

    @property
    def hold_time(self) -> float:
        """Time the last sticks are held after the last refresh [s]."""
        return _HOLD[self]

    def refreshed_by(self, command: str) -> bool:
        """Whether a command of this letter keeps the last sticks alive."""
        letters = _REFRESHERS[self]
        return letters is None or command in letters


_HOLD: Final = {
    DeadMan.ANY_COMMAND_0S5: 0.5,
    DeadMan.POLLING_5S3: 5.3,
    DeadMan.CONTROL_2S: 2.05,
    DeadMan.UNKNOWN: 5.3,
}
_REFRESHERS: Final[dict[DeadMan, frozenset[str] | None]] = {
    DeadMan.ANY_COMMAND_0S5: None,
    DeadMan.POLLING_5S3: frozenset("abdhlpt"),
    DeadMan.CONTROL_2S: frozenset("b"),
    DeadMan.UNKNOWN: None,
}


@dataclass(frozen=True, slots=True)
class FcGeneration:
    """Common properties of a range of FlightCtrl releases.

    Attributes:
        since: first release (major, minor).
        until: last release (major, minor).
        revisions: parameter set revisions in use.
        control: layout of external control; None where it is not verified.
        receiver: layout of the receiver channels; None where it is not verified.
        attitude: layout of the attitude stream.
        dead_man: see `DeadMan`.
        stick_filter: external control passes the receiver's stick filter (a low-pass of about 78 ms).
        resets_in_flight: a reset is obeyed with motors running.
        stick_p: of set 3 as it leaves the factory, which is the active one. The sets of 0.84a (8) and of revision 92
            (6) and 106 (6) were read.
        stick_yaw_p: of the same set: 6, 4 and 4.
    """

    since: tuple[int, int]
    until: tuple[int, int]
    revisions: frozenset[int]
    control: ControlLayout | None
    receiver: str | None
    attitude: str
    dead_man: DeadMan
    stick_filter: bool
    resets_in_flight: bool
    stick_p: int
    stick_yaw_p: int


def _fc(
    since: tuple[int, int],
    until: tuple[int, int],
    revisions: range,
    control: ControlLayout | None,
    receiver: str | None,
    attitude: str,
    dead_man: DeadMan,
) -> FcGeneration:
    return FcGeneration(
        since,
        until,
        frozenset(revisions),
        control,
        receiver,
        attitude,
        dead_man,
        stick_filter=since >= (2, 9),
        resets_in_flight=since < (2, 2),
        stick_p=8 if since < (0, 90) else 6,
        stick_yaw_p=6 if since < (0, 90) else 4,
    )


# The boundary between the two oldest dead-man generations is not verified (0.71 and 2.00a were read); both need the
# same release: neutral, Config 0, and silence towards the FlightCtrl.
FC_GENERATIONS: Final = (
    _fc((0, 71), (0, 76), range(73, 81), "v1", "071", "fc_old", DeadMan.ANY_COMMAND_0S5),
    _fc((0, 77), (0, 79), range(81, 83), "v1", "077", "fc_old", DeadMan.POLLING_5S3),
    _fc((0, 80), (0, 85), range(84, 88), "v1", "077", "fc_old", DeadMan.POLLING_5S3),
    _fc((0, 86), (0, 87), range(88, 90), "v1", "077", "fc_old", DeadMan.POLLING_5S3),
    _fc((0, 88), (0, 89), range(90, 92), "v1", "077", "fc_old", DeadMan.POLLING_5S3),
    _fc((0, 90), (0, 90), range(92, 94), "v1", "077", "fc_old", DeadMan.POLLING_5S3),
    _fc((0, 91), (0, 91), range(94, 97), "v1", "200", "fc_old", DeadMan.POLLING_5S3),
    _fc((2, 0), (2, 1), range(94, 97), "v1", "200", "fc_old", DeadMan.POLLING_5S3),
    _fc((2, 2), (2, 4), range(97, 99), "v1", "200", "fc_old", DeadMan.POLLING_5S3),
    _fc((2, 5), (2, 6), range(100, 103), "v1", "200", "fc_old", DeadMan.POLLING_5S3),
    _fc((2, 7), (2, 8), range(103, 104), "v1", "200", "fc_old", DeadMan.POLLING_5S3),
    _fc((2, 9), (2, 9), range(104, 106), None, "200", "fc210", DeadMan.UNKNOWN),
    _fc((2, 10), (2, 10), range(104, 106), "v2", "200", "fc210", DeadMan.UNKNOWN),
    _fc((2, 11), (2, 11), range(106, 107), "v2", "200", "fc210", DeadMan.UNKNOWN),
    _fc((2, 12), (2, 12), range(106, 107), "v2", "200", "fc210", DeadMan.CONTROL_2S),
    _fc((2, 13), (2, 15), range(107, 109), "v3", None, "fc210", DeadMan.UNKNOWN),
    _fc((2, 16), (2, 22), range(109, 115), "v3", None, "fc210", DeadMan.UNKNOWN),
)


@dataclass(frozen=True, slots=True)
class NcGeneration:
    """Common properties of a range of NaviCtrl releases.

    Attributes:
        since: first release (major, minor).
        until: last release (major, minor).
        point: layout of the points of a route.
        attitude: layout of the attitude stream.
        has_sets: it streams the data sets 10..16 when asked with a byte budget.
        takes_control: it takes external control itself; older ones forward it to the FlightCtrl, unconfirmed.
    """

    since: tuple[int, int]
    until: tuple[int, int]
    point: str
    attitude: str
    has_sets: bool
    takes_control: bool


# 2.05 brought the photo distance (parameter revision 100), so the last byte but one of a point has a meaning from then.
NC_GENERATIONS: Final = (
    NcGeneration((0, 18), (0, 20), "old", "nc", has_sets=False, takes_control=False),
    NcGeneration((0, 21), (0, 26), "024", "nc", has_sets=False, takes_control=False),
    NcGeneration((0, 27), (0, 27), "027", "nc", has_sets=False, takes_control=False),
    NcGeneration((0, 28), (0, 40), "027", "nc_sticks", has_sets=False, takes_control=False),
    NcGeneration((2, 0), (2, 4), "027", "nc_sticks", has_sets=False, takes_control=False),
    NcGeneration((2, 5), (2, 12), "2x", "nc_sticks", has_sets=False, takes_control=False),
    NcGeneration((2, 13), (2, 13), "2x", "nc_sticks", has_sets=False, takes_control=True),
    NcGeneration((2, 14), (2, 22), "2x", "nc_sticks", has_sets=True, takes_control=True),
)


def fc_generation(release: Release) -> FcGeneration | None:
    """Return the generation of a FlightCtrl release; None where it is in no table."""
    return next((row for row in FC_GENERATIONS if row.since <= release[:2] <= row.until), None)


def nc_generation(release: Release) -> NcGeneration | None:
    """Return the generation of a NaviCtrl release; None where it is in no table."""
    return next((row for row in NC_GENERATIONS if row.since <= release[:2] <= row.until), None)
