"""Whether what a NaviCtrl shows of its GPS receiver is of now: only its error code tells. Pure."""

from __future__ import annotations

from enum import Enum, auto
from typing import Final

from mkdaemon.protocol.errorcodes import ErrorCode


class ReceiverReception(Enum):
    """What the receiver is known to do."""

    LIVE = auto()
    """It delivers."""
    NO_FIX = auto()
    """It counts satellites, and position and speed stay at their last values, marked valid."""
    SILENT = auto()
    """Nothing comes from it: all that is shown of it stays as it was last."""


_MEANS: Final = {
    ErrorCode.NO_GPS: ReceiverReception.SILENT,
    ErrorCode.GPS_LOST: ReceiverReception.SILENT,
    ErrorCode.NO_GPS_FIX: ReceiverReception.NO_FIX,
}
_HIDES: Final = frozenset(
    {
        ErrorCode.FC_INCOMPATIBLE,
        ErrorCode.NO_FC,
        ErrorCode.NO_COMPASS,
        *(code for code in ErrorCode if ErrorCode.GYRO_PITCH <= code <= ErrorCode.MIXER),
    }
)
"""A NaviCtrl shows one error, and these before those of its receiver: under them what was known before goes on.
Source: NaviCtrl 0.24, main.c, `CheckErrors`."""


class ReceiverWatch:
    """Follows the error code.

    Attributes:
        reception: what the receiver does.
    """

    def __init__(self) -> None:
        """Until an error says otherwise it delivers."""
        self.reception = ReceiverReception.LIVE

    def look(self, code: ErrorCode) -> None:
        """Take the code of a frame; call it before anything else of that frame is used."""
        if code not in _HIDES:
            self.reception = _MEANS.get(code, ReceiverReception.LIVE)

    @property
    def has_position(self) -> bool:
        """Whether position and speed are of now."""
        return self.reception is ReceiverReception.LIVE

    def satellites(self, shown: int) -> int | None:
        """How many satellites the receiver uses; None while it says nothing."""
        return None if self.reception is ReceiverReception.SILENT else shown
