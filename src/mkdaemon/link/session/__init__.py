"""The conversation over one port: pure, driven with `now`."""
