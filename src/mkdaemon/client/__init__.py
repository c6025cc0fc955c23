"""Python library for programs beside the daemon: `async with connect("cyberquad") as uav`."""

from mkdaemon.client.answers import Answer
from mkdaemon.client.connection import connect
from mkdaemon.client.samples import Sample
from mkdaemon.client.vehicle import Vehicle
from mkdaemon.client.verbs import Release, ReleaseOutcome
from mkdaemon.client.watch import Watch

__all__ = ["Answer", "Release", "ReleaseOutcome", "Sample", "Vehicle", "Watch", "connect"]
