"""Parameter sets of the simulated FlightCtrl: raw bytes as they cross the wire, and the values the simulation obeys.

Offsets count from the revision byte. Source: docs/protocol.md, "ParamSet layouts"; factory values as a FlightCtrl 2.12a
returned them for its sets Fast, Agile and Easy (tests/data holds that recording).
"""

from __future__ import annotations

from typing import Final

from mkdaemon.sim.attitude_loop import LEAK_FAST_S, LEAK_SLOW_S, AttitudeGains

SETS: Final = 5
FACTORY_ACTIVE: Final = 3
_NAME_SIZE: Final = 12
_POTI_FROM: Final = 248

_SIZES: Final = {73: 88, 103: 136, 106: 144, 108: 178}

_OLD: Final = {
    "global_config": 9,
    "stick_p": 16,
    "stick_d": 17,
    "stick_yaw_p": 18,
    "gas_min": 19,
    "gas_max": 20,
    "gyro_p": 23,
    "gyro_i": 24,
    "low_voltage": 25,
    "emergency_gas": 26,
    "emergency_time": 27,
    "i_factor": 29,
    "external_control": 69,
}
_NEW: Final = {
    "global_config": 13,
    "height_channel": 16,
    "stick_p": 23,
    "stick_d": 24,
    "stick_yaw_p": 25,
    "gas_min": 26,
    "gas_max": 27,
    "gyro_p": 30,
    "gyro_i": 31,
    "gyro_stability": 35,
    "low_voltage": 36,
    "emergency_gas": 37,
    "emergency_time": 38,
    "i_factor": 40,
    "gps_mode_channel": 81,
    "external_control": 98,
    "motor_safety_switch": 101,
}
_OFFSETS: Final = {73: _OLD, 103: _NEW, 106: _NEW, 108: _NEW}
_ABSENT: Final = {"gyro_stability": 6, "motor_safety_switch": 0, "gps_mode_channel": 0, "height_channel": 0}
"""Values older sets have no byte for."""

_EASY_106: Final = bytes.fromhex(
    "6a0302010405060708090a0b0c6a1e2805140f1e016e7f060a0408e61b4064780a64780620415a06100000000080"
    "3218e6805546dc033c007d7d7d325a327d34464e4e20004600000000aa28cc2800aa000664645a784b554b280608"
    "322a008c02000000000000003c960000008c468c460000000000000c001e1f0032f00000000272504561737900000000"
    "00000000"
)
_VARIANTS: Final[dict[int, tuple[str, dict[int, int]]]] = {
    1: ("Fast", {23: 10, 24: 16, 25: 6, 30: 90, 33: 90, 40: 32, 64: 60, 69: 75}),
    2: ("Agile", {23: 8, 24: 16, 25: 6}),
    3: ("Easy", {}),
}
"""Bytes of 2.12a's sets that differ from Easy; sets 4 and 5 are Easy again."""


def parameter_size(revision: int) -> int:
    """Bytes of a set on the wire, from the revision to the end of the name."""
    return _SIZES[revision]


def factory_set(revision: int, number: int) -> bytes:
    """Return a factory set; older and newer revisions carry the same values where they have the parameter."""
    name, changes = _VARIANTS[min(number, FACTORY_ACTIVE)]
    full = bytearray(_EASY_106)
    for offset, value in changes.items():
        full[offset] = value
    size = _SIZES[revision]
    if revision == 106:
        made = full
    else:
        made = bytearray(size)
        places = _OFFSETS[revision]
        for key, place in places.items():
            made[place] = full[_NEW[key]]
        channels = min(places["global_config"] - 1, 12)
        made[1 : 1 + channels] = full[1 : 1 + channels]
    made[0] = revision
    made[size - _NAME_SIZE :] = name.encode("latin-1").ljust(_NAME_SIZE, b"\0")
    return bytes(made)


class Parameters:
    """One parameter set as the main loop reads it."""

    __slots__ = ("_places", "raw")

    def __init__(self, raw: bytes) -> None:
        self.raw = raw
        self._places = _OFFSETS[raw[0]]

    def __getitem__(self, key: str) -> int:
        place = self._places.get(key)
        return _ABSENT[key] if place is None else self.raw[place]

    def __contains__(self, key: str) -> bool:
        return key in self._places

    def place(self, key: str) -> int:
        """Offset of a parameter in `raw`."""
        return self._places[key]

    def channel(self, number: int) -> int:
        """Receiver channel of function `number`: 0 pitch, 1 roll, 2 throttle, 3 yaw, 4.. the potis."""
        return self.raw[1 + number]

    @property
    def potis(self) -> int:
        """How many potis this set maps."""
        return min(self._places["global_config"] - 5, 8)

    def with_value(self, key: str, value: int) -> bytes:
        """Return the set with one parameter changed; unchanged where it has no such parameter."""
        place = self._places.get(key)
        if place is None:
            return self.raw
        changed = bytearray(self.raw)
        changed[place] = value
        return bytes(changed)

    def evaluate(self, key: str, potis: tuple[int, ...]) -> int:
        """Value of a parameter that may sit on a poti: 248..255 are potis 8..1."""
        value = self[key]
        if value < _POTI_FROM:
            return value
        number = 255 - value
        return potis[number] if number < len(potis) else 0

    def gains(self, *, stick_filter: bool, leak_is_slow: bool) -> AttitudeGains:
        """Constants of the attitude loop this set gives."""
        return AttitudeGains.from_parameters(
            stick_p=self["stick_p"],
            gyro_p=self["gyro_p"],
            gyro_i=self["gyro_i"],
            i_factor=self["i_factor"],
            gyro_stability=self["gyro_stability"],
            stick_yaw_p=self["stick_yaw_p"],
            stick_filter=stick_filter,
            ta=LEAK_SLOW_S if leak_is_slow else LEAK_FAST_S,
        )


_BOUNDS: Final = {"gas_max": (100, 247), "gas_min": (0, 60), "emergency_time": (0, 250), "gyro_stability": (1, 15)}
"""Ranges into which this simulation pulls values on writing; which ones a FlightCtrl clamps differs by release."""


def clamp_written(raw: bytes) -> bytes:
    """Return the set as it is stored: a FlightCtrl pulls some values into range when it writes."""
    parameters = Parameters(raw)
    for key, (low, high) in _BOUNDS.items():
        if key in parameters:
            raw = Parameters(raw).with_value(key, max(low, min(high, parameters[key])))
    return raw
