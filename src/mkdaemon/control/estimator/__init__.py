"""Where the aircraft is, how it moves, and what pushes it: an estimate over late, noisy and missing measurements."""
