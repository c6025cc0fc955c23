"""Names of the 32 debug channels of each board, in our words; blanks fill to 16 characters.

The channel meanings are those of docs/protocol.md (FC analog channels, NC analog labels).
"""

from __future__ import annotations

from typing import Final

LABEL_CHARS: Final = 16

FC_LABELS: Final = (
    "Pitch Angle",
    "Roll Angle",
    "Pitch Acc",
    "Roll Acc",
    "Yaw Gyro",
    "Altitude [0.1m]",
    "AccZ",
    "Throttle",
    "Compass Value",
    "Battery [0.1V]",
    "RC Level",
    "Gyro Compass",
    "Motor 1",
    "Motor 2",
    "Motor 3",
    "Motor 4",
    "16",
    "17",
    "18",
    "19",
    "Servo",
    "Hover Throttle",
    "Current [0.1A]",
    "Capacity [mAh]",
    "Height Setpoint",
    "25",
    "26",
    "27",
    "I2C Errors",
    "BL Limit",
    "GPS Pitch",
    "GPS Roll",
)

NC_LABELS: Final = (
    "Pitch Angle",
    "Roll Angle",
    "Pitch Acc",
    "Roll Acc",
    "Operating Radius",
    "FC-Flags",
    "NC-Flags",
    "Pitch Servo",
    "Roll Servo",
    "GPS Data",
    "Compass Heading",
    "Gyro Heading",
    "SPI Error",
    "SPI Okay",
    "I2C Error",
    "I2C Okay",
    "POI Index",
    "Acc Speed N",
    "Acc Speed E",
    "Speed Z",
    "20",
    "Speed N",
    "Speed E",
    "23",
    "24",
    "25",
    "26",
    "Distance N",
    "Distance E",
    "GPS Pitch",
    "GPS Roll",
    "Used Satellites",
)


def label(labels: tuple[str, ...], index: int) -> tuple[int, str]:
    """Return the number and the padded text of a channel; a number too high gives the last, as the boards do."""
    number = min(index, len(labels) - 1)
    return number, labels[number].ljust(LABEL_CHARS)


def label_checksum(labels: tuple[str, ...]) -> int:
    """Sum of all label characters modulo 256, which FC 2.10 and later report so that hosts can keep labels."""
    return sum(sum(text.ljust(LABEL_CHARS).encode("latin-1")) for text in labels) & 0xFF
