"""The track of a recorded flight beside where the simulated aircraft truly was."""

from __future__ import annotations

import asyncio
import math
from datetime import datetime
from itertools import pairwise
from xml.etree import ElementTree

import numpy as np
import pytest

from lab.rigs.blackbox import RecordedDaemon
from lab.rigs.boardport import ADAPTER_TIME
from mkdaemon.cli.mkctl.export import export
from mkdaemon.config.root import Config
from mkdaemon.frames import enu_from_geodetic
from mkdaemon.virtualtime import run_virtually
from mksim.config import SimConfig
from mksim.simulation import Simulation
from tests.client.test_export import GPX, GX

LENGTH = 24.0
"""Take-off, and the first half of the circle [s]."""
LOOK = 0.05
LATE = 0.6
"""A position is published so long after the receiver fixed it at most: its period, and that of the stream [s]."""
NEAR = 0.03
"""Three digits of the receiver [m]."""


def flown(folder):
    """A hand-flown circle of an aircraft whose receiver has no noise: the recording, the truth, the origin."""
    sim = SimConfig.model_validate(
        {
            "board": "nc", "nc": "2.14", "fc": "2.14", "calibrated": True, "pilot_plan": "circle", "pilot_wait": 2,
            "flight": {"sensors": {"gps_noise": 0.0, "gps_wander": 0.0}},
        }
    )  # fmt: skip
    vehicle, link = {"name": "t", "state_folder": folder}, {"port": "/dev/virtual", "rates": {"osd": 200}}
    cfg = Config.model_validate({"vehicle": vehicle, "link": link, "bus": {"listen": ()}})

    async def story():
        daemon = RecordedDaemon(cfg, lambda: Simulation(sim), seed=1, tick=ADAPTER_TIME)
        tasks, truth = daemon.start(), []
        end = asyncio.get_running_loop().time() + LENGTH
        while (now := asyncio.get_running_loop().time()) < end:
            truth.append((now, *daemon.socket.aircraft.world.truth.position_enu))
            await asyncio.sleep(LOOK)
        await daemon.stop(tasks)
        daemon.write(folder / "flight.mcap")
        return np.array(truth), daemon.tape.base.offset_ns / 1e9

    truth, offset = run_virtually(story())
    flight = sim.flight
    origin = (
        math.radians(flight.origin_latitude_deg), math.radians(flight.origin_longitude_deg), flight.origin_altitude
    )  # fmt: skip
    return np.add(truth, [offset, 0.0, 0.0, 0.0]), origin


def distances(points, truth, origin):
    """How far each point (time, latitude, longitude [deg]) is from where the aircraft was shortly before [m]."""
    found = []
    for time, latitude, longitude in points:
        east, north, _ = enu_from_geodetic(math.radians(latitude), math.radians(longitude), origin[2], origin)
        near = truth[(truth[:, 0] >= time - LATE) & (truth[:, 0] <= time + LOOK)]
        # between two looks it flew straight
        found.append(min(_to_line((east, north), a[1:3], b[1:3]) for a, b in pairwise(near)))
    return found


def _to_line(point, start, end):
    way = end - start
    share = np.clip(np.dot(point - start, way) / max(np.dot(way, way), 1e-12), 0.0, 1.0)
    return float(np.linalg.norm(point - start - share * way))


def test_a_track_is_where_the_aircraft_truly_was(tmp_path):
    truth, origin = flown(tmp_path)
    assert np.ptp(truth[:, 1]) > 1.0  # it moved
    for form in ("gpx", "kml"):
        export(tmp_path / "flight.mcap", to=form, output=tmp_path / f"flight.{form}")
    track = ElementTree.parse(tmp_path / "flight.gpx").getroot().findall(f".//{GPX}trkpt")
    points = [
        (datetime.fromisoformat(one.findtext(f"{GPX}time")).timestamp(), float(one.get("lat")), float(one.get("lon")))
        for one in track
    ]
    assert len(points) > 4 * LENGTH
    assert max(distances(points, truth, origin)) < NEAR
    coords = [one.text.split() for one in ElementTree.parse(tmp_path / "flight.kml").getroot().iter(f"{GX}coord")]
    assert [(float(lat), float(lon)) for lon, lat, _ in coords] == [point[1:] for point in points]
    heights = [float(height) for *_, height in coords]
    assert max(heights) - min(heights) == pytest.approx(np.ptp(truth[:, 3]), abs=0.5)
