"""Files as other programs write them."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

from mkdaemon.errors import ConfigError
from mkdaemon.missions import FORMATS, AltitudeReference, read_mission


@pytest.mark.parametrize(
    ("text", "reference"),
    [
        ("Latitude,Longitude,Altitude\n53.1,8.1,10.5\n", AltitudeReference.START),
        ("lat;lon;height;hold\n53,1;8,1;10,5;3\n", AltitudeReference.START),
        ("lng\tlat\trelative_altitude\n8.1\t53.1\t10.5\n", AltitudeReference.START),
        ("\ufefflatitude_deg,longitude_deg,altitude\r\n53.1,8.1,10.5\r\n", AltitudeReference.START),
        ("lat,lon,ele\n53.1,8.1,10.5\n", AltitudeReference.SEA_LEVEL),
    ],
)
def test_a_table_of_a_spreadsheet(text: str, reference: AltitudeReference) -> None:
    draft = FORMATS[".csv"].read(text, "a.csv")
    [point] = draft.mission.points
    assert (point.latitude_deg, point.longitude_deg, point.altitude) == (53.1, 8.1, 10.5)
    assert draft.reference is reference
    lower = {AltitudeReference.START: 10.5, AltitudeReference.SEA_LEVEL: 0.2}
    assert draft.settled("a.csv", start_elevation=10.3).points[0].altitude == pytest.approx(lower[reference])


def kml(body: str) -> str:
    return f"<kml><Document>{body}</Document></kml>"


def mark(longitude: float) -> str:
    place = f"<altitudeMode>relativeToGround</altitudeMode><coordinates>{longitude},53,15</coordinates>"
    return f"<Point>{place}</Point>"


@pytest.mark.parametrize("how", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_a_damaged_kmz_is_refused_in_one_line(tmp_path: Path, how: int) -> None:
    path = tmp_path / "a.kmz"
    with zipfile.ZipFile(path, "w", how) as packed:
        packed.writestr("doc.kml", kml(f"<Placemark>{mark(8.3)}</Placemark>"))
    whole = path.read_bytes()
    said = set[str]()
    for place in range(len(whole)):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 0x55]) + whole[place + 1 :])
        try:
            read_mission(path, altitude=10.0, notify=lambda _: None)
        except ConfigError as error:
            said.add(str(error).split("; ")[0])
    assert any("no KMZ file that can be read" in line for line in said)
    assert not any("None" in line or "\n" in line for line in said), said
