from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given

from mkdaemon.errors import ConfigError
from mkdaemon.missions import FORMATS, AltitudeReference, read_mission, write_mission
from mkdaemon.telemetry.mission import Mission, MissionPoint, PointKind

from .missions import ROUND, missions


@pytest.mark.parametrize("suffix", [".gpx", ".kml", ".csv"])
@given(mission=missions())
def test_complete_formats_keep_every_field(suffix: str, mission: Mission) -> None:
    form = FORMATS[suffix]
    draft = form.read(form.write(mission), "m" + suffix)
    assert draft.reference is AltitudeReference.START
    assert draft.mission.points == mission.points


@pytest.mark.parametrize("suffix", [suffix for suffix, form in FORMATS.items() if not form.is_packed])
def test_file_round_trip(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"round{suffix}"
    write_mission(ROUND, path)
    back = read_mission(path)
    assert [point.altitude for point in back.points] == [1.0, 15.0, 20.0]


def test_unknown_suffix_names_the_known_ones(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"suffix '\.xyz'; use one of \.gpx, \.kml, \.kmz, \.plan, \.csv, \.wpl"):
        read_mission(tmp_path / "a.xyz")


SEA = """<gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1"><rte>
<rtept lat="48.1" lon="11.5"><ele>540</ele></rtept>
<rtept lat="48.2" lon="11.6"><ele>550.5</ele></rtept></rte></gpx>"""


def test_sea_level_altitudes_need_the_elevation_of_the_start(tmp_path: Path) -> None:
    path = tmp_path / "sea.gpx"
    path.write_text(SEA)
    with pytest.raises(ConfigError, match="--start-elevation METRES"):
        read_mission(path)
    assert [p.altitude for p in read_mission(path, start_elevation=520).points] == [20.0, 30.5]
    assert [p.altitude for p in read_mission(path, altitude=7).points] == [7.0, 7.0]
    with pytest.raises(ConfigError, match="puts a point out of range"):
        read_mission(path, start_elevation=9000)


def plan(item: str) -> str:
    return f'{{"fileType":"Plan","mission":{{\n"items":[\n{item}]}}}}'


def simple(command: int, frame: int = 3, latitude: str = "0") -> str:
    params = f"[0,0,0,null,{latitude},0,0]"
    return plan(f'{{"type":"SimpleItem","command":{command},"frame":{frame},"params":{params}}}')


def simple_item(command: int, frame: int = 3) -> str:
    return f'{{"type":"SimpleItem","command":{command},"frame":{frame},"params":[0,0,0,null,1,2,3]}}'


def mark(mode: str) -> str:
    point = f"<Point><altitudeMode>{mode}</altitudeMode><coordinates>1,2,3</coordinates></Point>"
    return f"<Placemark>{point}</Placemark>"


EXTRA = '<extensions><point xmlns="urn:mkdaemon:mission:1" altitude="5" {}="{}"/></extensions>'
PATH = "<LineString><coordinates>8,53,1 8.1,53,1</coordinates></LineString>"
ROUTE = '<rte><rtept lat="1" lon="2"/></rte>'
LIST = "QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\t53\t8\t10\t1\n"

BAD = [
    ("a.gpx", "<gpx><rte>", r"a\.gpx:1: no well-formed XML"),
    ("a.gpx", "<kml/>", r"a\.gpx:1: <kml> is not a GPX document"),
    ("a.gpx", '<!DOCTYPE gpx [<!ENTITY x SYSTEM "file:///etc/passwd">]>\n<gpx>&x;</gpx>', "document type declaration"),
    ("a.gpx", "<gpx><trk/></gpx>", "only a recorded track"),
    ("a.gpx", '<gpx>\n<wpt lon="3"/></gpx>', r"a\.gpx:2: lat is missing; write a decimal number"),
    ("a.gpx", '<gpx>\n\n<wpt lat="93" lon="3"/></gpx>', r"a\.gpx:3: latitude_deg is 93\.0: .*less than or equal to 90"),
    ("a.gpx", '<gpx><wpt lat="nan" lon="3"/></gpx>', "lat is 'nan', no finite number"),
    ("a.kml", "<kml><Document/></kml>", "no point and no path"),
    ("a.kml", "<kml><LineString>\n<coordinates>1,2\n3,x</coordinates></LineString></kml>", r"kml:3: latitude is .x."),
    ("a.kml", "<kml><Placemark><Point><coordinates>1,2,3</coordinates></Point></Placemark></kml>", "--altitude METRES"),
    ("a.csv", "lat,lon,x\n", r"a\.csv:1: no column is called 'x'; use latitude_deg"),
    ("a.csv", "latitude_deg,longitude_deg\n", "column 'altitude' is missing"),
    ("a.csv", "latitude_deg,longitude_deg,altitude\n1,2\n", r"a\.csv:2: 2 cells under 3 columns"),
    ("a.csv", "latitude_deg,longitude_deg,altitude,radius\n1,2,3,4.5\n", r"a\.csv:2: radius is 4\.5; write a whole"),
    ("a.csv", "latitude_deg,longitude_deg,altitude,poi\n1,2,3,2\n", "point 1 looks at point 2"),
    ("a.csv", "latitude_deg,longitude_deg,altitude,kind\n1,2,3,home\n", "kind is 'home'; use one of waypoint, poi"),
    ("a.csv", "latitude_deg,longitude_deg,altitude\n", r"a\.csv:1: no waypoint in this file"),
    ("a.wpl", "QGC WPL 110\n", r"a\.wpl:1: no waypoint in this file"),
    ("a.wpl", "[General]\nFileVersion=4\n", r"a\.wpl:2: FileVersion 4 is unknown"),
    ("a.wpl", "[General]\nFileVersion=3\nNumberOfWaypoints=1\n", r"section \[Point1\] is missing"),
    ("a.wpl", "rubbish\n", r"a\.wpl:1: 'rubbish' is neither"),
    ("a.wpl", "[General]\nFileVersion=3\nNumberOfWaypoints=0\n[Point1]\n", "more points than NumberOfWaypoints=0"),
    ("a.wpl", "[General]\nFileVersion=3\nNumberOfWaypoints=1\n[Point1]\nLatitude=x\n", r"a\.wpl:4: Heading is missing"),
    ("a.csv", "latitude_deg;longitude_deg;altitude;name\n1;2;3;Größe\n", r"a\.csv:2: name is 'Größe'"),
    ("a.gpx", "<gpx/>", "neither a route nor waypoints"),
    ("a.gpx", f'<gpx><wpt lat="1" lon="2">{EXTRA.format("kind", "hill")}</wpt></gpx>', "kind is 'hill'; use one"),
    ("a.kml", "<gpx/>", "<gpx> is not a KML document"),
    ("a.kml", f"<kml>{mark('absolute')}{mark('relativeToGround')}</kml>", "the points differ in altitudeMode"),
    ("a.kml", f"<kml>{mark('floating')}</kml>", "altitudeMode is 'floating'; use one of relativeToGround"),
    ("a.kml", "<kml><Placemark><Point/></Placemark></kml>", "a point needs one coordinate"),
    ("a.kml", "<kml><LineString/></kml>", "a path without coordinates"),
    ("a.kml", "<kml><LineString><coordinates>1</coordinates></LineString></kml>", "coordinate '1' has 1 parts"),
    ("a.wpl", "", r"a\.wpl:1: no \[General\] section"),
    ("a.wpl", "[General]\n[general]\n", r"a\.wpl:2: section \[general\] occurs twice"),
    ("a.wpl", "[General]\nA=1\na=2\n", r"a\.wpl:3: a occurs twice in one section"),
    ("a.wpl", FORMATS[".wpl"].write(ROUND).replace("Type=2", "Type=9"), "Type=9 is unknown; 1 waypoint"),
    ("a.plan", '{"fileType":"Plan"}', "the plan holds no mission"),
    ("a.plan", plan('{"type":"SimpleItem","params":[]}'), r"a\.plan:3: an item needs 7 params"),
    ("a.plan", plan(simple_item(16) + "," + simple_item(16, 0)), "partly relative, partly above sea level"),
    ("a.plan", "{", r"a\.plan:1: no JSON"),
    ("a.plan", "[]", '"fileType" is not "Plan"'),
    ("a.plan", plan('{"type":"ComplexItem","complexItemType":"survey"}'), r"a\.plan:3: a survey cannot"),
    ("a.plan", plan(simple_item(16) + "," + simple_item(22)), "a take-off after the first point cannot be flown"),
    ("a.plan", simple(93), r"command 93 \(delay\); give the waypoint before it a hold time"),
    ("a.plan", plan(simple_item(16) + "," + simple_item(20) + "," + simple_item(16)), "nothing can be flown after"),
    ("a.plan", simple(16), "the place is 0 N 0 E"),
    ("a.plan", simple(16, frame=10), "altitude frame 10"),
    ("a.plan", simple(16, latitude='"x"'), "latitude is 'x'"),
    ("a.csv", "lat,lon,alt\n1,2,3\n", r"a\.csv:1: .*'alt' does not say .*; call it altitude \(above the start\)"),
    ("a.csv", "53.1,8.1,10\n53.2,8.2,10\n", "the first line names no columns; begin the file with latitude_deg"),
    ("a.csv", "lat,latitude,lon,altitude\n1,1,2,3\n", "column 'latitude_deg' stands twice"),
    ("a.csv", "lat,lon,altitude\n53,8,1_5\n", "altitude is '1_5', no number"),
    ("a.csv", "lat,lon,altitude\n53,8,inf\n", "altitude is 'inf', no finite number"),
    ("a.kml", f"<kml>{PATH}{PATH}</kml>", "the file holds 2 paths; join them"),
    ("a.kml", f"<kml>{mark('absolute')}{PATH}</kml>", "both 1 placemarks with a point and a path"),
    ("a.gpx", f"<gpx>{ROUTE}{ROUTE}</gpx>", "the file holds 2 routes; keep"),
    ("a.kmz", "no zip", "no KMZ file that can be read"),
    ("a.kmz", "PK\x05\x06" + "\0" * 18, "no KML document in this file"),
    ("a.waypoints", LIST + "1\t0\t3\t177\t0\t0\t0\t0\t53\t8\t9\t1\n", r"a\.waypoints:3: .*command 177 \(jump\)"),
    ("a.waypoints", LIST + "1\t0\t3\t16\t0\t0\t0\t0\t53\t8\t9\n", r"a\.waypoints:3: 11 cells in place of 12"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("name", "text", "message"), BAD, ids=[f"{name[2:]}-{i}" for i, (name, _, _) in enumerate(BAD)]
)
def test_a_bad_file_names_file_line_and_fix(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, text: str, message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path(name).write_text(text)
    with pytest.raises(ConfigError, match=message) as caught:
        read_mission(Path(name))
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(name)
    assert ";" in str(caught.value)


def test_xml_nesting_is_bounded() -> None:
    with pytest.raises(ConfigError, match="nest deeper than 64"):
        FORMATS[".gpx"].read("<gpx>" * 100, "deep.gpx")


def test_wpl_of_the_mikrokopter_tool_version_2_puts_its_poi_first() -> None:
    text = (
        "[General]\nFileVersion=2\nNumberOfWaypoints=1\nUsePOI=1\nPOI_CAM_NICK_CTRL=0\n"
        "[POI]\nAltitude=1\nLatitude=46.7140763\nLongitude=19.2507334\n"
        "[Waypoint1]\nLatitude=46.7145686\nLongitude=19.2515702\nRadius=10\nAltitude=15\nClimbRate=20\nDelayTime=4\n"
        "WP_Event_Channel_Value=96\nHeading=-1\n"
    )
    points = FORMATS[".wpl"].read(text, "a.wpl").mission.points
    assert points[0].kind is PointKind.POI
    assert points[1] == MissionPoint(
        latitude_deg=46.7145686, longitude_deg=19.2515702, altitude=15, radius=10, climb=2.0, hold=4, event=96, poi=1
    )
    plain = FORMATS[".wpl"].read(text.replace("UsePOI=1", "UsePOI=0"), "a.wpl").mission.points
    assert [point.poi for point in plain] == [None]


def test_blank_lines_and_comments_are_no_points(tmp_path: Path) -> None:
    table = "latitude_deg,longitude_deg,altitude\n\n1,2,3\n ,,\n"
    assert len(FORMATS[".csv"].read(table, "a.csv").mission.points) == 1
    listed = FORMATS[".wpl"].write(ROUND).replace("[Point2]", "; second\n\n[Point2]")
    assert len(FORMATS[".wpl"].read(listed, "a.wpl").mission.points) == 3
