"""`python -m lab files --foreign`: files as other programs write them, seeded, with what each holds known beside it.

Each file is read by the product. It ends in a result that has everything the file holds, a note for what it has not,
or one line of refusal; anything else is wrong. The oracle counts what the generator put in, not what the reader says.
"""

from __future__ import annotations

import io
import json
import math
import random
import struct
import tempfile
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from mcap.writer import CompressionType

from lab.files.originals import Kind, originals
from lab.files.recordings import rewritten
from mkdaemon.config.reader import load
from mkdaemon.errors import MkError
from mkdaemon.missions import read_mission
from mkdaemon.missions.items import COMMANDS
from mkdaemon.record.layout import MAGIC
from mkdaemon.record.reader import Recording
from mkdaemon.telemetry.mission import PointKind
from mkdaemon.vision.camera.calibration_file import load_camera

_NUMBERS: Final = (
    *(0, 0, 0, 1, -1, 2, 5, 0.5, 90, -30, None, float("nan"), float("inf"), -float("inf"), 10**400, "7", True),
)

BOM: Final = "\ufeff"


@dataclass(frozen=True, slots=True)
class Foreign:
    """One file of another program.

    Attributes:
        suffix: of its name.
        content: what stands in it.
        fault: what is wrong with how it was read, given its path; empty for nothing.
        is_right: nothing in it can be refused.
    """

    suffix: str
    content: bytes
    fault: Callable[[Path], str]
    is_right: bool = False


def _marked(rng: random.Random, text: str) -> bytes:
    """A text in UTF-8, sometimes with a mark of the byte order."""
    return ((BOM if rng.random() < 0.3 else "") + text).encode()


def foreign_files(seed: int) -> Iterator[Foreign]:
    """One file of each kind."""
    rng = random.Random(seed)
    makers = (_plan, _waypoints, _kml, _kmz, _gpx, _table, _toml, _ros, _ost, _kalibr, _mcap)
    yield from (make(rng) for make in makers)


def _place(rng: random.Random) -> list[float]:
    return [round(rng.uniform(-80, 80), 6), round(rng.uniform(1, 170), 6), rng.randint(2, 90)]


def _mission(count: int, notes: int) -> Callable[[Path], str]:
    """A mission has so many points that are flown to, and so many notes at least."""

    def fault(path: Path) -> str:
        found_notes: list[str] = []
        found = read_mission(path, altitude=10.0, notify=found_notes.append)
        flown = sum(point.kind is not PointKind.POI for point in found.points)
        if flown != count or len(found_notes) < notes:
            return f"{flown} of {count} points, {len(found_notes)} of {notes} notes"
        return ""

    return fault


def _plan(rng: random.Random) -> Foreign:
    items: list[dict[str, Any]] = []
    flown = 0
    for _ in range(rng.randint(1, 6)):
        command = rng.choice([16, 16, 16, *COMMANDS, 20, 93])
        params: list[Any] = [0, 0, 0, None, *_place(rng)] if command in (16, 19, 21, 22, 195) else [0] * 7
        if rng.random() < 0.3:
            params[rng.randrange(7)] = rng.choice(_NUMBERS)
        flown += command in (16, 19, 21) or (command == 22 and bool(params[4] or params[5]))
        waits = rng.random() < 0.05
        items.append(
            {"type": "SimpleItem", "command": command, "frame": 3, "params": params, "autoContinue": not waits}
        )
    fence, rally = rng.random() < 0.3, rng.random() < 0.3
    plan = {
        "fileType": "Plan",
        "geoFence": {"circles": [{"circle": {"center": [1, 2], "radius": 9}}] if fence else [], "polygons": []},
        "rallyPoints": {"points": [[1, 2, 3]] if rally else []},
        "mission": {"firmwareType": rng.choice([0, 3, 12]), "items": items},
    }
    return Foreign(".plan", _marked(rng, json.dumps(plan)), _mission(flown, fence + rally))


def _waypoints(rng: random.Random) -> Foreign:
    rows, count = ["QGC WPL 110", "0\t1\t0\t16\t0\t0\t0\t0\t53\t8\t10\t1"], rng.randint(1, 9)
    for number in range(1, count + 1):
        cells = [number, 0, 3, 16, 0, 0, 0, rng.choice([0, 90]), *_place(rng), rng.choice([0, 1])]
        rows.append("\t".join(map(str, cells)))
    end = rng.choice(["\n", "\r\n"])
    return Foreign(rng.choice([".waypoints", ".wpl"]), _marked(rng, end.join(rows)), _mission(count, 1))


def _document(rng: random.Random) -> tuple[bytes, int, int]:
    """A KML document, its points, and how many notes it needs at least; -1 point where it has to be refused."""
    count, boxes, body = rng.randint(1, 6), rng.randint(0, 2), ""
    for _ in range(count):
        latitude, longitude, height = _place(rng)
        point = f"<Point><coordinates>{longitude},{latitude},{height}</coordinates></Point>"
        body += f"<Placemark>{rng.choice([point, f'<MultiGeometry>{point}</MultiGeometry>'])}</Placemark>"
    body += "<Placemark><Polygon/></Placemark>" * boxes
    lines = rng.choice([0, 0, 0, 1])
    body += "<Placemark><LineString><coordinates>1,2 3,4</coordinates></LineString></Placemark>" * lines
    # A path beside points has to be refused: no count is right.
    return _marked(rng, f"<kml><Folder>{body}</Folder></kml>"), -1 if lines else count, min(boxes, 1)


def _kml(rng: random.Random) -> Foreign:
    content, count, notes = _document(rng)
    return Foreign(".kml", content, _mission(count, notes), count > 0)


def _kmz(rng: random.Random) -> Foreign:
    """A packed KML document, among others and pictures."""
    (document, count, notes), packed = _document(rng), io.BytesIO()
    how = rng.choice([zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
    names = [rng.choice(["doc.kml", "Route.KML"])] if rng.random() < 0.9 else []
    others = [name for name in ("files/picture.png", "readme.txt") if rng.random() < 0.3]
    second = ["files/a.kml"] if names and rng.random() < 0.3 else []
    with zipfile.ZipFile(packed, "w", how) as file:
        for name in rng.sample(found := [*names, *others, *second], len(found)):
            file.writestr(name, document if name in names else b"<kml/>")
    content = packed.getvalue()
    if rng.random() < 0.1:  # damaged on its way
        place = rng.randrange(len(content))
        content = content[:place] + bytes([content[place] ^ 0x55]) + content[place + 1 :]
        return Foreign(".kmz", content, lambda path: _mission(count, 0)(path) and "")
    return Foreign(
        ".kmz", content, _mission(count, notes + len(second)) if names else _mission(-1, 0), count > 0 and bool(names)
    )


def _gpx(rng: random.Random) -> Foreign:
    sizes = [rng.randint(0, 3) for _ in range(rng.randint(0, 2))]
    loose = rng.randint(0, 2)
    point = '<{0} lat="1.5" lon="2.5"/>'
    body = point.format("wpt") * loose + "".join(f"<rte>{point.format('rtept') * size}</rte>" for size in sizes)
    routes = [size for size in sizes if size]
    count = -1 if len(routes) > 1 else (routes[0] if routes else loose)
    return Foreign(".gpx", _marked(rng, f"<gpx>{body}</gpx>"), _mission(count, bool(routes and loose)))


def _table(rng: random.Random) -> Foreign:
    cell, count = rng.choice(["12", "1_2", "nan", "inf", "1e999", "12.5"]), rng.randint(1, 5)
    rows = [f"53.{number},8,{cell}" for number in range(count)]
    right = cell in ("12", "12.5")
    return Foreign(".csv", _marked(rng, "\n".join(["lat,lon,altitude", *rows])), _mission(count if right else -1, 0))


def _toml(rng: random.Random) -> Foreign:
    name = rng.choice(["mk1", "a2"])

    def fault(path: Path) -> str:
        found = load(path).vehicle.name
        return "" if found == name else f"vehicle {found} is not {name}"

    return Foreign(".toml", _marked(rng, f'[vehicle]\nname = "{name}"\n'), fault)


def _coefficients(rng: random.Random, counts: list[int]) -> list[float]:
    return [round(rng.uniform(-0.1, 0.1), 4) for _ in range(rng.choice(counts))]


def _camera(suffix: str, content: bytes, focal: float, coefficients: list[float], kept: int) -> Foreign:
    """A calibration with a focal length, and coefficients of which a camera file keeps so many."""

    def fault(path: Path) -> str:
        found = load_camera(path).intrinsics
        wanted = [*coefficients, *[0.0] * kept][:kept]
        right = found.fx == focal and not any(coefficients[kept:]) and list(found.distortion) == wanted
        return "" if right and (found.width, found.height) == (640, 480) else f"{found} is not {coefficients}"

    return Foreign(suffix, content, fault, math.isfinite(focal) and focal > 0 and not any(coefficients[kept:]))


def _ros(rng: random.Random) -> Foreign:
    """Of ROS's `camera_calibration`."""
    model = rng.choice(["plumb_bob", "rational_polynomial", "equidistant"])
    coefficients, focal = _coefficients(rng, [4, 5, 8]), rng.choice([500.0, 601.25, float("nan")])
    text = (
        "image_width: 640\nimage_height: 480\n"
        f"camera_matrix:\n  rows: 3\n  data: [{focal}, 0, 320, 0, 600, 240, 0, 0, 1]\n"
        f"distortion_model: {model}\ndistortion_coefficients:\n  cols: {len(coefficients)}\n  data: {coefficients}\n"
    )
    return _camera(".yaml", _marked(rng, text), focal, coefficients, 4 if model == "equidistant" else 5)


def _ost(rng: random.Random) -> Foreign:
    """The same in its older form."""
    coefficients, focal = _coefficients(rng, [4, 5, 8]), rng.choice([500.0, 601.25, float("inf")])
    row = " ".join(f"{value:.6f}" for value in coefficients)
    end = rng.choice(["\n", "\r\n"])
    text = (
        "# oST version 5.0 parameters\n\n\n[image]\n\nwidth\n640\n\nheight\n480\n\n[narrow_stereo]\n\n"
        f"camera matrix\n{focal:.6f} 0.000000 320.000000\n0.000000 600.000000 240.000000\n"
        f"0.000000 0.000000 1.000000\n\ndistortion\n{row}\n\nrectification\n1.0 0.0 0.0\n0.0 1.0 0.0\n0.0 0.0 1.0\n"
    )
    return _camera(".txt", _marked(rng, text.replace("\n", end)), focal, coefficients, 5)


def _kalibr(rng: random.Random) -> Foreign:
    """Of Kalibr: perhaps several cameras, or a lens that nobody here knows."""
    model = rng.choice(["radtan", "equidistant", "fov"])
    coefficients, focal = _coefficients(rng, [4]), rng.choice([500.0, 601.25, float("nan")])
    rows = "".join(f"\n  - {value}" for value in coefficients) if rng.random() < 0.5 else f" {coefficients}"
    text = "".join(
        f"cam{number}:\n  cam_overlaps: []\n  camera_model: {rng.choice(['pinhole', 'pinhole', 'omni'])}\n"
        f"  distortion_coeffs:{rows}\n  distortion_model: {model}\n"
        f"  intrinsics: [{focal}, 600.0, 320.0, 240.0]\n  resolution: [640, 480]\n  rostopic: /cam{number}/image_raw\n"
        for number in range(rng.choice([1, 1, 1, 2]))
    )
    # Several cameras, an omnidirectional one and a lens that nobody here knows have to be refused.
    is_right = "cam1" not in text and "omni" not in text and model != "fov"
    kept = 4 if model == "equidistant" else 5
    return _camera(".yaml", _marked(rng, text), focal if is_right else -1.0, coefficients, kept)


def _mcap(rng: random.Random) -> Foreign:
    """A recording as another writer has it, with channels and records of another program."""
    source, more = rng.choice(originals(Kind.RECORDING)), rng.randint(0, 3)
    how: dict[str, Any] = {
        "use_chunking": rng.random() < 0.7,
        "compression": rng.choice(list(CompressionType)),
        "chunk_size": rng.choice([100, 5_000, 10_000_000]),
    }
    content, count = rewritten(source, more, **how)
    private = struct.pack("<BQ", rng.randint(0x80, 0xFF), 60) + bytes(60) if rng.random() < 0.5 else b""

    def fault(path: Path) -> str:
        recording = Recording(path)
        found, before = sum(1 for _ in recording.entries()), len(list(_entries(path.with_name("before.mcap"), source)))
        report = recording.report
        total = found + report.views + report.foreign
        if (found, total, report.foreign) != (before, count, more) or report.damages or report.orphans:
            return f"{found} of {before} entries, {total} of {count} messages, {report.damages}"
        return ""

    return Foreign(".mcap", MAGIC + private + content[len(MAGIC) :], fault, is_right=True)


def _entries(path: Path, content: bytes) -> Iterator[object]:
    path.write_bytes(content)
    return Recording(path).entries()


def run_foreign(seeds: range) -> dict[str, Any]:
    """Read every file; what came of them by suffix, and what was wrong."""
    ends: Counter[str] = Counter()
    wrong: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as folder:
        for seed in seeds:
            for one in foreign_files(seed):
                path = Path(folder) / f"foreign{one.suffix}"
                path.write_bytes(one.content)
                try:
                    fault, end = one.fault(path), "read"
                except MkError as error:
                    fault, end = str(error) if one.is_right or "\n" in str(error) else "", "refused"
                except Exception as error:  # noqa: BLE001 - that is what is looked for
                    fault, end = f"{type(error).__name__}: {error}", "traceback"
                ends[f"{one.suffix} {end}"] += 1
                if fault:
                    wrong.append({"seed": seed, "file": one.suffix, "fault": fault[:200]})
    return {"files": ends.total(), "ends": dict(sorted(ends.items())), "wrong": wrong}
