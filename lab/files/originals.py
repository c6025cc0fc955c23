"""Good files of every kind that a command reads: what the hostile ones are made of."""

from __future__ import annotations

import io
import json
import tempfile
from collections.abc import Sequence
from enum import StrEnum
from functools import cache
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from lab.places import CAPTURES, CONFIGS, ROOT
from mkdaemon.client.linktest.measures import LoadRun
from mkdaemon.client.linktest.probefile import to_csv
from mkdaemon.client.linktest.probes import Probe, ProbeKind
from mkdaemon.missions.format import FORMATS
from mkdaemon.protocol.settings import ParameterSet, layout_of
from mkdaemon.protocol.settings_file import SettingsFile
from mkdaemon.record.reader import Recording
from mkdaemon.record.writer import RecordingWriter
from mkdaemon.telemetry.mission import Mission, MissionPoint, PointKind

RECORDINGS: Final = ROOT / "tests" / "data" / "recordings"
_ENTRIES: Final = 400
"""Taken of the beginning of a long recording; of the rest only what was seen of the target."""
_SEEN: Final = ("vision/", "tf", "control/estimate", "control/output")


_REVISION: Final = 106
"""Of the parameter set: that of FlightCtrl 2.12a."""


class Kind(StrEnum):
    """A kind of file, named as its files end."""

    GPX = ".gpx"
    KML = ".kml"
    PLAN = ".plan"
    CSV = ".csv"
    WPL = ".wpl"
    SETTINGS_TOML = ".set.toml"
    SETTINGS_JSON = ".json"
    MIXER = ".mixer.toml"
    SCRIPT = ".script.toml"
    GAMEPAD = ".pad.toml"
    PAD_SESSION = ".pad.jsonl"
    ZENOH = ".json5"
    CONFIG = ".config.toml"
    CAMERA = ".camera.toml"
    TARGET = ".target.toml"
    CAPTURE = ".jsonl"
    BYTES = ".bin"
    PICTURE = ".png"
    JPEG = ".jpg"
    CLIP = ".avi"
    RECORDING = ".mcap"
    PROBES = ".probes.csv"


MISSION: Final = Mission(
    name="Round",
    points=(
        MissionPoint(latitude_deg=53.07, longitude_deg=8.79, altitude=1.0, kind=PointKind.POI, name="POI"),
        MissionPoint(
            latitude_deg=53.0722222,
            longitude_deg=8.7922222,
            altitude=15.0,
            radius=3,
            hold=5,
            poi=1,
            climb=2.5,
            speed=4.5,
        ),
        MissionPoint(latitude_deg=53.0733333, longitude_deg=8.7933333, altitude=20.0, heading_deg=360, name="P2"),
    ),
)
_PAD_SESSION: Final = (
    {"t": 0.0, "event": "start", "version": 1},
    {"t": 0.1, "event": "state", "device": "a", "at": 0.1, "values": {"x": 0.5}},
    {"t": 0.2, "event": "report", "device": "a", "control": "x", "raw": 0.25},
    {"t": 0.3, "event": "lost", "device": "a", "reason": "unplugged"},
)


@cache
def originals(kind: Kind) -> Sequence[bytes]:
    """Some good files of a kind."""
    match kind:
        case Kind.GPX | Kind.KML | Kind.PLAN | Kind.CSV | Kind.WPL:
            return [FORMATS[kind].write(MISSION).encode()]
        case Kind.SETTINGS_TOML:
            return [_settings().to_toml().encode()]
        case Kind.SETTINGS_JSON:
            return [_settings().to_json().encode()]
        case Kind.MIXER:
            return [b'name = "Quadro"\n[motors]\n1 = [64, 64, 0, 64]\n2 = [64, -64, 0, 64]\n3 = [64, 0, -64, -64]\n']
        case Kind.SCRIPT:
            found = [path.read_bytes() for path in sorted((CONFIGS / "missions").glob("*.toml"))]
            return [content for content in found if b"\nfile = " not in content]  # it would not lie beside
        case Kind.GAMEPAD:
            return [(CONFIGS / "gamepads" / "xbox.toml").read_bytes()]
        case Kind.PAD_SESSION:
            return ["".join(json.dumps(line) + "\n" for line in _PAD_SESSION).encode()]
        case Kind.ZENOH:
            return [(CONFIGS / "zenoh" / "client-tls.json5").read_bytes()]
        case Kind.CONFIG:
            return [path.read_bytes() for path in sorted(CONFIGS.glob("*.toml"))]
        case Kind.CAMERA:
            return [path.read_bytes() for path in sorted((CONFIGS / "cameras").glob("*.toml"))]
        case Kind.TARGET:
            return [path.read_bytes() for path in sorted((CONFIGS / "targets").glob("*.toml"))]
        case Kind.CAPTURE:
            return [(CAPTURES / "nc_commands.jsonl").read_bytes()]
        case Kind.BYTES:
            lines = (CAPTURES / "nc_mixed_60s.jsonl").read_text(encoding="utf-8").splitlines()
            return [b"".join(bytes.fromhex(json.loads(line)["hex"]) for line in lines)]
        case Kind.PICTURE:
            return [_picture(".png")]
        case Kind.JPEG:
            return [_picture(".jpg")]
        case Kind.CLIP:
            return [_clip()]
        case Kind.PROBES:
            probes = (Probe(ProbeKind.ECHO, 0.1 * number, 0.02 if number % 9 else None) for number in range(40))
            return [to_csv([LoadRun("wire", "light", 0.0, tuple(probes))]).encode()]
        case Kind.RECORDING:
            return [_recording(name) for name in ("fc_sticks.mcap", "nc_lost_client.mcap", "fc_over_target.mcap")]


def _settings() -> SettingsFile:
    layout = layout_of(_REVISION)
    assert layout is not None
    parameters = ParameterSet(bytes([_REVISION]) + bytes(layout.size - 1)).replaced({"gyro_p": 90, "name": "Sport"})
    return SettingsFile(parameters, slot=3, firmware="2.12a", saved="2014-05-01T12:00:00Z")


def _pixels() -> npt.NDArray[np.uint8]:
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    pixels = np.full((120, 160), 255, dtype=np.uint8)
    pixels[20:100, 40:120] = cv2.aruco.generateImageMarker(dictionary, 3, 80)
    return pixels


def _picture(suffix: str) -> bytes:
    return cv2.imencode(suffix, _pixels())[1].tobytes()


def _clip() -> bytes:
    with tempfile.NamedTemporaryFile(suffix=".avi") as file:
        writer = cv2.VideoWriter(file.name, cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (160, 120), isColor=False)
        for _ in range(5):
            writer.write(_pixels())
        writer.release()
        return file.read()


def _recording(name: str) -> bytes:
    """A recorded flight, the long one with gaps."""
    recording = Recording(RECORDINGS / name)
    session = recording.read_session()
    assert session is not None
    output = io.BytesIO()
    writer = RecordingWriter(output, session)
    for number, entry in enumerate(recording.entries()):
        if "target" not in name or number < _ENTRIES or entry.suffix.startswith(_SEEN):
            writer.add(entry)
    writer.finish()
    return output.getvalue()
