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


def test_names_of_other_programs_are_shortened_to_what_a_point_carries() -> None:
    gpx = '<gpx><wpt lat="1" lon="2"><ele>3</ele><name>Kölner Dom</name></wpt></gpx>'
    assert FORMATS[".gpx"].read(gpx, "a.gpx").mission.points[0].name == "Koln"
    kml = (
        "<kml><Placemark><name>日本 Harbour</name><ExtendedData><Data name='speed'><value>fast</value></Data>"
        "</ExtendedData><Point><altitudeMode>relativeToGround</altitudeMode><coordinates>1,2,3</coordinates></Point>"
        "</Placemark></kml>"
    )
    [point] = FORMATS[".kml"].read(kml, "a.kml").mission.points
    assert (point.name, point.speed) == ("Harb", 0.0)


def test_a_plan_with_speeds_that_stay_and_end() -> None:
    def speed(value: float) -> str:
        return f'{{"type":"SimpleItem","command":178,"frame":2,"params":[1,{value},-1,0,0,0,0]}}'

    point = '{"type":"SimpleItem","command":16,"frame":3,"params":[null,0,0,null,53.1,8.1,20]}'
    items = ",".join([speed(4.5), point, speed(-1), point, speed(-2), point])
    text = f'{{"fileType":"Plan","mission":{{"items":[{items}]}}}}'
    points = FORMATS[".plan"].read(text, "a.plan").mission.points
    assert [p.speed for p in points] == [4.5, 4.5, 0.0]
    assert [p.hold for p in points] == [0, 0, 0]


LIST = (
    "QGC WPL 110\r\n"
    "0\t1\t0\t16\t0\t0\t0\t0\t53.0\t8.0\t10.0\t1\r\n"
    "1\t0\t3\t178\t0\t4.5\t0\t0\t0\t0\t0\t1\r\n"
    "2\t0\t3\t16\t2\t0\t0\t0\t53.1\t8.1\t20.0\t1\r\n"
    "3\t0\t3\t16\t0\t0\t0\t0\t53.2\t8.2\t25.0\t1\r\n"
)


@pytest.mark.parametrize("suffix", [".waypoints", ".wpl"])
def test_a_list_of_mission_planner_is_read_without_home(tmp_path: Path, suffix: str) -> None:
    path, told = tmp_path / f"list{suffix}", list[str]()
    path.write_text("\ufeff" + LIST)
    points = read_mission(path, notify=told.append).points
    assert [(p.latitude_deg, p.altitude, p.hold, p.speed, p.heading_deg) for p in points] == [
        (53.1, 20.0, 2, 4.5, None), (53.2, 25.0, 0, 4.5, None),
    ]  # fmt: skip
    assert told == [f"{path}:2: home is not flown to"]


def kml(body: str) -> str:
    return f"<kml><Document>{body}</Document></kml>"


def mark(longitude: float) -> str:
    place = f"<altitudeMode>relativeToGround</altitudeMode><coordinates>{longitude},53,15</coordinates>"
    return f"<Point>{place}</Point>"


LEG = "<Placemark><LineString><coordinates>8,53,1 8.1,53,1</coordinates></LineString></Placemark>"
BOX = "<Placemark><Polygon><outerBoundaryIs/></Polygon></Placemark>"


def test_points_in_a_multigeometry_are_read_and_what_is_left_out_is_told(tmp_path: Path) -> None:
    grouped = f"<Placemark><MultiGeometry>{mark(8.1)}{mark(8.2)}</MultiGeometry></Placemark>"
    path, told = tmp_path / "multi.kmz", list[str]()
    with zipfile.ZipFile(path, "w") as packed:
        packed.writestr("files/other.kml", kml(LEG))
        packed.writestr("doc.kml", kml(f"{grouped}<Placemark>{mark(8.3)}</Placemark>{BOX}"))
    assert [p.longitude_deg for p in read_mission(path, notify=told.append).points] == [8.1, 8.2, 8.3]
    assert told == [
        f"{path}: left out: beside the mission, polygons: 1",
        f"{path}: left out: the document files/other.kml",
    ]


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


def test_waypoints_beside_a_route_are_told_and_an_empty_route_is_none() -> None:
    loose = '<wpt lat="1" lon="2"/>'
    draft = FORMATS[".gpx"].read(f'<gpx>{loose}<rte><rtept lat="3" lon="4"/></rte><trk/></gpx>', "a.gpx")
    assert [p.latitude_deg for p in draft.mission.points] == [3]
    assert draft.notes == ("beside the mission, waypoints: 1", "beside the mission, tracks: 1")
    draft = FORMATS[".gpx"].read(f"<gpx>{loose}<rte/></gpx>", "a.gpx")
    assert [p.latitude_deg for p in draft.mission.points] == [1]
