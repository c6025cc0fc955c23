"""Conversations with a board: waypoints, settings, labels. Pure generators; see `steps`."""

from mkdaemon.protocol.procedures.steps import Ask, Patience, Pause, Procedure, Progress, Step

__all__ = ["Ask", "Patience", "Pause", "Procedure", "Progress", "Step"]
