"""A motion capture system of OptiTrack's protocol, NatNet 2.8, as far as the library `motioncapture` reads it.

Source: libmotioncapture 1.1, `src/optitrack.cpp`: it asks for the server's version and the names of bodies, then takes
measurements at the port that it was told.
"""

from __future__ import annotations

import socket
import struct
import threading
from contextlib import contextmanager

COMMANDS, MEASUREMENTS = 1510, 15110
CONNECT, SERVER, ASK_NAMES, NAMES, MEASUREMENT = 0, 1, 4, 5, 7
VERSION = (2, 8, 0, 0)


def message(kind, content):
    return struct.pack("<HH", kind, len(content)) + content


def server_info():
    name = b"natnet".ljust(256, b"\0")
    rest = struct.pack("<QHB4s", 1000, MEASUREMENTS, 0, bytes(4))
    return message(SERVER, name + bytes(VERSION) + bytes(VERSION) + rest)


def names(*bodies):
    each = (struct.pack("<i", 1) + name.encode() + b"\0" + struct.pack("<ii3f", k, -1, 0, 0, 0) for k, name in bodies)
    return message(NAMES, struct.pack("<i", len(bodies)) + b"".join(each))


def measurement(frame, *bodies):
    """A measurement of bodies, each (number, position, quaternion (w, x, y, z), whether it is seen)."""
    each = (
        struct.pack("<i8fH", k, *place, *turn[1:], turn[0], 0.0, int(is_seen)) for k, place, turn, is_seen in bodies
    )
    head, tail = struct.pack("<iiii", frame, 0, 0, len(bodies)), struct.pack("<iifIIdhi", 0, 0, 0, 0, 0, 0, 0, 0)
    return message(MEASUREMENT, head + b"".join(each) + tail + bytes(64))


@contextmanager
def system(make, rate=100.0):
    """Serve on this machine; `make` gives the bodies of a measurement by its number, and their names by None."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asked:
        asked.bind(("127.0.0.1", COMMANDS))
        asked.settimeout(1.0 / rate)
        ends = threading.Event()

        def serve():
            frame = 0
            while not ends.is_set():
                try:
                    data, whom = asked.recvfrom(65536)
                except TimeoutError:
                    frame += 1
                    asked.sendto(measurement(frame, *make(frame)), ("127.0.0.1", MEASUREMENTS))
                    continue
                kind = struct.unpack("<H", data[:2])[0]
                if kind in (CONNECT, ASK_NAMES):
                    asked.sendto(server_info() if kind == CONNECT else names(*make(None)), whom)

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            yield
        finally:
            ends.set()
            thread.join()
