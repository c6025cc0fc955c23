from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given

from mkdaemon.cli.mission_files import FORMATS, AltitudeReference, read_mission, write_mission
from mkdaemon.errors import ConfigError
from mkdaemon.protocol.mission import Mission, MissionPoint, PointKind

from .missions import ROUND, missions


@pytest.mark.parametrize("suffix", [".gpx", ".kml", ".csv"])
@given(mission=missions())
def test_complete_formats_keep_every_field(suffix: str, mission: Mission) -> None:
    form = FORMATS[suffix]
    draft = form.read(form.write(mission), "m" + suffix)
    assert draft.reference is AltitudeReference.START
    assert draft.mission.points == mission.points


@given(mission=missions(whole_metres=True))
def test_wpl_keeps_whole_metres(mission: Mission) -> None:
    form = FORMATS[".wpl"]
    # An empty prefix is written as "P", because the tool's own files always have one.
    named = Mission(points=tuple(p if p.name else p.model_copy(update={"name": "P"}) for p in mission.points))
    assert form.read(form.write(named), "m.wpl").mission.points == named.points


def test_plan_keeps_what_plans_can_express() -> None:
    form = FORMATS[".plan"]
    back = form.read(form.write(ROUND), "m.plan").mission.points
    assert [point.kind for point in back] == [PointKind.POI, PointKind.WAYPOINT, PointKind.WAYPOINT]
    assert back[1].model_dump(include={"speed", "poi", "hold", "radius", "photo_distance"}) == {
        "speed": 4.5, "poi": 1, "hold": 5, "radius": 3, "photo_distance": 10,
    }  # fmt: skip
    assert (back[2].heading_deg, back[2].poi) == (360, None)
    assert [(p.latitude_deg, p.longitude_deg, p.altitude) for p in back] == [
        (p.latitude_deg, p.longitude_deg, p.altitude) for p in ROUND.points
    ]


@pytest.mark.parametrize("suffix", list(FORMATS))
def test_file_round_trip(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"round{suffix}"
    write_mission(ROUND, path)
    back = read_mission(path)
    assert [point.altitude for point in back.points] == [1.0, 15.0, 20.0]


def test_unknown_suffix_names_the_known_ones(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"suffix '\.xyz'; use one of \.gpx, \.kml, \.plan, \.csv, \.wpl"):
        read_mission(tmp_path / "a.xyz")


def test_missing_and_binary_files(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read"):
        read_mission(tmp_path / "none.gpx")
    binary = tmp_path / "b.gpx"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="not UTF-8 text"):
        read_mission(binary)


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


BAD = [
    ("a.gpx", "<gpx><rte>", r"a\.gpx:1: no well-formed XML"),
    ("a.gpx", "<kml/>", r"a\.gpx:1: <kml> is no GPX document"),
    ("a.gpx", '<!DOCTYPE gpx [<!ENTITY x SYSTEM "file:///etc/passwd">]>\n<gpx>&x;</gpx>', "document type declaration"),
    ("a.gpx", "<gpx><trk/></gpx>", "only a recorded track"),
    ("a.gpx", '<gpx>\n<wpt lon="3"/></gpx>', r"a\.gpx:2: lat is missing; write a decimal number"),
    ("a.gpx", '<gpx>\n\n<wpt lat="93" lon="3"/></gpx>', r"a\.gpx:3: latitude_deg is 93\.0: .*less than or equal to 90"),
    ("a.gpx", '<gpx><wpt lat="nan" lon="3"/></gpx>', "latitude_deg is nan"),
    ("a.kml", "<kml><Document/></kml>", "no point and no path"),
    ("a.kml", "<kml><LineString>\n<coordinates>1,2\n3,x</coordinates></LineString></kml>", r"kml:3: latitude is .x."),
    ("a.kml", "<kml><Placemark><Point><coordinates>1,2,3</coordinates></Point></Placemark></kml>", "--altitude METRES"),
    ("a.csv", "lat,lon\n", r"a\.csv:1: no column is called 'lat'; use latitude_deg"),
    ("a.csv", "latitude_deg,longitude_deg\n", "column 'altitude' is missing"),
    ("a.csv", "latitude_deg,longitude_deg,altitude\n1,2\n", r"a\.csv:2: 2 cells under 3 columns"),
    ("a.csv", "latitude_deg,longitude_deg,altitude,radius\n1,2,3,4.5\n", r"a\.csv:2: radius is 4\.5; write a whole"),
    ("a.csv", "latitude_deg,longitude_deg,altitude,poi\n1,2,3,2\n", "point 1 looks at point 2"),
    ("a.csv", "latitude_deg,longitude_deg,altitude,kind\n1,2,3,home\n", "kind is 'home'; use one of waypoint, poi"),
    ("a.csv", "latitude_deg,longitude_deg,altitude\n", r"a\.csv:1: no waypoint in this file"),
    ("a.wpl", "QGC WPL 110\n", "QGroundControl's text format"),
    ("a.wpl", "[General]\nFileVersion=4\n", r"a\.wpl:2: FileVersion 4 is unknown"),
    ("a.wpl", "[General]\nFileVersion=3\nNumberOfWaypoints=1\n", r"section \[Point1\] is missing"),
    ("a.wpl", "rubbish\n", r"a\.wpl:1: 'rubbish' is neither"),
    ("a.wpl", "[General]\nFileVersion=3\nNumberOfWaypoints=0\n[Point1]\n", "more points than NumberOfWaypoints=0"),
    ("a.wpl", "[General]\nFileVersion=3\nNumberOfWaypoints=1\n[Point1]\nLatitude=x\n", r"a\.wpl:4: Heading is missing"),
    ("a.plan", "{", r"a\.plan:1: no JSON"),
    ("a.plan", "[]", '"fileType" is not "Plan"'),
    ("a.plan", plan('{"type":"ComplexItem","complexItemType":"survey"}'), r"a\.plan:3: a survey cannot"),
    ("a.plan", simple(22), r"command 22 \(take-off\)"),
    ("a.plan", simple(16, frame=10), "altitude frame 10"),
    ("a.plan", simple(16, latitude='"x"'), "latitude is 'x'"),
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


def test_wpl_of_early_ikopter_counts_types_from_zero() -> None:
    text = FORMATS[".wpl"].write(ROUND).replace("Type=1", "Type=0").replace("Type=2", "Type=1")
    named = text.replace("[General]", "[General]\nName=Round")
    assert [point.kind for point in FORMATS[".wpl"].read(named, "a.wpl").mission.points] == [
        point.kind for point in ROUND.points
    ]
