"""The serial line: ports, transmit scheduler, requests, subscriptions, health, recovery."""
