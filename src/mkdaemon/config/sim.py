"""Configuration of the simulated aircraft: which boards, on what line, in what flight."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Final, Literal

from pydantic import Field, field_validator

from mkdaemon.config.base import Section
from mkdaemon.config.scene import SceneConfig
from mkdaemon.config.sim_flight import FlightConfig
from mkdaemon.config.sim_radio import RadioConfig

_LAST_PORT: Final = 65535


class PilotPlan(StrEnum):
    """What the simulated safety pilot does with the sticks."""

    CIRCLE = "circle"
    """Arms, takes off and flies a slow circle by hand until the battery is low."""
    HOVER = "hover"
    """Arms, takes off and hovers by hand."""
    SUPERVISE = "supervise"
    """Takes off, hands over to a machine when it takes control, takes back when it lets go."""
    WAIT = "wait"
    """Leaves everything to the machine, take-off included; takes back in the air."""
    START = "start"
    """Starts the motors, leaves the take-off to the machine; takes back in the air, stops the motors on the ground."""
    NOTHING = "nothing"
    """Leaves the sticks alone: throttle down, the rest centred."""


class GasLaw(StrEnum):
    """How the throttle of external control meets the pilot's."""

    STOCK = "stock"
    """The smaller of the two; with THROTTLE_ADD their sum."""
    FORK = "fork"
    """The value as it is, as one public fork has it; that fork also adds the commands x e r o."""


class SimConfig(Section):
    """The simulated aircraft."""

    seed: int = Field(default=1, ge=0)
    """Of every random stream: the same seed and the same input give the same bytes."""
    board: Literal["nc", "fc"] = "nc"
    """Whose serial port is offered: the NaviCtrl's, with the FlightCtrl behind it, or the FlightCtrl's alone."""
    fc: Literal["early", "2.08", "2.12a", "2.14"] = "2.12a"
    """FlightCtrl release: three generations of external control and dead-man."""
    nc: Literal["0.24", "2.14"] = "0.24"
    """NaviCtrl release."""
    gas_law: GasLaw = GasLaw.STOCK
    """Stock firmware, or the fork."""
    gate_parameter: int = Field(default=255, ge=0, le=255)
    """ExternalControl in the sets of a new EEPROM: 255 is poti 1, the pilot's switch; 0 as from the factory."""
    calibrated: bool = False
    """The sensors were calibrated before the simulation begins; otherwise the gesture is needed first."""
    eeprom: Path | None = None
    """File that keeps parameter sets, mixer and motor controller settings; none forgets them at the end."""
    pilot_plan: PilotPlan = PilotPlan.CIRCLE
    """What the pilot does."""
    pilot_wait: float = Field(default=20.0, ge=0.0, le=600.0)
    """Before he touches the sticks, unless `mkctl sim start` asks him earlier [s]: a daemon looks behind a NaviCtrl for
    the FlightCtrl only with motors off."""
    nc_loop: float = Field(default=0.1e-3, ge=0.05e-3, le=5e-3)
    """Period of the NaviCtrl's main loop [s]; 1 ms loses half of the control frames at 50 Hz."""
    flight: FlightConfig = FlightConfig()
    """Airframe, air, battery, sensors, pilot."""
    radio: RadioConfig = RadioConfig()
    """The way between host and board."""
    scene: SceneConfig = SceneConfig()
    """The on-board camera and what it sees."""
    listen: str | None = Field(default=None, pattern=r"^[^:]+:\d{1,5}$")
    """Also offer the port over TCP, `host:port`; it carries one client at a time."""
    connect: tuple[str, ...] = ("tcp/127.0.0.1:7447",)
    """Zenoh endpoints for truth and faults; where nobody listens the simulator flies on without."""
    truth_rate_hz: float = Field(default=50.0, ge=0.0, le=488.0)
    """How often the true state is published [1/s]; 0 never."""

    @field_validator("listen")
    @classmethod
    def _is_a_port(cls, text: str | None) -> str | None:
        if text is not None and int(text.rpartition(":")[2]) > _LAST_PORT:
            raise ValueError(f"'{text}': a TCP port is 0 to {_LAST_PORT}")
        return text
