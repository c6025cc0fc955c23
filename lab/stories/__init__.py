"""The safety stories: lost clients, pulled cables, swaps, faults."""
