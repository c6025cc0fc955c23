"""Gateways to other systems: each is a separate process and a client of the bus."""
