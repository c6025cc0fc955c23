"""Where firmware of two generations keeps external control."""

from __future__ import annotations

from pathlib import Path

import pytest

from lab.hil.build import NO_RECEIVER, PULSE_TRAIN, Firmware
from lab.hil.chip import control_of
from mkdaemon.errors import ConfigError


def firmware(*symbols):
    return Firmware("some", Path("some.elf"), "atmega644p", 20_000_000, dict.fromkeys(symbols, 0x200))


def test_a_generation_is_known_by_its_variable():
    assert (control_of(firmware("ExternalControl")).pitch, control_of(firmware("ExternalControl")).config) == (0, 5)
    old = control_of(firmware("MotorenEin", "ExternControl"))
    assert (old.pitch, old.config, old.throttle) == (3, 10, "B")


def test_a_firmware_without_external_control_is_named():
    with pytest.raises(ConfigError, match=r"firmware some has neither ExternalControl nor ExternControl"):
        control_of(firmware("MotorenEin"))


def test_an_empty_receiver_library_reads_a_pulse_train():
    line = b"void LIBFC_Polling(void){}\nvoid LIBFC_ReceiverInit(unsigned char rtype){}\n"
    changed = NO_RECEIVER.sub(PULSE_TRAIN, line)
    assert changed.startswith(b"void LIBFC_Polling(void){}\nvoid LIBFC_ReceiverInit(unsigned char rtype){ TCCR1A = 0;")
    assert b"TIMSK1 |= (1 << ICIE1); }" in changed
    own = b"void LIBFC_ReceiverInit(unsigned char rtype){ start(rtype); }"
    assert NO_RECEIVER.sub(PULSE_TRAIN, own) == own
