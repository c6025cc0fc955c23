"""Python library for programs beside the daemon: `async with connect("cyberquad") as uav`."""

from mkdaemon.client.answers import Answer
from mkdaemon.client.connection import connect
from mkdaemon.client.lease import Lease
from mkdaemon.client.samples import Sample
from mkdaemon.client.streams import LastValue, Stream
from mkdaemon.client.summary import VehicleStatus
from mkdaemon.client.vehicle import Vehicle
from mkdaemon.client.watch import Watch

__all__ = [
    "Answer",
    "LastValue",
    "Lease",
    "Sample",
    "Stream",
    "Vehicle",
    "VehicleStatus",
    "Watch",
    "connect",
]
