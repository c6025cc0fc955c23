"""Nonsense for a running daemon, for its bus, and for the flight core alone."""
