"""The messages of MAVLink as pymavlink has them: `common`, and what is still called `development` there.

Source: https://mavlink.io/en/messages/common.html; units and marks of unknown values are those of that page.
"""

from __future__ import annotations

from typing import Any, Final

from pymavlink.dialects.v20 import all as dialect

Message = Any
"""A message of the dialect: an attribute for each field."""

mavlink: Any = dialect

UINT8_UNKNOWN: Final = 0xFF
UINT16_UNKNOWN: Final = 0xFFFF
INT16_UNKNOWN: Final = 0x7FFF
NAN: Final = float("nan")
COMPONENT: Final = int(dialect.MAV_COMP_ID_AUTOPILOT1)
"""What the gateway is on the network: the autopilot, for it speaks in its place."""
BROADCAST: Final = 0
"""System or component that means all of them."""
