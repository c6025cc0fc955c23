"""Paths that clients upload: pure curves in time, checked against what the aircraft can do."""
