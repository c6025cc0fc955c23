"""Units of the wire and their factor to SI.

Headings and bearings keep the compass sense (clockwise from north); everything about the body is turned to FLU by the
sign: pitch + is nose down, roll + is right side down, yaw + is nose left. The firmware counts roll positive with the
LEFT side down, so its roll fields carry a negated unit. Sources: docs/protocol.md, "Signs"; docs/firmware-notes.md,
section 6.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple


class Unit(NamedTuple):
    """Value of one count of a wire field.

    Attributes:
        wire: the unit of one count, in words.
        si: the unit after scaling; angles in rad, positions on the globe in deg.
        scale: SI value of one count; negative where the firmware's axis is opposite to ours.
        zero: wire value that means nothing of it.
    """

    wire: str
    si: str
    scale: float
    zero: int = 0

    def __neg__(self) -> Unit:
        return self._replace(scale=-self.scale)


_DEGREE: Final = math.pi / 180.0

DEG: Final = Unit("deg", "rad", _DEGREE)
TWO_DEG: Final = Unit("2 deg", "rad", 2.0 * _DEGREE)
DECI_DEG: Final = Unit("0.1 deg", "rad", 0.1 * _DEGREE)
GLOBE: Final = Unit("1e-7 deg", "deg", 1e-7)
METRE: Final = Unit("m", "m", 1.0)
TEN_METRE: Final = Unit("10 m", "m", 10.0)
DECIMETRE: Final = Unit("dm", "m", 0.1)
FIVE_CM: Final = Unit("5 cm", "m", 0.05)
MILLIMETRE: Final = Unit("mm", "m", 0.001)
CM_PER_S: Final = Unit("cm/s", "m/s", 0.01)
DM_PER_S: Final = Unit("0.1 m/s", "m/s", 0.1)
SECOND: Final = Unit("s", "s", 1.0)
MILLISECOND: Final = Unit("ms", "s", 0.001)
TEN_MS: Final = Unit("10 ms", "s", 0.01)
DECIVOLT: Final = Unit("0.1 V", "V", 0.1)
DECIAMPERE: Final = Unit("0.1 A", "A", 0.1)
AMPERE: Final = Unit("A", "A", 1.0)
MAH: Final = Unit("mAh", "C", 3.6)
CELSIUS: Final = Unit("degC", "degC", 1.0)
BYTES_PER_S: Final = Unit("bytes/s", "bytes/s", 1.0)
STICK: Final = Unit("stick", "stick", 1.0)
STICK_FROM_BOTTOM: Final = Unit("stick + 127", "stick", 1.0, 127)
MIX: Final = Unit("1/64", "1", 1.0 / 64.0)
