"""Closed-loop flights of the estimator and the autopilot against the simulated aircraft, in virtual time."""
