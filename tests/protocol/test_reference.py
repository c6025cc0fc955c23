"""Every layout of the reference tables exists here with the same size, offsets and types, and nothing else does."""

from __future__ import annotations

import json
from typing import Any

import pytest

from mkdaemon.protocol.settings import layout_of
from mkdaemon.protocol.settings_table import REVISIONS
from mkdaemon.protocol.wire import MESSAGES, Board, WireMessage

FC, NC, MAG, BL = Board.FC, Board.NC, Board.MAG, Board.BL

PLACES: dict[str, list[tuple[Board, str, str]]] = {
    "VersionInfo_classic": [(FC, "V", "classic"), (NC, "V", "classic"), (MAG, "V", "classic")],
    "VersionInfo_FC200": [(FC, "V", "fc200"), (NC, "V", "fc200")],
    "VersionInfo_FC210": [(FC, "V", "fc210")],
    "DebugOut_FC": [(FC, "D", "fc"), (MAG, "D", "fc")],
    "DebugOut_NC": [(NC, "D", "nc")],
    "AnalogLabel": [(FC, "A", "1"), (NC, "A", "1"), (MAG, "A", "1")],
    "ExternControl_v1": [(FC, "b", "v1"), (FC, "G", "v1")],
    "ExternControl_v2": [(FC, "b", "v2"), (FC, "G", "v2")],
    "ExternControl_v3": [(FC, "b", "v3"), (NC, "b", "v3"), (FC, "G", "v3")],
    "ConfirmFrame": [(FC, "B", "1"), (NC, "B", "1")],
    "DisplayRequest": [(FC, "h", "1"), (NC, "h", "1")],
    "DisplayReply": [(FC, "H", "1"), (NC, "H", "1")],
    "DisplayReplyOld": [(FC, "H", "old"), (NC, "H", "old")],
    "MenuRequest": [(FC, "l", "1"), (NC, "l", "1")],
    "MenuReply": [(FC, "L", "1"), (NC, "L", "1")],
    "IntervalRequest": [
        *((board, "d", "1") for board in (FC, NC, MAG)),
        *((board, "c", "1") for board in (FC, NC)),
        (NC, "k", "1"),
        (NC, "t", "1"),
    ],
    "Data3D_FC_old": [(FC, "C", "fc_old")],
    "Data3D_FC210": [(FC, "C", "fc210")],
    "Data3D_NC": [(NC, "C", "nc")],
    "Data3D_NC_sticks": [(NC, "C", "nc_sticks")],
    "ToMK3Mag": [(MAG, "k", "k"), (MAG, "w", "w")],
    "CompassHeading": [(FC, "K", "1")],
    "MotorTest16": [(FC, "t", "16")],
    "MotorTest4": [(FC, "t", "4")],
    "SettingsRequest": [(FC, "q", "1"), (FC, "q", "reset")],
    "SettingNumberReply": [(FC, "S", "1"), (FC, "F", "1")],
    "ChangeSetting": [(FC, "f", "1")],
    "PPM_071": [(FC, "P", "071")],
    "PPM_077": [(FC, "P", "077")],
    "PPM_200": [(FC, "P", "200")],
    "MixerTable": [(FC, "N", "1"), (FC, "m", "1")],
    "MixerWriteReply": [(FC, "M", "1")],
    "SerialPoti": [(FC, "y", "1"), (NC, "y", "1")],
    "BLConfigRequest": [(FC, "u", "1")],
    "BLConfigReply": [(FC, "U", "1")],
    "BLConfigWrite": [(FC, "w", "1")],
    "BLConfigWriteReply": [(FC, "W", "1")],
    "ReceiverPassthrough": [(FC, "j", "1")],
    "VersionRequestFC": [(FC, "v", "which")],
    "RedundantStatus": [(BL, "?", "1")],
    "Echo": [(NC, "z", "1"), (NC, "Z", "1")],
    "ErrorText": [(NC, "E", "1")],
    "NaviData_v5": [(NC, "O", "5")],
    "NaviData_v3_v4": [(NC, "O", "4")],
    "WayPoint_old": [(NC, "s", "old"), (NC, "w", "old")],
    "Point_024": [(NC, "s", "024"), (NC, "w", "024")],
    "Point_027": [(NC, "s", "027"), (NC, "w", "027")],
    "Point_2x": [(NC, "s", "2x"), (NC, "w", "2x")],
    "PointRequest": [(NC, "x", "1")],
    "PointReply": [(NC, "X", "024"), (NC, "X", "027"), (NC, "X", "2x")],
    "PointWriteReply": [(NC, "W", "1")],
    "OsdRequest_v1": [(NC, "o", "v1")],
    "OsdRequest_v2": [(NC, "o", "v2")],
    "RedirectUart": [(NC, "u", "1")],
    "NcParamRequest": [(NC, "j", "1"), (NC, "j", "set")],
    "NcParamReply": [(NC, "J", "1")],
    "BLData": [(NC, "K", "1")],
    "DateTime_arm": [(NC, "T", "1")],
    **{
        f"Navi{name}": [(NC, "O", name.partition("_")[2])]
        for name in ("Tiny_10", "Flags_11", "Target_12", "Home_13", "Deviation_14", "WP_15", "Volatile_16")
    },
}
"""Where each structure of the reference is used."""

EMBEDDED: dict[str, list[tuple[Board, str, str, int]]] = {
    "GPS_Pos": [(NC, "O", "5", 1), (NC, "O", "5", 14), (NC, "O", "4", 31), (NC, "w", "024", 0)],
    "GPS_PosDev": [(NC, "O", "5", 27), (NC, "O", "4", 44)],
    "BLConfig": [(FC, "U", "1", 3), (FC, "w", "1", 1)],
    "Point_024": [(NC, "X", "024", 2)],
    "Point_027": [(NC, "X", "027", 2)],
    "Point_2x": [(NC, "X", "2x", 2)],
}
"""Structures inside others, with the offset."""


def units(ctype: str, count: int) -> list[tuple[str, int]]:
    """A field as a list of (type, size) items."""
    if ctype.startswith("char["):
        return [("char", 1)] * int(ctype[5:-1])
    size = {"8": 1, "6": 2, "2": 4}[ctype[-1]]
    return [(ctype, size)] * count


def reference_cells(struct: dict[str, Any], base: int = 0) -> dict[int, str]:
    cells = {}
    for field in struct["fields"]:
        at = base + field["offset"]
        for kind, size in units(field["ctype"], field.get("count") or 1):
            cells[at] = kind
            at += size
    return cells


def own_cells(cls: type[WireMessage]) -> dict[int, str]:
    cells = {}
    for slot in cls.spec.slots:
        kind = slot.wire.type_name.partition("[")[0]
        at = slot.offset
        for name, size in units(f"char[{slot.wire.count}]" if kind == "char" else kind, slot.wire.count):
            cells[at] = name
            at += size
    return cells


@pytest.fixture(scope="module")
def reference(shared) -> dict[str, dict[str, Any]]:
    table = json.loads((shared / "wire" / "structs.json").read_text(encoding="utf-8"))
    return {struct["name"]: struct for struct in table["structs"]}


def test_every_structure_has_its_messages_byte_for_byte(reference):
    for name, struct in reference.items():
        if name.startswith("ParamSet_") or name in {"GPS_Pos", "GPS_PosDev", "BLConfig"}:
            continue
        for place in PLACES[name]:
            cls = MESSAGES[place]
            assert cls.spec.size == struct["packed_length"], place
            mine, theirs = own_cells(cls), reference_cells(struct)
            if name == "PointReply":
                mine = {at: kind for at, kind in mine.items() if at < 2}
                theirs = {at: kind for at, kind in theirs.items() if at < 2}
            if name == "DebugOut_NC":
                theirs = {at: "s16" if kind == "u16" else kind for at, kind in theirs.items()}
            assert mine == theirs, (name, place)
    assert set(PLACES) == {n for n in reference if not n.startswith("ParamSet_")} - {
        "GPS_Pos",
        "GPS_PosDev",
        "BLConfig",
    }


def test_structures_inside_others(reference):
    for name, places in EMBEDDED.items():
        for *place, base in places:
            board, letter, layout = place
            cells = own_cells(MESSAGES[board, letter, layout])
            for at, kind in reference_cells(reference[name], base).items():
                assert cells[at] == kind, (name, place, at)


def test_firmware_words_are_the_reference_ones(reference):
    """A field found under the same offset carries the same word, but for arrays taken apart."""
    apart = {"HardwareError", "UserParam", "BLConfig", "Point"}
    for name, places in PLACES.items():
        words = {field["offset"]: field["name"] for field in reference[name]["fields"] if field["name"] not in apart}
        for place in places:
            if name == "IntervalRequest":
                continue
            for slot in MESSAGES[place].spec.slots:
                word = words.get(slot.offset, slot.wire.mk)
                assert slot.wire.mk in {word, word.removeprefix("GPS_Pos.")}, (name, place, slot.name)


def test_every_parameter_set_byte_for_byte(reference):
    sets = {int(name[9:]): struct for name, struct in reference.items() if name.startswith("ParamSet_")}
    assert set(sets) == set(REVISIONS)
    assert len(sets) == 32
    for revision, struct in sets.items():
        layout = layout_of(revision)
        assert layout is not None
        mine = [(place.parameter.mk, place.offset, place.length) for place in layout.places.values()]
        theirs = [(field["name"], field["offset"], field["size"]) for field in struct["fields"]]
        assert mine == theirs, revision
        assert layout.size == struct["packed_length"]


BITS_READ_DIFFERENTLY = {
    (90, "0x08"): "the reference itself says from 91 on",
    (90, "0x10"): "the reference itself says from 91 on",
    **{(revision, "0x40"): "speak_all: the text says up to 110" for revision in (112, 113, 114)},
}


def test_bits_of_parameters(reference):
    different = {}
    for revision in REVISIONS:
        layout = layout_of(revision)
        assert layout is not None
        for field in reference[f"ParamSet_{revision}"]["fields"]:
            if not field.get("bits"):
                continue
            (name,) = (name for name, place in layout.places.items() if place.parameter.mk == field["name"])
            mine = {f"0x{bit.mask:02x}": bit.mk for bit in layout.bits(name)}
            theirs = {
                mask.lower(): word if word.startswith("3-way") else word.partition(" (")[0]
                for mask, word in field["bits"].items()
                if word != "unused"
            }
            for mask in mine.keys() | theirs.keys():
                if mine.get(mask) != theirs.get(mask):
                    different[revision, mask] = (mine.get(mask), theirs.get(mask))
    assert set(different) == set(BITS_READ_DIFFERENTLY)
