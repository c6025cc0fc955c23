"""Conversations with a board: waypoints, settings, labels, mixer, motor controllers. Pure generators; see `steps`."""

from mkdaemon.protocol.procedures.steps import (
    Ask,
    LiveSet,
    LiveSetAtRisk,
    LiveSetProven,
    Patience,
    Pause,
    Procedure,
    Progress,
    Step,
)

__all__ = [
    "Ask",
    "LiveSet",
    "LiveSetAtRisk",
    "LiveSetProven",
    "Patience",
    "Pause",
    "Procedure",
    "Progress",
    "Step",
]
