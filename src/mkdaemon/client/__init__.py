"""Python client of the daemons on the bus."""
