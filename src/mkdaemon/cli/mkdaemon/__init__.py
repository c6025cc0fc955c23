"""The commands of `mkdaemon`."""
