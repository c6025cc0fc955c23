"""Parameter sets: read and written by name, byte for byte, and as files that people edit."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mkdaemon.errors import EncodeError, MkError, ProtocolError
from mkdaemon.protocol.framing import Frame, FrameDecoder
from mkdaemon.protocol.messages import Settings
from mkdaemon.protocol.settings import ParameterSet, SetChange, known_revisions, layout_of
from mkdaemon.protocol.settings_file import SettingsFile, parse_value

REVISIONS = st.sampled_from(known_revisions())


def blank(revision: int) -> ParameterSet:
    layout = layout_of(revision)
    assert layout is not None
    return ParameterSet(bytes([revision]) + bytes(layout.size - 1))


@st.composite
def parameter_sets(draw) -> ParameterSet:
    revision = draw(REVISIONS)
    layout = layout_of(revision)
    assert layout is not None
    return ParameterSet(bytes([revision]) + draw(st.binary(min_size=layout.size - 1, max_size=layout.size - 1)))


@given(parameter_sets())
def test_reading_all_by_name_and_writing_it_back_changes_nothing(parameters):
    assert parameters.layout is not None
    values = parameters.values()
    assert parameters.replaced(values) == parameters
    assert sum(place.length for place in parameters.layout.places.values()) == len(parameters.raw)


@given(parameter_sets(), st.data())
def test_a_change_touches_its_own_byte_only(parameters, data):
    assert parameters.layout is not None
    single = [name for name, place in parameters.layout.places.items() if place.length == 1 and place.offset]
    name = data.draw(st.sampled_from(single))
    value = data.draw(st.integers(0, 255))
    changed = parameters.replaced({name: value})
    assert changed[name] == value
    before = parameters[name]
    assert parameters.changes_to(changed) == (() if before == value else (SetChange(name, before, value),))
    differing = [at for at, (old, new) in enumerate(zip(parameters.raw, changed.raw, strict=True)) if old != new]
    assert differing in ([], [parameters.layout.place(name).offset])


def test_a_recorded_set(fixtures):
    decoder = FrameDecoder()
    sets = []
    for line in (fixtures / "captures" / "fc_commands.jsonl").read_text(encoding="utf-8").splitlines():
        entry = json.loads(line)
        if entry["dir"] == "rx":
            frames = [item for item in decoder.feed(bytes.fromhex(entry["hex"])) if isinstance(item, Frame)]
            sets += [Settings.decode(frame.payload) for frame in frames if frame.id == "Q"]
    assert len(sets) == 10
    named = {reply.index: ParameterSet.from_payload(reply.parameters) for reply in sets}
    assert {index: found.name for index, found in named.items()} == {
        1: "Fast",
        2: "Agile",
        **dict.fromkeys((3, 4, 5), "Easy"),
    }
    easy = named[3]
    assert (easy.revision, len(easy.raw), easy.reason) == (106, 144, None)
    assert easy["channels"] == (3, 2, 1, 4, 5, 6, 7, 8, 9, 10, 11, 12)
    assert easy["external_control"] == 0
    assert easy.flags("global_config") == ("altitude_switch", "compass", "gps", "axis_coupling")
    differences = {change.name for change in named[2].changes_to(easy)}
    assert "name" in differences
    assert differences < set(easy.values())


@pytest.mark.parametrize(
    ("revision", "size", "reason"),
    [
        *((revision, 147, "is not known") for revision in (0, 72, 83, 99, 111, 115, 255)),
        (106, 101, "has 144 bytes, these are 101"),
    ],
)
def test_an_unknown_revision_or_one_of_the_wrong_length_is_raw_only(revision, size, reason):
    parameters = ParameterSet.from_payload(bytes([revision]) + bytes(size - 1))
    assert (parameters.layout, len(parameters.raw), parameters.values(), parameters.name) == (None, size, {}, "")
    assert parameters.reason == f"parameter revision {revision} {reason}: raw bytes only"
    for use in (lambda: parameters["gyro_p"], lambda: parameters.replaced({"gyro_p": 1})):
        with pytest.raises(ProtocolError, match="raw bytes only"):
            use()
    with pytest.raises(ProtocolError, match="at least its revision byte"):
        ParameterSet.from_payload(b"")


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("gyro_p", 256, "takes 0..255"),
        ("gyro_p", -1, "takes 0..255"),
        ("gyro_p", True, "takes 0..255"),
        ("gyro_p", "12", "takes 0..255"),
        ("gyro_p", (1, 2), "has 1 values, not 2"),
        ("channels", (1, 2), "has 12 values, not 2"),
        ("name", 5, "text of at most 12"),
        ("name", "thirteen char", "text of at most 12"),
        ("name", "€", "text of at most 12"),
        ("revision", 105, "cannot be changed"),
    ],
)
def test_a_value_that_does_not_fit_is_refused(name, value, reason):
    with pytest.raises(EncodeError, match=reason):
        blank(106).replaced({name: value})


def test_sets_that_cannot_be_compared_by_name_differ_as_a_whole():
    known, unknown = blank(106), ParameterSet(b"\x01\x02")
    assert known.changes_to(unknown) == (SetChange("raw", known.raw.hex(), "0102"),)
    dirty = ParameterSet(known.raw[:-1] + b"x")
    assert known.changes_to(dirty)[0].name == "raw"
    assert known.changes_to(known) == ()


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
