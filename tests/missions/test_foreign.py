"""Files as other programs write them."""

from __future__ import annotations

import pytest

from mkdaemon.errors import ConfigError
from mkdaemon.missions import FORMATS, AltitudeReference


def test_a_table_of_a_spreadsheet() -> None:
    for text in (
        "Latitude,Longitude,Altitude\n53.1,8.1,10.5\n",
        "lat;lon;height;hold\n53,1;8,1;10,5;3\n",
        "lng\tlat\trelative_altitude\n8.1\t53.1\t10.5\n",
        "\ufefflatitude_deg,longitude_deg,altitude\r\n53.1,8.1,10.5\r\n",
    ):
        draft = FORMATS[".csv"].read(text, "a.csv")
        [point] = draft.mission.points
        assert (point.latitude_deg, point.longitude_deg, point.altitude) == (53.1, 8.1, 10.5)
        assert draft.reference is AltitudeReference.START


def test_a_table_with_heights_above_sea_level_needs_the_elevation_of_the_start() -> None:
    draft = FORMATS[".csv"].read("lat,lon,ele\n53.1,8.1,35.3\n", "a.csv")
    assert draft.reference is AltitudeReference.SEA_LEVEL
    assert draft.settled("a.csv", start_elevation=25).points[0].altitude == 10.3


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("lat,lon,alt\n1,2,3\n", r"'alt' does not say .*; call it altitude \(above the start\) or elevation"),
        ("53.1,8.1,10\n53.2,8.2,10\n", "the first line names no columns; begin the file with latitude_deg"),
        ("lat,latitude,lon,altitude\n1,1,2,3\n", "column 'latitude_deg' stands twice"),
        ("lat,lon,altitude,course\n1,2,3,4\n", "no column is called 'course'"),
    ],
)
def test_a_table_that_can_be_misread_is_refused(text: str, says: str) -> None:
    with pytest.raises(ConfigError, match=rf"^a\.csv:1: .*{says}"):
        FORMATS[".csv"].read(text, "a.csv")


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
