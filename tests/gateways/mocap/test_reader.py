"""The process that reads a system: before a library that is written for the test, and before the real one."""

from __future__ import annotations

import socket
import struct
import threading
import time
from contextlib import contextmanager
from itertools import islice

import pytest

from mkdaemon.errors import ConfigError
from mkdaemon.gateways.mocap.reader import frames_apart
from mkdaemon.gateways.mocap.systems import BodyPose, find_system
from tests.places import ROOT

LEVEL = (1.0, 0.0, 0.0, 0.0)
LIBRARY = """
import time
from types import SimpleNamespace as Made

class Connection:
    count = 0

    @property
    def rigidBodies(self):
        turn = Made(w=1.0, x=0.0, y=0.0, z=0.0)
        return {"drone7": Made(position=(self.count / 4, 2.0, 0.5), rotation=turn)}

    def waitForNextFrame(self):
        self.count += 1
        if self.count > 2:
            raise RuntimeError("the connection was lost")

def connect(kind, options):
    print("Using unicast", flush=True)
    if kind == "vrpn":
        raise RuntimeError("Unknown motion capture type!")
    if kind == "vicon":
        time.sleep(3600)
    return Connection()
"""


@pytest.fixture
def library(tmp_path, monkeypatch):
    """A library that loses OptiTrack after two measurements, never reaches Vicon, and does not know VRPN."""
    (tmp_path / "motioncapture.py").write_text(LIBRARY, encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{ROOT / 'src'}")


def test_measurements_and_the_loss_come_through(library):
    frames = frames_apart(find_system("optitrack"), "there", 60.0)
    expected = [{"drone7": BodyPose((x, 2.0, 0.5), LEVEL)} for x in (0.25, 0.5)]
    found = []
    with pytest.raises(RuntimeError, match="the connection was lost"):
        found += frames  # one that a busy machine reads late is left out
        found += frames
    assert all(each in expected for each in found)


def test_a_system_that_does_not_answer_is_given_up_and_an_unknown_kind_is_a_mistake(library):
    with pytest.raises(RuntimeError, match=r"no measurement for 1.5 s"):
        next(frames_apart(find_system("vicon"), "there", 1.5))
    with pytest.raises(ConfigError, match="built without vrpn"):
        next(frames_apart(find_system("vrpn"), "there", 60.0))


def bodies(frame):
    """Two bodies, of which one is hidden in every second measurement."""
    if frame is None:
        return (1, "drone7"), (2, "wand")
    return (1, (frame / 1024, 2.0, 0.5), LEVEL, True), (2, (0.0, 1.0, 0.0), (0.6, 0.8, 0.0, 0.0), frame % 2 == 0)


@pytest.mark.gateways
def test_the_real_library_reads_natnet():
    pytest.importorskip("motioncapture", reason="`make check-gateways` installs it")
    with system(bodies):
        found = list(islice(frames_apart(find_system("optitrack"), "127.0.0.1"), 40))
    assert all(each["drone7"].position[1:] == (2.0, 0.5) and each["drone7"].quaternion == LEVEL for each in found)
    ways = [each["drone7"].position[0] for each in found]
    assert ways == sorted(set(ways))
    seen = [each["wand"] for each in found if "wand" in each]
    assert 0 < len(seen) < len(found) and seen[0].quaternion == pytest.approx((0.6, 0.8, 0.0, 0.0))


@pytest.mark.gateways
@pytest.mark.parametrize("word", ["optitrack", "vicon"])
def test_the_real_library_is_given_up_where_nothing_answers(word):
    pytest.importorskip("motioncapture", reason="`make check-gateways` installs it")
    began = time.monotonic()
    with pytest.raises(RuntimeError, match=r"no measurement for 1.5 s"):
        next(frames_apart(find_system(word), "127.0.0.1", 1.5))
    assert time.monotonic() - began < 20.0


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
    """Serve on this machine; `make` gives the bodies of a measurement by its number, and their names by None.

    NatNet 2.8 as far as the library `motioncapture` reads it (libmotioncapture 1.1, `src/optitrack.cpp`): it asks for
    the server's version and the names of bodies, then takes measurements at the port that is named there.
    """
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
