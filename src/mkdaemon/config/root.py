"""The whole configuration file."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from mkdaemon.config.base import Section
from mkdaemon.config.bus import BusConfig
from mkdaemon.config.camera import CameraSection
from mkdaemon.config.commands import CommandsConfig
from mkdaemon.config.control import ControlConfig
from mkdaemon.config.link import LinkConfig
from mkdaemon.config.positions import Positions
from mkdaemon.config.record import RecordConfig
from mkdaemon.config.vehicle import VehicleConfig
from mkdaemon.config.vision import VisionSection


class DaemonSections(Section):
    """Sections of a file that the daemon reads: each may be left out, every key has a documented default."""

    vehicle: VehicleConfig = VehicleConfig()
    """Which aircraft this is."""
    link: LinkConfig = LinkConfig()
    """The serial line, streams and echo."""
    bus: BusConfig = BusConfig()
    """Where clients meet the daemon."""
    commands: CommandsConfig = CommandsConfig()
    """Dangerous requests that may be made."""
    control: ControlConfig = ControlConfig()
    """Authority, limiter, control rate."""
    cameras: tuple[CameraSection, ...] = ()
    """Cameras, each a `[[cameras]]` table; none: the daemon does not look."""
    positions: Positions = ()
    """Sources of poses, each a `[[positions]]` table; none: the aircraft is flown by its cameras."""
    vision: VisionSection = VisionSection()
    """Detector and tracker of all cameras."""
    record: RecordConfig = RecordConfig()
    """The black box: what is recorded, where, and how much room it may take."""


class Config(DaemonSections):
    """One aircraft: the file as the daemon reads it."""

    sim: dict[str, Any] = Field(default_factory=dict)
    """The simulated aircraft, as it stands there: only the simulator knows these keys, and checks them."""
