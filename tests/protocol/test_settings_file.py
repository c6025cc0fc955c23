from __future__ import annotations

import json
import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mkdaemon.errors import EncodeError, MkError, ProtocolError
from mkdaemon.protocol.settings import ParameterSet, layout_of
from mkdaemon.protocol.settings_file import SettingsFile, parse_value, spell_value
from tests.protocol.test_settings import blank, parameter_sets


def example() -> SettingsFile:
    parameters = blank(106).replaced({"gyro_p": 90, "external_control": 253, "global_config": 0x0C, "name": 'E"ä\\'})
    return SettingsFile(parameters, slot=3, firmware="2.12a", saved="2014-05-01T12:00:00Z")


@given(parameter_sets(), st.integers(1, 5), st.sampled_from(["toml", "json"]))
def test_a_file_survives_byte_for_byte(parameters, slot, form):
    file = SettingsFile(parameters, slot, "2.12a")
    text = file.to_toml() if form == "toml" else file.to_json()
    assert SettingsFile.parse(text) == file


@given(st.integers(115, 255), st.binary(min_size=1, max_size=180))
def test_an_unknown_revision_keeps_its_raw_bytes(revision, rest):
    file = SettingsFile(ParameterSet(bytes([revision]) + rest), 1, "9.99a")
    for text in (file.to_toml(), file.to_json()):
        assert SettingsFile.parse(text) == file
        assert "gyro" not in text


def test_a_file_says_what_it_is():
    content = tomllib.loads(example().to_toml())
    assert (content["firmware"], content["revision"], content["slot"]) == ("2.12a", 106, 3)
    assert content["name"] == 'E"ä\\'
    assert bytes.fromhex(content["raw"]) == example().parameters.raw
    assert content["values"]["external_control"] == "poti3"
    assert content["values"]["global_config"] == ["heading_hold", "compass"]
    assert content["values"]["gyro_p"] == 90
    assert json.loads(example().to_json())["values"] == content["values"]


def test_without_raw_the_names_count():
    content = json.loads(example().to_json())
    del content["raw"]
    content["values"]["gyro_p"] = 91
    parsed = SettingsFile.parse(json.dumps(content))
    assert parsed.parameters == example().parameters.replaced({"gyro_p": 91})


def edited(**changes: object) -> str:
    content = json.loads(example().to_json())
    for name, value in changes.items():
        if value is None:
            del content[name]
        else:
            content[name] = value
    return json.dumps(content)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("no toml at all", "neither TOML nor JSON"),
        ("{broken", "neither TOML nor JSON"),
        ("", "format is None"),
        (edited(format="x"), "format is 'x'"),
        (edited(slot=0), "slot is 0"),
        (edited(slot=None), "slot is None"),
        (edited(revision="106"), "revision is '106'"),
        (edited(revision=105), "revision says 105, the raw bytes say 106"),
        (edited(raw="zz"), "raw is not hexadecimal"),
        (edited(raw=""), "at least its revision byte"),
        (edited(values=[1]), "values is not a table"),
        (edited(values={"gyro_p": 91}), "gyro_p is 91 by name but 90 in raw"),
        (edited(values={"external_control": "poti9"}), "poti 9 does not exist"),
        (edited(values={"gyro_q": 91}), "has no 'gyro_q'"),
        (edited(raw=None, values={"gyro_p": 91}), "missing: revision"),
        (edited(raw=None, revision=200), "revision 200 is not known"),
    ],
)
def test_a_damaged_file_is_refused_by_name(text, reason):
    with pytest.raises(MkError, match=reason):
        SettingsFile.parse(text)


@pytest.mark.parametrize(
    ("name", "spelled", "value"),
    [
        ("gyro_p", 90, 90),
        ("gyro_p", "90", 90),
        ("gyro_p", "poti1", 255),
        ("global_config", [], 0),
        ("global_config", ["compass", "compass"], 8),
        ("global_config", ["bit_7"], 128),
        ("global_config", 12, 12),
        ("channels", [1, 2], (1, 2)),
        ("name", "Easy", "Easy"),
    ],
)
def test_values_as_people_write_them(name, spelled, value):
    layout = layout_of(106)
    assert layout is not None
    assert parse_value(layout, name, spelled) == value


@pytest.mark.parametrize(
    ("name", "spelled"),
    [
        ("gyro_p", "fast"),
        ("gyro_p", 1.5),
        ("gyro_p", True),
        ("gyro_p", None),
        ("stick_p", "poti1"),
        ("gyro_p", "potiX"),
        ("channels", [1, "x"]),
        ("global_config", ["no_such_bit"]),
    ],
)
def test_values_that_mean_nothing(name, spelled):
    layout = layout_of(106)
    assert layout is not None
    with pytest.raises(EncodeError, match=name):
        parse_value(layout, name, spelled)


def test_spelling_needs_a_layout():
    with pytest.raises(ProtocolError, match="raw bytes only"):
        spell_value(ParameterSet(b"\1"), "gyro_p")
    assert spell_value(blank(106), "channels") == [0] * 12
