"""What a player of recordings says about itself."""

from __future__ import annotations

from enum import StrEnum

from pydantic import Field

from mkdaemon.telemetry.base import Command, Telemetry


class PlayState(StrEnum):
    """What it does."""

    WAITING = "waiting"
    """Nobody has subscribed or asked yet."""
    PLAYING = "playing"
    PAUSED = "paused"
    ENDED = "ended"
    """Everything was put."""
    STOPPED = "stopped"
    """It was told to end before."""


class PlayStatus(Telemetry):
    """How far a recording is: `replay/status/<vehicle>`, twice a second and at the end."""

    file: str
    """The recording."""
    state: PlayState
    """What the player does."""
    speed: float
    """Seconds of the recording a second."""
    place: float
    """Since the beginning of what is played [s]."""
    length: float
    """Of what is played [s]."""
    sent: int
    """Values put in this round."""
    values: int
    """Values in the file to be put."""


class PlayAction(StrEnum):
    """What a player is asked to do."""

    PAUSE = "pause"
    GO_ON = "go_on"
    STEP = "step"
    """Play one value and pause."""
    SPEED = "speed"
    """Play at `speed`."""


class PlayControl(Command):
    """Ask a player of recordings: `replay/control/<vehicle>`, answered by a `PlayStatus`."""

    action: PlayAction = Field(strict=False)
    """What to do."""
    speed: float = Field(default=1.0, ge=1 / 64, le=1024.0)
    """Seconds of the recording a second, for `speed`."""
