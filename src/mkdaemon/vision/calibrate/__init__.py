"""Calibration of a camera, and printing of targets."""
