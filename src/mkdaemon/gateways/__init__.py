"""Gateways to other systems beside the daemon: each a process of its own, and a client of the bus."""
