"""Recordings: entries, and the MCAP files that keep them; docs/recording.md."""
