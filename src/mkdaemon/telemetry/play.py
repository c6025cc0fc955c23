"""State of a player of recordings."""

from enum import StrEnum

from pydantic import Field

from mkdaemon.telemetry.base import Command, Telemetry


class PlayState(StrEnum):
    """What it does."""

    WAITING = "waiting"
    """No client has subscribed or asked yet."""
    PLAYING = "playing"
    PAUSED = "paused"
    ENDED = "ended"
    """Everything was put; it can still go back where a viewer plays it."""
    STOPPED = "stopped"
    """It was ended early."""


class PlayStatus(Telemetry):
    """Position in a recording: `replay/status/<vehicle>`, twice a second and at the end."""

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
    zero: float = 0.0
    """Place 0 on the daemon's monotonic clock [s]."""
    starts: int = 0
    """How often it began: at first, at every place that was asked for, and again after the end."""


class PlayAction(StrEnum):
    """Command to a player."""

    PAUSE = "pause"
    GO_ON = "go_on"
    STEP = "step"
    """Play one value and pause."""
    SPEED = "speed"
    """Play at `speed`."""
    SEEK = "seek"
    """Go on at `place`."""


class PlayControl(Command):
    """Ask a player of recordings: `replay/control/<vehicle>`, answered by a `PlayStatus`."""

    action: PlayAction = Field(strict=False)
    """What to do."""
    speed: float = Field(default=1.0, ge=1 / 64, le=1024.0)
    """Seconds of the recording a second, for `speed`."""
    place: float = Field(default=0.0, ge=0.0, le=1e9)
    """Since the beginning of what is played [s], for `seek`."""
