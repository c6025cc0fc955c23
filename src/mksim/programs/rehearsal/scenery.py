"""What is flown in a rehearsal: an aircraft on a target that starts to move, light wind, a radio, a camera."""

from __future__ import annotations

from typing import Any, Final

from mksim.config import PilotPlan, SimConfig

PAD_STARTS: Final = 45.0
"""The target stands until then [s]."""
PAD_SPEED: Final = 0.3
"""Of the target once it moves, east [m/s]."""
IMAGE_LATENCY: Final = 0.060
"""From the exposure to the host [s]; the eyes' own time comes on top."""
EYES_TIME: Final = 0.020
"""What the eyes need for an image on an ordinary computer [s]; virtual time knows no computer."""


def simulated_aircraft(seed: int, wind: str, fps: float) -> SimConfig:
    """An aircraft on its target: the pilot starts the motors and leaves the rest to the machine.

    Args:
        seed: of everything random.
        wind: none, indoor, light or moderate.
        fps: images a second.
    """
    radio = {"kind": "xbee"}
    platform = {"kind": "ramp", "speed": PAD_SPEED, "acceleration": 0.15, "delay": PAD_STARTS}
    scene: dict[str, Any] = {"enabled": True, "fps": fps, "exposure_ms": 6.0, "platform": platform}
    return SimConfig.model_validate(
        {
            "seed": seed,
            "board": "fc",
            "pilot_plan": PilotPlan.START,
            "pilot_wait": 4.0,
            "flight": {"wind": wind},
            "radio": {"to_board": radio, "to_host": radio | {"usb_timer": 0.001}},
            "scene": scene | {"light": {"noise_sd": 2.0}},
        }
    )
