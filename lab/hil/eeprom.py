"""What a FlightCtrl of the proving ground has in its EEPROM: its factory sets, set up for this transmitter.

The firmware writes its factory sets itself, into an empty EEPROM at its first start. Then each is changed as its owner
would: receiver by pulse train, external control on potentiometer 1.
"""

from __future__ import annotations

from typing import Final

from lab.hil.build import FIRMWARE, Firmware
from lab.hil.chip import Chip
from mkdaemon.errors import ConfigError
from mkdaemon.protocol.settings import Layout, ParameterSet, known_revisions, layout_of, poti_reference

SIZES: Final = {"atmega1284p": 4096, "atmega644p": 2048, "atmega644": 2048}
"""[byte]."""
FIRST_START: Final = 20.0
"""Time after which the firmware has written everything [s]; 2.12a needs 12."""
QUIET_LEVELS: Final = (512.3, 512.3, 512.3, 800.0 + 190 * 52.0, 14.8 * 31, 512.0 + 170, 512.0, 512.0)
"""Analog channels of an aircraft at rest [LSB]."""
STEP: Final = 0.005
"""[s]."""
SETTINGS: Final = {"receiver": 0, "external_control": poti_reference(1)}
"""Changed in every set: the pulse train of one cable, the gate."""
NEUTRAL: Final = (512).to_bytes(2, "little")
ACCELEROMETER: Final = 4
"""Where every generation from 0.84 to 2.12 keeps the two lateral neutral values of its accelerometer: that is
calibrated once in the life of a board, on a level table."""


def content(firmware: Firmware) -> bytes:
    """The EEPROM of a board that flies; made once and kept beside the firmware.

    Raises:
        ConfigError: the firmware wrote no parameter set whose layout is known.
    """
    path = FIRMWARE / firmware.name / "eeprom.bin"
    if not path.exists():
        path.write_bytes(_make(firmware))
    return path.read_bytes()


def _make(firmware: Firmware) -> bytes:
    chip = Chip(firmware, b"\xff" * SIZES[firmware.mcu], seed=1)
    chip.lines.analog[:] = QUIET_LEVELS
    said = bytearray()
    while chip.now < FIRST_START:
        chip.run(STEP)
        said += bytes(byte for _, byte in chip.read())
    stored = bytearray(chip.eeprom())
    layouts = [layout for revision in known_revisions() if (layout := layout_of(revision)) is not None]
    found = [
        (start, layout)
        for layout in layouts
        for start in range(len(stored) - layout.size)
        if _is_set(stored, start, layout)
    ]
    if not found:
        raise ConfigError(f"{firmware.name}: no parameter set of a known revision in its EEPROM; it said: {said!r}")
    for start, layout in found:
        changed = ParameterSet.from_payload(bytes(stored[start : start + layout.size])).replaced(SETTINGS)
        stored[start : start + layout.size] = changed.raw
        stored[start + layout.size] = _checksum(changed.raw)
    stored[ACCELEROMETER : ACCELEROMETER + 4] = NEUTRAL + NEUTRAL
    return bytes(stored)


def _checksum(raw: bytes) -> int:
    return (0xAA + sum(raw)) & 0xFF


def _is_set(stored: bytearray, start: int, layout: Layout) -> bool:
    """Whether a parameter set of this layout begins here; its checksum follows it."""
    raw = stored[start : start + layout.size]
    is_named = raw[-12:].split(b"\0")[0].isalnum()
    return raw[0] == layout.revision and is_named and stored[start + layout.size] == _checksum(bytes(raw))
