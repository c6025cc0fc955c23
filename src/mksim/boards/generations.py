"""Firmware generations of the two boards: what differs between releases, as one table each.

Sources: docs/protocol.md (compatibility matrix), docs/firmware-notes (measured), docs/safety.md (dead-man generations).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, Literal

from mkdaemon.protocol.errorcodes import ErrorCode
from mkdaemon.protocol.flags import PositionStatus
from mkdaemon.protocol.messages import (
    AttitudeDataFc210,
    AttitudeDataFcOld,
    AttitudeDataNc,
    AttitudeDataNcSticks,
    ControlStateV1,
    ControlStateV2,
    ControlStateV3,
    VersionClassic,
    VersionFc200,
    VersionFc210,
)

FC_MS: Final = 1.038e-3
"""The FlightCtrl's millisecond, as measured [s] (nominal 1.024)."""
SHORT_PASS: Final = 1.95e-3
LONG_PASS: Final = 2.38e-3
LONG_SHARE: Final = 0.3
"""Three of ten loop passes are long: mean 2.08 ms, and the measured loss of the second of two frames."""
LONGEST_PASS: Final = 7e-3
LONGEST_SHARE: Final = 1e-5
"""Once a FlightCtrl took 7 ms to look at a frame; here one pass in 100,000 does, about every 200 s."""
SERIAL_PASSES: Final = (0.57, 0.20, 0.15, 0.048, 0.016, 0.007, 0.005, 0.002, 0.002)
"""With motors running: share of the times that the serial part runs again 1, 2, 3, ... passes later. A pass whose
regulator takes longer than its 2 ms leaves the serial part out (main.c). Measured on 2.12a, assumed for the others."""
SLOW_TICK: Final = 20 * 1.0248e-3
"""Period of the dead-man counter: 100 of them are the measured 2.05 s [s]."""


@dataclass(frozen=True, slots=True)
class StickHold:
    """How long a FlightCtrl holds the last sticks.

    Attributes:
        ticks: slow ticks until they are dropped.
        refreshed_by: command letters that restart the count; empty means every command.
    """

    ticks: int
    refreshed_by: frozenset[str]

    def is_refreshed_by(self, command: str) -> bool:
        """Whether this command keeps stale sticks alive."""
        return not self.refreshed_by or command in self.refreshed_by


FcWord = Literal["early", "2.08", "2.12a", "2.14"]
NcWord = Literal["0.24", "2.14"]


@dataclass(frozen=True, slots=True)
class FcFirmware:
    """One FlightCtrl release.

    Attributes:
        word: how the configuration names it.
        release: major, minor, patch letter as a number.
        revision: of its parameter set.
        version: message class of its version reply.
        attitude: message class of its attitude stream.
        control: message class of the external control it holds; its size is what a `b` frame is copied into.
        buffer: longest frame it receives [characters].
        longest_control: characters from which a `b` frame is ignored; None copies any length.
        dead_man: see there.
        gestures_mixed: arming gestures read the sticks after external control was added.
        stick_filter: the sticks are low-pass filtered.
        answers_mixer: `n`, `m` exist.
        channels: values in the `P` reply.
        menu_pages: last page of the display menu.
        deaf_when_running: commands without any answer while motors run.
        feeds_compass: sends its attitude to an MK3Mag unasked, also when there is none.
        reset_gated: `R` is ignored while motors run.
        packet_ticks: slow ticks between two of its packets to a NaviCtrl in flight; 0 where no genuine one was run.
    """

    word: FcWord
    release: tuple[int, int, int]
    revision: int
    version: type[VersionClassic | VersionFc200 | VersionFc210]
    attitude: type[AttitudeDataFc210 | AttitudeDataFcOld]
    control: type[ControlStateV1 | ControlStateV2 | ControlStateV3]
    buffer: int
    longest_control: int | None
    dead_man: StickHold
    gestures_mixed: bool
    stick_filter: bool
    answers_mixer: bool
    channels: int
    menu_pages: int
    deaf_when_running: str
    feeds_compass: bool
    reset_gated: bool
    packet_ticks: int

    @property
    def label(self) -> str:
        """The release as boards print it, for example `2.12a`."""
        major, minor, patch = self.release
        return f"{major}.{minor:02d}{chr(ord('a') + patch)}"


@dataclass(frozen=True, slots=True)
class NcFirmware:
    """One NaviCtrl release.

    Attributes:
        word: how the configuration names it.
        release: major, minor, patch letter as a number.
        attitude: message class of its attitude stream.
        takes_control: accepts `b` and `y` itself and confirms.
        data_sets: answers a three-byte `o` with the data sets 10 to 16.
        extras: further command letters it knows.
        list_size: points its list holds.
        menu_pages: last page of the display menu.
        list_starts_in_flight: only a list received in flight is flown by the coming-home switch; one received on the
            ground sends the aircraft home. Without it every list is flown.
        ends_at_home: it flies home after the last point; otherwise it holds there.
        fix_status: what Position.Status shows of a fix, and goes on to show when the GPS receiver is silent.
        no_fix_status: Position.Status without a fix; None keeps the last position and its status.
        no_fix_error: error code without a GPS fix after there was one.
        reports_gps_ok: sets the flag GPS_OK.
        distance_wraps: distances are computed in whole centimetres of 16 bits.
        home_at_first_fix: home is where the first fix was, until the motors are started.
    """

    word: NcWord
    release: tuple[int, int, int]
    attitude: type[AttitudeDataNc | AttitudeDataNcSticks]
    takes_control: bool
    data_sets: bool
    extras: str
    list_size: int
    menu_pages: int
    list_starts_in_flight: bool
    ends_at_home: bool
    fix_status: PositionStatus
    no_fix_status: PositionStatus | None
    no_fix_error: ErrorCode
    reports_gps_ok: bool
    distance_wraps: bool
    home_at_first_fix: bool


_EARLY: Final = FcFirmware(
    word="early",
    release=(0, 71, 5),
    revision=73,
    version=VersionClassic,
    attitude=AttitudeDataFcOld,
    control=ControlStateV1,
    buffer=175,
    longest_control=None,
    dead_man=StickHold(25, frozenset()),
    gestures_mixed=False,
    stick_filter=False,
    answers_mixer=False,
    channels=11,
    menu_pages=9,
    deaf_when_running="q",
    feeds_compass=True,
    reset_gated=False,
    packet_ticks=3,
)
_2_08: Final = replace(
    _EARLY,
    word="2.08",
    release=(2, 8, 0),
    revision=103,
    version=VersionFc200,
    buffer=220,
    dead_man=StickHold(257, frozenset("abdhlpt")),
    answers_mixer=True,
    channels=35,
    menu_pages=19,
    deaf_when_running="qf",
    feeds_compass=False,
    reset_gated=True,
)
_2_12A: Final = replace(
    _2_08,
    word="2.12a",
    release=(2, 12, 0),
    revision=106,
    version=VersionFc210,
    attitude=AttitudeDataFc210,
    control=ControlStateV2,
    longest_control=20,
    dead_man=StickHold(100, frozenset("b")),
    gestures_mixed=True,
    stick_filter=True,
    packet_ticks=0,
    deaf_when_running="f",
)
_2_14: Final = replace(_2_12A, word="2.14", release=(2, 14, 0), revision=108, control=ControlStateV3, buffer=320)

FC_GENERATIONS: Final = {generation.word: generation for generation in (_EARLY, _2_08, _2_12A, _2_14)}
"""The FlightCtrl releases that can be simulated, by the configuration's word."""

NC_GENERATIONS: Final[dict[NcWord, NcFirmware]] = {
    generation.word: generation
    for generation in (
        NcFirmware(
            word="0.24",
            release=(0, 24, 1),
            attitude=AttitudeDataNc,
            takes_control=False,
            data_sets=False,
            extras="",
            list_size=31,
            menu_pages=15,
            list_starts_in_flight=True,
            ends_at_home=True,
            fix_status=PositionStatus.NEW,
            no_fix_status=None,
            no_fix_error=ErrorCode.NO_GPS,
            reports_gps_ok=False,
            distance_wraps=True,
            home_at_first_fix=True,
        ),
        NcFirmware(
            word="2.14",
            release=(2, 14, 0),
            attitude=AttitudeDataNcSticks,
            takes_control=True,
            data_sets=True,
            extras="kt",
            list_size=100,
            menu_pages=15,
            list_starts_in_flight=False,
            ends_at_home=False,
            fix_status=PositionStatus.PROCESSED,
            no_fix_status=PositionStatus.INVALID,
            no_fix_error=ErrorCode.GPS_LOST,
            reports_gps_ok=True,
            distance_wraps=False,
            home_at_first_fix=False,
        ),
    )
}
