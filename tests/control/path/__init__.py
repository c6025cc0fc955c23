"""Paths: curves in time, and what they are checked against."""
