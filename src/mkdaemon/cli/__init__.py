"""mkctl: commands that are Zenoh clients like any other."""
