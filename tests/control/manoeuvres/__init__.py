"""Manoeuvres flown one at a time, against a target that images show."""
