"""Tag localisation: cameras, calibration, detection, pose, tracking."""
