"""Recordings for other programs, read back with their own libraries."""

from __future__ import annotations

import csv
from xml.etree import ElementTree

import pytest

from mkdaemon.client.export import tables
from mkdaemon.client.export.tables import write_csv, write_parquet
from mkdaemon.client.export.tracks import gpx, kml, tracks_of
from mkdaemon.client.export.values import ExportedValue, read_values, unit_of
from mkdaemon.errors import MkError
from tests.places import DATA

FLIGHT = DATA / "recordings" / "nc_lost_client.mcap"
GPX = "{http://www.topografix.com/GPX/1/1}"
GX = "{http://www.google.com/kml/ext/2.2}"


def values(suffix=None):
    return [value for value in read_values(FLIGHT) if suffix in {None, value.suffix}]


def made(suffix, schema, **fields):
    return ExportedValue("mk1", suffix, 1700000000.25, 5.0, {"stamp": {}} | fields, schema)


def test_a_table_has_every_value_of_its_key_with_units_in_the_header_and_parquet_the_same_numbers(tmp_path):
    write_csv(values, tmp_path / "csv", overwrite=False)
    with (tmp_path / "csv" / "t.state_position.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    positions = values("state/position")
    assert [float(row["latitude_deg [deg]"]) for row in rows] == [one.fields["latitude_deg"] for one in positions]
    assert [float(row["time [s]"]) for row in rows] == [one.wall for one in positions]
    assert rows[0]["altitude [m]"] == "12.0"
    from pyarrow import parquet

    write_parquet(values, tmp_path / "parquet", overwrite=False)
    table = parquet.read_table(tmp_path / "parquet" / "t.state_battery.parquet")
    assert table["voltage [V]"].to_pylist() == [one.fields["voltage"] for one in values("state/battery")]


@pytest.mark.parametrize(
    ("schema", "path", "unit"),
    [
        ("Nobody.v1", "field", ""),
        ("Velocity.v1", "velocity_enu", "m/s"),
        ("Velocity.v1", "velocity_enu.2", "m/s"),
        ("ControlEstimate.v1", "covariance.0.0", "m2"),
        ("ControlEstimate.v1", "covariance.2.1", "m2/s"),
        ("ControlEstimate.v1", "covariance.1.2", "m2/s2"),
        ("VisionPose.v1", "covariance.0", "m2"),
        ("VisionPose.v1", "covariance.5", "m rad"),
        ("VisionPose.v1", "covariance.18", "m rad"),
        ("VisionPose.v1", "covariance.35", "rad2"),
        ("VisionPose.v1", "calibration_sd.1", "m"),
        ("VisionPose.v1", "calibration_sd.2", "rad"),
        ("VisionPose.v1", "position_cam.0", "m"),
    ],
)
def test_every_element_has_its_own_unit(schema, path, unit):
    assert unit_of(schema, path) == unit


def test_columns_of_parquet_have_one_kind_each_in_every_row_group(tmp_path, monkeypatch):
    from pyarrow import parquet

    monkeypatch.setattr(tables, "WAITING", 40)
    mixed = [1, 2.5, None, 3] * 10
    rows = [
        made("state/x", "X.v1", number=value, either=value if index % 2 else "text", nothing=None, long="y" * 250)
        for index, value in enumerate(mixed)
    ]
    (path,) = write_parquet(lambda: rows, tmp_path / "out", overwrite=False)
    assert parquet.ParquetFile(path).num_row_groups > 3
    table = parquet.read_table(path)
    assert table["number"].to_pylist() == [None if value is None else float(value) for value in mixed]
    assert table["either"].to_pylist()[:4] == ["text", "2.5", "text", "3"]
    assert table["nothing"].null_count == len(mixed)
    with pytest.raises(MkError, match="does not fit Parquet"):
        write_parquet(lambda: [made("state/y", "Y.v1", number=2**63)], tmp_path / "out", overwrite=False)
    assert [one.name for one in (tmp_path / "out").iterdir()] == [path.name]


def test_what_cannot_be_exported_is_named(tmp_path):
    with pytest.raises(MkError, match="nothing to export"):
        write_csv(list, tmp_path / "out", overwrite=False)
    (tmp_path / "file").write_text("x", encoding="utf-8")
    with pytest.raises(MkError, match="cannot be created"):
        write_csv(values, tmp_path / "file" / "out", overwrite=False)
    with pytest.raises(MkError, match=r"mk1\.state_a: more than 5000 columns; export other keys, with --key"):
        write_csv(lambda: [made("state/a", "", a=list(range(6000)))], tmp_path / "csv", overwrite=False)


def test_tracks_are_where_it_flew():
    positions = values("state/position")
    tracks = tracks_of(positions)
    points = ElementTree.fromstring("".join(gpx(tracks))).findall(f".//{GPX}trkpt")
    expected = [(round(one.fields["latitude_deg"], 7), round(one.fields["longitude_deg"], 7)) for one in positions]
    assert [(float(p.get("lat")), float(p.get("lon"))) for p in points] == expected
    assert points[0].findtext(f"{GPX}ele") == "12.00"
    assert points[0].findtext(f"{GPX}time").startswith("2023-11-14T22:30:00.")
    coords = [c.text.split() for c in ElementTree.fromstring("".join(kml(tracks))).iter(f"{GX}coord")]
    assert [(float(lat), float(lon)) for lon, lat, _ in coords] == expected
    with pytest.raises(MkError, match="state/position"):
        tracks_of([])


@pytest.mark.parametrize("wrong", [None, "north", [1.0], {}, float("nan"), float("inf")])
def test_a_position_that_is_none_is_named(wrong):
    (whole, *_) = values("state/position")
    value = made("state/position", whole.schema, **{**whole.fields, "latitude_deg": wrong})
    with pytest.raises(MkError, match=r"state/position of mk1 at 1700000000.250 s: .*latitude_deg"):
        tracks_of([value])
