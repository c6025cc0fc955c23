"""What a FlightCtrl prints while it boots: plain text between frames, 628 characters in stages.

The number of characters is that of a genuine 2.12a; the words and the times of the stages are our own.
"""

from __future__ import annotations

from typing import Final

LENGTH: Final = 628
"""Characters of the whole text."""
_RULE: Final = "=" * 35
_STAGES: Final = (
    (
        0.1,
        f"\r\n{_RULE}\r\nFlight-Ctrl HW:2.2 SW:{{release}}\r\n{_RULE}\r\nClock: ok\r\nSettings: ok\r\n",
    ),
    (
        0.6,
        "Receiver: PPM, 12 channels\r\nMotor controllers:\r\n"
        + "".join(f" motor {n}: found, version 2\r\n" for n in range(1, 5)),
    ),
    (2.4, "Gyro offsets: pitch ok, roll ok, yaw ok\r\nACC neutral: pitch ok, roll ok, top ok\r\n"),
    (3.6, "Pressure sensor: offset set\r\nNaviCtrl: looked for\r\nMixer: quadrocopter, 4 motors\r\n"),
)
"""Time after the reset [s] and text."""


def boot_text(release: str) -> tuple[tuple[float, str], ...]:
    """Return the stages for a release such as `2.12a`: seconds after the reset, and text."""
    stages = [(after, text.format(release=release)) for after, text in _STAGES]
    missing = LENGTH - sum(len(text) for _, text in stages) - 4
    return (*stages, (4.4, "\r\n" + "=" * missing + "\r\n"))
