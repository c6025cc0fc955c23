"""Values that cross the bus, in SI units, one file a topic."""
