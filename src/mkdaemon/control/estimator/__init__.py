"""Estimator of position, motion and disturbance, from late, noisy and missing measurements."""
