"""Self-calibration: what flights say about lens, mounting and sizes of the print. It tells, and changes nothing."""
