"""A whole flight in one process and in virtual time: the daemon's control, link and eyes on a simulated aircraft."""
