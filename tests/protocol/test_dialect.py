from __future__ import annotations

import pytest

from mkdaemon.errors import ProtocolError
from mkdaemon.protocol.decoder import Unknown
from mkdaemon.protocol.dialect import Dialect, Evidence, decide
from mkdaemon.protocol.evidence import ControlForm
from mkdaemon.protocol.generations import DeadMan, Release
from mkdaemon.protocol.messages import (
    AttitudeDataNc,
    ControlStateV1,
    ControlStateV2,
    ExternControlV1,
    ExternControlV2,
    ExternControlV3,
    NaviVersion200,
    NaviVersionClassic,
    OsdData5,
    OsdTiny,
    Settings,
    VersionClassic,
    VersionFc200,
    VersionFc210,
    WriteWaypoint024,
    WriteWaypoint2x,
    WriteWaypointOld,
)
from mkdaemon.protocol.wire import Board, WireMessage


def fc_version(major: int, minor: int, patch: int = 0, protocol: int = 11) -> WireMessage:
    cls = VersionFc210 if (major, minor) >= (2, 9) else VersionFc200 if (major, minor) >= (0, 91) else VersionClassic
    payload = bytearray(10)
    payload[:3] = major, minor, protocol
    payload[4] = patch
    if cls is VersionFc210:
        payload[3], payload[7] = 0xBA, 22
    return cls.decode(bytes(payload))


def nc_version(major: int, minor: int, patch: int = 0) -> WireMessage:
    cls = NaviVersion200 if major >= 2 else NaviVersionClassic
    return cls.decode(bytes([major, minor, 11, 0, patch, 0, 0, 0, 0, 0]))


def evidence(*seen: tuple[Board, WireMessage | Unknown]) -> Evidence:
    known = Evidence()
    for board, message in seen:
        known = known.with_message(board, message)
    return known


def fc(major: int, minor: int, patch: int = 0, *more: WireMessage) -> Dialect:
    return decide(evidence((Board.FC, fc_version(major, minor, patch)), *((Board.FC, message) for message in more)))


@pytest.mark.parametrize(
    ("releases", "control", "dead_man"),
    [
        ([(0, 71), (0, 76)], ExternControlV1, DeadMan.ANY_COMMAND_0S5),
        ([(0, 78), (0, 84), (0, 90), (0, 91), (2, 0), (2, 6), (2, 8)], ExternControlV1, DeadMan.POLLING_5S3),
        ([(2, 10), (2, 11)], ExternControlV2, DeadMan.UNKNOWN),
        ([(2, 12)], ExternControlV2, DeadMan.CONTROL_2S),
        ([(2, 13), (2, 14), (2, 22)], ExternControlV3, DeadMan.UNKNOWN),
    ],
)
def test_flight_control_by_release(releases, control, dead_man):
    layout, is_late = control.spec.layout, control is not ExternControlV1
    for dialect in (fc(*release) for release in releases):
        assert (dialect.read_only_reason, dialect.via_navictrl, dialect.confirms_control) == (None, False, True)
        assert dialect.extern_control is dialect.message(Board.FC, "ExternControl") is control
        assert dialect.extern_control_layout == layout
        assert (dialect.dead_man, dialect.stick_filter) == (dead_man, is_late)
        assert dialect.layouts[Board.FC, "C"] == ("fc210" if is_late else "fc_old")
        assert dialect.layouts[Board.FC, "b"] == dialect.layouts[Board.FC, "G"] == layout


@pytest.mark.parametrize("release", [(0, 70), (0, 95), (1, 5), (2, 23), (3, 0), (9, 9)])
def test_a_release_in_no_table_is_read_only(release):
    dialect = fc(*release)
    assert dialect.extern_control is None
    assert dialect.read_only_reason == f"FlightCtrl {Release(*release)} is in no table"
    assert dialect.dead_man is DeadMan.UNKNOWN


@pytest.mark.parametrize(
    ("read_back", "layout", "dead_man", "stick_filter"),
    [(ControlStateV1, "v1", DeadMan.POLLING_5S3, False), (ControlStateV2, "v2", DeadMan.UNKNOWN, True)],
)
def test_2_09_may_be_either_until_read_back(read_back, layout, dead_man, stick_filter):
    before = fc(2, 9)
    assert before.extern_control is None
    assert "read it back (g)" in (before.read_only_reason or "")
    after = fc(2, 9, 3, read_back.decode(bytes(11)))
    assert (after.extern_control_layout, after.read_only_reason) == (layout, None)
    assert (after.dead_man, after.stick_filter) == (dead_man, stick_filter)


@pytest.mark.parametrize(
    ("release", "read_back", "agrees"),
    [
        ((2, 12), ControlStateV1, False),
        ((2, 8), ControlStateV2, False),
        ((2, 8), ControlStateV1, True),
        ((2, 14), ControlStateV2, True),
    ],
)
def test_what_is_read_back_must_agree_with_the_release(release, read_back, agrees):
    dialect = fc(*release, 0, read_back.decode(bytes(11)))
    assert (dialect.extern_control is not None) is agrees
    assert ("form" in (dialect.read_only_reason or "")) is not agrees


def test_a_navictrl_alone_does_not_tell_what_the_flightctrl_reads():
    dialect = decide(evidence((Board.NC, nc_version(0, 24, 1))))
    assert dialect.via_navictrl
    assert str(dialect.nc_release) == "0.24b"
    assert dialect.extern_control is None
    assert "FlightCtrl has not named its release" in (dialect.read_only_reason or "")
    assert dialect.layouts[Board.NC, "C"] == "nc"
    assert dialect.message(Board.NC, "AttitudeData") is AttitudeDataNc


@pytest.mark.parametrize(
    ("release", "point", "attitude", "sets"),
    [
        ((0, 18), WriteWaypointOld, "nc", False),
        ((0, 24), WriteWaypoint024, "nc", False),
        ((0, 28), None, "nc_sticks", False),
        ((2, 12), WriteWaypoint2x, "nc_sticks", False),
        ((2, 14), WriteWaypoint2x, "nc_sticks", True),
    ],
)
def test_navictrl_by_release(release, point, attitude, sets):
    dialect = decide(evidence((Board.NC, nc_version(*release)), (Board.FC, fc_version(2, 12))))
    assert dialect.layouts[Board.NC, "C"] == attitude
    assert dialect.has_osd_sets is sets
    assert dialect.confirms_control is (release >= (2, 13))
    assert dialect.via_navictrl
    assert dialect.read_only_reason is None
    if point is not None:
        assert dialect.message(Board.NC, "WriteWaypoint") is point


def test_a_navictrl_in_no_table_is_read_only():
    dialect = decide(evidence((Board.NC, nc_version(0, 17)), (Board.FC, fc_version(0, 80))))
    assert dialect.read_only_reason == "NaviCtrl 0.17a is in no table"
    assert not dialect.confirms_control
    assert (Board.NC, "s") not in dialect.layouts


@pytest.mark.parametrize("protocol", [0, 6, 7, 8, 9, 10, 11, 12, 255])
def test_a_foreign_protocol_is_refused_by_name(protocol):
    dialect = decide(evidence((Board.FC, fc_version(2, 12, 0, protocol))))
    is_foreign = f"fc speaks serial protocol {protocol}, MikroKopter firmware 7 to 11" in (
        dialect.read_only_reason or ""
    )
    assert is_foreign is (dialect.extern_control is None) is (protocol not in range(7, 12))


def test_a_strange_version_reply_is_named_until_the_same_board_sends_a_good_one():
    odd = decide(evidence((Board.NC, Unknown(Board.NC, "V", bytes(6), "no layout"))))
    assert odd.read_only_reason == "nc answers the version request with 6 bytes, not 12"
    empty = evidence((Board.FC, Unknown(Board.FC, "V", b"", "no layout")))
    for foreign in (empty, empty.with_message(Board.NC, nc_version(0, 24))):
        assert "ctraabe" in (decide(foreign).read_only_reason or "")
    assert decide(empty.with_message(Board.FC, fc_version(2, 12))).read_only_reason is None


def test_another_release_at_the_same_address_starts_over():
    first = evidence(
        (Board.FC, fc_version(2, 9)),
        (Board.FC, ControlStateV2.decode(bytes(9))),
        (Board.FC, Settings(index=1, parameters=bytes([104]) + bytes(140))),
    )
    assert decide(first).settings_revision == 104
    second = first.with_message(Board.FC, fc_version(2, 12))
    assert second.control_form is None
    assert decide(second).settings_revision is None
    same = first.with_message(Board.FC, fc_version(2, 9))
    assert same.control_form is ControlForm.SHORT


@pytest.mark.parametrize(
    ("release", "revision", "reason"),
    [
        ((2, 12), 106, None),
        ((2, 12), 105, "parameter revision 105 does not belong to FlightCtrl 2.12a (106)"),
        ((2, 0), 95, None),
        ((2, 0), 200, "parameter revision 200 does not belong to FlightCtrl 2.00a (94, 95, 96)"),
        ((2, 50), 106, "the FlightCtrl's release is not known"),
    ],
)
def test_settings_are_written_only_in_a_revision_of_the_release(release, revision, reason):
    dialect = fc(*release, 0, Settings(index=1, parameters=bytes([revision]) + bytes(143)))
    assert dialect.settings_revision == revision
    assert dialect.settings_read_only_reason == reason


def test_settings_of_unknown_and_foreign_boards():
    assert fc(2, 12).settings_read_only_reason.startswith("no parameter set has been read yet")
    settings = Settings(index=1, parameters=bytes([106]) + bytes(143))
    assert decide(evidence((Board.FC, settings))).settings_read_only_reason == "the FlightCtrl's release is not known"
    foreign = evidence((Board.FC, fc_version(2, 12)), (Board.FC, settings), (Board.FC, Unknown(Board.FC, "V", b"", "")))
    assert "ctraabe" in (decide(foreign).settings_read_only_reason or "")


def test_navidata_tells_its_own_version():
    osd = OsdData5.decode(bytes([5]) + bytes(81))
    known = evidence((Board.NC, nc_version(0, 24)), (Board.NC, osd))
    assert known.osd_versions == {5}
    assert not decide(known).has_osd_sets
    assert (Board.NC, "osd_request") not in decide(known).unsupported
    assert decide(known.with_message(Board.NC, OsdTiny.decode(bytes([10]) + bytes(14)))).has_osd_sets
    strange = known.with_message(Board.NC, Unknown(Board.NC, "O", bytes([2]) + bytes(74), ""))
    assert decide(strange).unsupported[Board.NC, "osd_request"] == "NaviData version 2 is not documented"


def test_a_message_nobody_has():
    with pytest.raises(ProtocolError, match="mag has no message 'OsdData'"):
        fc(2, 12).message(Board.MAG, "OsdData")


@pytest.mark.parametrize(
    ("dead_man", "hold", "refreshing", "harmless"),
    [
        (DeadMan.ANY_COMMAND_0S5, 0.5, "bvz", ""),
        (DeadMan.POLLING_5S3, 5.3, "abdhlpt", "vgcq"),
        (DeadMan.CONTROL_2S, 2.05, "b", "adhlptv"),
        (DeadMan.UNKNOWN, 5.3, "bvz", ""),
    ],
)
def test_dead_man_generations(dead_man, hold, refreshing, harmless):
    assert dead_man.hold_time == hold
    assert all(dead_man.refreshed_by(letter) for letter in refreshing)
    assert not any(dead_man.refreshed_by(letter) for letter in harmless)
