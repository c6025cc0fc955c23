"""The safety stories: lost clients, pulled cables, races, faults."""
