"""Parameter sets of the simulated FlightCtrl: raw bytes as they cross the wire, and the values the simulation obeys.

Layouts are those of `mkdaemon.protocol.settings`; factory values are what a FlightCtrl 2.12a returned for its sets
Fast, Agile and Easy (tests/data/captures holds that recording).
"""

from __future__ import annotations

from functools import cache
from typing import Final

from mkdaemon.errors import ProtocolError
from mkdaemon.protocol.settings import Layout, layout_of, poti_number
from mksim.physics.attitude_loop import LEAK_FAST, LEAK_SLOW, AttitudeGains

SETS: Final = 5
FACTORY_ACTIVE: Final = 3
FIRST_POTI: Final = 4
"""Place in the channel list where the potis begin: pitch, roll, throttle and yaw come first."""
_MEASURED_REVISION: Final = 106

_EASY: Final = bytes.fromhex(
    "6a0302010405060708090a0b0c6a1e2805140f1e016e7f060a0408e61b4064780a64780620415a06100000000080"
    "3218e6805546dc033c007d7d7d325a327d34464e4e20004600000000aa28cc2800aa000664645a784b554b280608"
    "322a008c02000000000000003c960000008c468c460000000000000c001e1f0032f00000000272504561737900000000"
    "00000000"
)
_VARIANTS: Final[dict[int, tuple[str, dict[str, int]]]] = {
    1: (
        "Fast",
        {
            "stick_p": 10,
            "stick_d": 16,
            "stick_yaw_p": 6,
            "gyro_p": 90,
            "gyro_yaw_p": 90,
            "integral_factor": 32,
            "coupling_yaw_correction": 60,
            "dynamic_stability": 75,
        },
    ),
    2: ("Agile", {"stick_p": 8, "stick_d": 16, "stick_yaw_p": 6}),
    3: ("Easy", {}),
}
"""What differs from Easy; sets 4 and 5 are Easy again."""
_OLD_VARIANTS: Final[dict[int, tuple[str, dict[str, int]]]] = {
    1: (
        "Sport",
        {
            "stick_p": 14,
            "stick_d": 16,
            "stick_yaw_p": 12,
            "gyro_p": 80,
            "gyro_i": 150,
            "gyro_yaw_p": 80,
            "gyro_yaw_i": 150,
            "integral_factor": 32,
            "coupling_yaw_correction": 1,
            "gyro_accelerometer_fusion": 16,
            "dynamic_stability": 100,
        },
    ),
    2: ("Normal", _VARIANTS[1][1]),
    3: ("Beginner", _VARIANTS[2][1]),
}
"""The same before revision `_EASY_SINCE`: FlightCtrl 0.84a."""
_EASY_SINCE: Final = 92

_BOUNDS: Final = {
    "throttle_max": (100, 247),
    "throttle_min": (0, 60),
    "emergency_throttle_time": (0, 250),
    "gyro_stability": (1, 15),
}
"""Ranges into which this simulation pulls values on writing; which ones a FlightCtrl clamps differs by release."""

_ABSENT: Final = {"gyro_stability": 6}
"""Values an older firmware has built in; others it lacks are 0."""

_NEVER_MEASURED: Final = {"gps_operating_radius": 245}
"""Parameters that the measured revision has not; FlightCtrl 0.84a."""


@cache
def _layout(revision: int) -> Layout:
    layout = layout_of(revision)
    if layout is None:
        msg = f"parameter revision {revision} has no known layout"
        raise ProtocolError(msg)
    return layout


def parameter_size(revision: int) -> int:
    """Bytes of a set on the wire, from the revision to the end of the name."""
    return _layout(revision).size


def factory_set(revision: int, number: int) -> bytes:
    """Return a factory set; other revisions carry the measured values wherever they have the parameter."""
    name, changes = (_VARIANTS if revision >= _EASY_SINCE else _OLD_VARIANTS)[min(number, FACTORY_ACTIVE)]
    layout, measured = _layout(revision), _layout(_MEASURED_REVISION)
    raw = bytearray(layout.size)
    for key, place in layout.places.items():
        known = measured.places.get(key)
        if known is not None:
            length = min(place.length, known.length)
            raw[place.offset : place.offset + length] = _EASY[known.offset : known.offset + length]
        if key in changes or key in _NEVER_MEASURED:
            raw[place.offset] = changes.get(key, _NEVER_MEASURED.get(key, 0))
    place = layout.places["name"]
    raw[place.offset : place.offset + place.length] = name.encode("latin-1").ljust(place.length, b"\0")
    raw[0] = revision
    return bytes(raw)


class Parameters:
    """One parameter set as the main loop reads it."""

    __slots__ = ("_places", "raw")

    def __init__(self, raw: bytes) -> None:
        self.raw = raw
        self._places = _layout(raw[0]).places

    def __getitem__(self, key: str) -> int:
        place = self._places.get(key)
        return _ABSENT.get(key, 0) if place is None else self.raw[place.offset]

    def __contains__(self, key: str) -> bool:
        return key in self._places

    def place(self, key: str) -> int:
        """Offset of a parameter in `raw`."""
        return self._places[key].offset

    def channel(self, number: int) -> int:
        """Receiver channel of function `number`: 0 pitch, 1 roll, 2 throttle, 3 yaw, 4.. the potis."""
        return self.raw[self.place("channels") + number]

    @property
    def potis(self) -> int:
        """How many potis this set maps."""
        return self._places["channels"].length - FIRST_POTI

    def with_value(self, key: str, value: int) -> bytes:
        """Return the set with one parameter changed; unchanged where it has no such parameter."""
        if key not in self:
            return self.raw
        changed = bytearray(self.raw)
        changed[self.place(key)] = value
        return bytes(changed)

    def evaluate(self, key: str, potis: tuple[int, ...]) -> int:
        """Value of a parameter that may sit on a poti."""
        value = self[key]
        poti = poti_number(value)
        return value if poti is None else potis[poti - 1]

    def gains(self, *, stick_filter: bool, leak_is_slow: bool) -> AttitudeGains:
        """Constants of the attitude loop this set gives."""
        return AttitudeGains.from_parameters(
            stick_p=self["stick_p"],
            gyro_p=self["gyro_p"],
            gyro_i=self["gyro_i"],
            i_factor=self["integral_factor"],
            gyro_stability=self["gyro_stability"],
            stick_yaw_p=self["stick_yaw_p"],
            stick_filter=stick_filter,
            ta=LEAK_SLOW if leak_is_slow else LEAK_FAST,
        )


def clamp_written(raw: bytes) -> bytes:
    """Return the set as it is stored: a FlightCtrl pulls some values into range when it writes."""
    for key, (low, high) in _BOUNDS.items():
        parameters = Parameters(raw)
        raw = parameters.with_value(key, max(low, min(high, parameters[key])))
    return raw
