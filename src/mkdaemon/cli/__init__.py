"""The two programs: `mkdaemon` beside the aircraft, `mkctl` as a client of the bus."""
