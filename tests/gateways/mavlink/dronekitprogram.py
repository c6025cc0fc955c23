"""A DroneKit program in a process of its own: connects, reads an empty list, uploads a mission and reads it back.

`python -m tests.gateways.mavlink.dronekitprogram URL`; it prints one line of JSON.
"""

from __future__ import annotations

import collections
import collections.abc
import json
import sys

collections.MutableMapping = collections.abc.MutableMapping  # DroneKit 2.9.2 is older than Python 3.10

from dronekit import Command, connect  # noqa: E402

WAYPOINT, RELATIVE = 16, 3


def listed(vehicle):
    """The mission that the aircraft holds."""
    vehicle.commands.download()
    vehicle.commands.wait_ready()
    return [(round(one.x, 6), round(one.y, 6), one.z) for one in vehicle.commands]


def main(url):
    """Do it."""
    vehicle = connect(url, wait_ready=["parameters", "armed", "mode", "attitude"], timeout=120)
    empty = listed(vehicle)
    for latitude in (53.2302, 53.2303):
        vehicle.commands.add(Command(0, 0, 0, RELATIVE, WAYPOINT, 0, 0, 0, 0, 0, 0, latitude, 7.4591, 10))
    vehicle.commands.upload(timeout=60)
    print(json.dumps({"mode": vehicle.mode.name, "empty": empty, "stored": listed(vehicle)}), flush=True)
    vehicle.close()


if __name__ == "__main__":
    main(*sys.argv[1:])
