"""Motor test and the settings of the motor controllers, as the FlightCtrl serves them.

Source: docs/firmware-notes, "Commands with side effects"; docs/protocol.md, section 7.
"""

from __future__ import annotations

from typing import Final

from mkdaemon.protocol.flags import MotorControllerStatus
from mkdaemon.protocol.messages import MotorController, MotorControllerWritten, MotorTestDone
from mkdaemon.protocol.wire import WireMessage
from mksim.boards.eeprom import BL_SIZE, MOTORS, Eeprom, bl_checksum

TEST: Final = 0.52
"""How long one `t` turns the motors."""
LOCKOUT: Final = 0.5
"""Settings are not touched for so long after a motor test."""
READ: Final = 59e-3
"""Bus time to read a motor controller's settings: the whole reply is there 61 to 67 ms after the request."""
WRITE: Final = 0.25
_SLOTS: Final = 16
_LONG_FRAME: Final = 21
"""Characters from which `t` copies sixteen values; shorter frames copy four."""
_COMPATIBLE: Final = 0x02
_COMPATIBLE_MASK: Final = 0x0B


class MotorBench:
    """The motor test and the BL settings.

    Attributes:
        values: set points of the last `t`; kept, with their time frozen, while motors run.
    """

    def __init__(self, eeprom: Eeprom) -> None:
        self._eeprom = eeprom
        self.values = bytes(_SLOTS)
        self._left = 0.0
        self._last = 0.0

    def test(self, payload: bytes, frame_chars: int, now: float) -> WireMessage:
        """Take a `t`; the motors turn for half a second once nothing else drives them."""
        count = _SLOTS if frame_chars >= _LONG_FRAME else 4
        self.values = payload[:count] + self.values[count:]
        self._left = TEST
        self._last = now
        return MotorTestDone()

    def pass_time(self, now: float, *, running: bool) -> None:
        """Let the test's time run; it stands still while motors run."""
        if not running:
            self._left = max(0.0, self._left - (now - self._last))
        self._last = now

    @property
    def is_testing(self) -> bool:
        """Whether a motor test drives the motors."""
        return self._left > 0.0 and any(self.values)

    def setpoints(self, now: float) -> list[int] | None:
        """Set points of a running test, one a motor."""
        return list(self.values) if self.is_testing else None

    def _refusal(self, motor: int, *, running: bool) -> MotorControllerStatus | None:
        if running or self._left > 0.0:
            return MotorControllerStatus.MOTORS_RUNNING
        if motor > MOTORS:
            return MotorControllerStatus.NO_SUCH_MOTOR
        return None

    def read(self, motor: int, *, running: bool) -> MotorController:
        """Build U."""
        status = self._refusal(motor, running=running)
        if status is None and motor == 0:
            status = MotorControllerStatus.CANNOT_READ
        raw = self._eeprom.motor_configs[min(max(motor, 1), MOTORS) - 1]
        done = status is None
        head = bytes((int(done), 0 if status is None else int(status), motor))
        return MotorController.decode(head + raw)

    def write(self, motor: int, raw: bytes, *, running: bool) -> MotorControllerWritten:
        """Take a BL configuration and build W; motor 0 means all."""
        status = self._refusal(motor, running=running)
        if status is None and raw[0] & _COMPATIBLE_MASK != _COMPATIBLE:
            status = MotorControllerStatus.FIRMWARE_INCOMPATIBLE
        if status is None and bl_checksum(raw) != raw[BL_SIZE - 1]:
            status = MotorControllerStatus.CHECKSUM
        if status is not None:
            return MotorControllerWritten(done=0, status=status)
        for index in range(MOTORS) if motor == 0 else (motor - 1,):
            self._eeprom.motor_configs[index] = raw
        self._eeprom.save()
        return MotorControllerWritten(done=1, status=MotorControllerStatus.SUCCESS)
