"""Foxglove and Lichtblick look at a MikroKopter, live or played: a WebSocket server with the schemas they know."""
