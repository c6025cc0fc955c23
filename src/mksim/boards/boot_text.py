"""What a FlightCtrl prints while it boots: plain text between frames, 628 characters in stages.

The number of characters is that of a genuine 2.12a. As there, a line begins with its line break and the last one is
never ended. The words and the times of the stages are our own.
"""

from __future__ import annotations

from typing import Final

LENGTH: Final = 628
"""Characters of the whole text."""
_BREAK: Final = "\n\r"
_RULE: Final = "=" * 35
_STAGES: Final = (
    (0.1, (_RULE, "Flight-Ctrl HW:2.2 SW:{release}", _RULE, "Clock: ok", "Settings: ok")),
    (0.6, ("Receiver: PPM, 12 channels", *(f"Motor {number}: found, version 2" for number in range(1, 5)))),
    (2.4, ("Gyro offsets: pitch ok, roll ok, yaw ok", "ACC neutral: pitch ok, roll ok, top ok")),
    (3.6, ("Pressure sensor: offset set", "NaviCtrl: looked for", "Mixer: quadrocopter, 4 motors")),
)
"""Time after the reset [s] and lines."""
_LAST_STAGE: Final = 4.4


def boot_text(release: str) -> tuple[tuple[float, str], ...]:
    """Return the stages for a release such as `2.12a`: seconds after the reset, and text."""
    stages = [(after, "".join(_BREAK + line.format(release=release) for line in lines)) for after, lines in _STAGES]
    missing = LENGTH - sum(len(text) for _, text in stages) - len(_BREAK)
    return (*stages, (_LAST_STAGE, _BREAK + "=" * missing))
