"""The commands of `mkctl`."""
