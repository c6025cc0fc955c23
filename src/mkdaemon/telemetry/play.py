"""What a player of recordings says about itself."""

from __future__ import annotations

from enum import StrEnum

from mkdaemon.telemetry.base import Telemetry


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
