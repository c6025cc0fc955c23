"""NaviCtrl: waypoints, parameters, redirection (docs/firmware-notes 4.4, 4.5; docs/protocol.md 8)."""

from __future__ import annotations

import pytest

from mkdaemon.protocol.flags import PointType, PositionStatus
from mkdaemon.protocol.framing import FrameDecoder, encode_frame
from mkdaemon.protocol.messages import SendTarget024, WriteWaypoint024
from mksim.boards.navictrl_state import ESCAPE
from tests.sim_conformance.bench import nc_bench

HOME = (74591000, 532301000)


def point(
    index, *, status=PositionStatus.NEW, what=PointType.WAYPOINT, north=0, kind=WriteWaypoint024, radius=3, hold=0
):
    return kind(
        longitude=HOME[0],
        latitude=HOME[1] + north,
        altitude=50,
        status=status,
        tolerance_radius=radius,
        hold_time=hold,
        index=index,
        type=what,
    ).to_frame()


def flying(bench):
    bench.board.flight.core.start()
    bench.run(bench.board.now + 1.0)
    assert bench.board.flight.core.flying


@pytest.fixture
def bench():
    return nc_bench()


@pytest.mark.parametrize(
    ("index", "status", "what", "reply", "stored"),
    [
        (1, PositionStatus.NEW, PointType.WAYPOINT, 1, 1),
        (31, PositionStatus.NEW, PointType.WAYPOINT, 31, 1),
        (32, PositionStatus.NEW, PointType.WAYPOINT, 0, 0),
        (0, PositionStatus.NEW, PointType.WAYPOINT, 0, 0),
        (2, PositionStatus.NEW, PointType.POINT_OF_INTEREST, 2, 1),
        (1, PositionStatus.NEW, PointType.INVALID, 1, 0),
    ],
)
def test_write(bench, index, status, what, reply, stored):
    received = bench.ask(point(index, status=status, what=what), 2.0)
    assert (received.frame.id, received.frame.payload[0]) == ("W", reply)
    assert bench.board.navigator.points.count == stored


def test_w_0_means_cleared_as_well_as_refused(bench):
    for index in (1, 2, 3):
        bench.ask(point(index), 2.0 + 0.1 * index, 0.05)
    refused = bench.ask(point(99), 3.0, 0.05)
    assert bench.board.navigator.points.count == 3
    cleared = bench.ask(point(0, status=PositionStatus.INVALID, what=PointType.INVALID), 3.1, 0.05)
    assert bench.board.navigator.points.count == 0
    assert refused.frame.payload == cleared.frame.payload == bytes(3)


def test_read_back(bench):
    written = point(1, north=700)
    bench.ask(written, 2.0, 0.05)
    bench.ask(point(2, what=PointType.POINT_OF_INTEREST), 2.1, 0.05)
    back = bench.ask(encode_frame(2, "x", b"\x01"), 2.2, 0.05)
    assert len(back.frame.raw) == 50
    assert back.frame.payload[:32] == bytes([2, 1]) + FrameDecoder().feed(written)[0].payload
    assert bench.board.navigator.points.waypoints == 1
    above = bench.ask(encode_frame(2, "x", b"\x03"), 2.3, 0.05)
    assert above.frame.payload == bytes([2, 0, 0])
    assert bench.ask(encode_frame(2, "x", b"\x00"), 2.4, 0.2) is None


def test_ten_writes_back_to_back_are_all_stored_and_not_all_confirmed(bench):
    bench.send(encode_frame(2, "o", b"\x02"), 2.0)
    for index in range(1, 11):
        bench.send(point(index), 2.1)
    confirmed = bench.ids(bench.run(3.0)).count("W")
    assert bench.board.navigator.points.count == 10
    assert 3 <= confirmed <= 8


@pytest.mark.parametrize("word", ["0.24", "2.14"])
def test_a_change_to_coming_home_flies_it_and_leaving_ends_that(word):
    bench = nc_bench(word)
    flying(bench)
    bench.ask(point(1, north=2000), 3.0, 0.05)
    bench.aircraft.pilot.switches[2] = 255
    bench.run(3.5)
    assert (bench.board.navigator.points.index, bench.board.navigator.points.is_flown) == (1, True)
    bench.aircraft.pilot.switches[2] = 0
    bench.run(4.0)
    assert not bench.board.navigator.points.is_flown


def test_s_starts_it_when_flying_only():
    frame = point(1, north=2000, kind=SendTarget024)
    bench = nc_bench()
    bench.send(frame, 2.0)
    bench.run(2.5)
    assert bench.board.navigator.points.index == 0
    flying(bench)
    bench.send(frame, bench.board.now)
    bench.run(bench.board.now + 0.5)
    assert bench.board.navigator.points.index == 1
    assert bench.ids() == "", "s has no reply"


def test_a_list_that_is_flown_takes_effect_at_once(bench):
    flying(bench)
    for index in (1, 2):
        bench.ask(point(index, north=0 if index == 1 else 5000), 3.0 + 0.1 * index, 0.05)
    bench.aircraft.pilot.switches[2] = 255
    bench.run(4.0)
    assert bench.board.navigator.points.index == 2, "the first was reached at once"
    bench.ask(point(1, north=9000), 4.1, 0.2)
    assert bench.board.navigator.points.index == 1


def test_the_route_holds_and_goes_on(bench):
    flying(bench)
    bench.ask(point(1, hold=2), 3.0, 0.05)
    bench.ask(point(2, what=PointType.POINT_OF_INTEREST), 3.1, 0.05)
    bench.ask(point(3, north=5000), 3.2, 0.05)
    bench.aircraft.pilot.switches[2] = 255
    bench.run(4.5)
    assert (bench.board.navigator.points.index, bench.board.navigator.points.reached) == (1, True)
    assert bench.board.navigator.flags() & 0x20
    bench.run(6.5)
    assert (bench.board.navigator.points.index, bench.board.navigator.points.reached) == (3, False), (
        "a POI is not flown to"
    )


def redirected(target=0):
    bench = nc_bench()
    bench.send(encode_frame(2, "u", bytes([target])), 2.0)
    bench.run(2.05)
    return bench


def test_the_navictrl_is_deaf_while_redirected():
    bench = redirected(1)
    assert bench.ask(encode_frame(2, "z", b"\x01\x00"), 2.2) is None


@pytest.mark.parametrize(
    ("raw", "ends"),
    [
        (ESCAPE, True),
        (ESCAPE + ESCAPE, True),
        (b"abc" + ESCAPE, True),
        (b"\x1b" + ESCAPE, False),
        (ESCAPE[:4], False),
        (ESCAPE[:-1] + b"\x01", False),
    ],
)
def test_escape(raw, ends):
    bench = redirected()
    bench.send(raw, 2.1)
    received = bench.ask(encode_frame(2, "z", b"\x05\x00"), 2.2)
    assert (received is not None and received.frame.id == "Z") is ends


@pytest.mark.parametrize(("wait_ms", "received"), [(0.2, False), (1.0, False), (2.2, True), (5.0, True)])
def test_two_ms_after_the_escape_are_lost(wait_ms, received):
    bench = redirected()
    free = bench.send(ESCAPE, 2.1)
    bench.send(encode_frame(2, "z", b"\x05\x00"), free + wait_ms * 1e-3)
    assert ("Z" in bench.ids(bench.run(2.5))) is received


def test_redirection_cuts_the_frame_being_sent_and_its_tail_comes_after_the_escape(bench):
    bench.send(encode_frame(2, "o", b"\x64"), 2.0)
    bench.send(encode_frame(2, "u", b"\x00"), 2.005)
    bench.run(2.3)
    assert "O" not in bench.ids()
    before = b"".join(byte for _, byte in bench.raw)
    bench.send(ESCAPE, 2.3)
    bench.run(2.5)
    after = b"".join(byte for _, byte in bench.raw)[len(before) :]
    start = before.index(b"#cO")
    cut = before[start:].partition(b"\r\r\n")[0]
    assert len(cut) + len(after) == 118
    assert after.endswith(b"\r")


@pytest.mark.parametrize(
    ("target", "running", "redirects"),
    [(0, True, True), (1, True, False), (2, True, False), (1, False, True), (3, False, False)],
)
def test_redirection_while_motors_run(bench, target, running, redirects):
    if running:
        flying(bench)
    bench.send(encode_frame(2, "u", bytes([target])), bench.board.now)
    bench.run(bench.board.now + 0.1)
    assert bench.board.redirection.is_on is redirects


def test_error_text_leaves_stale_characters(bench):
    bench.aircraft.pilot.rc_quality = 0
    bench.run(2.5)
    lost = bench.ask(encode_frame(2, "e"), 2.6, 0.05)
    bench.aircraft.pilot.rc_quality = 200
    bench.run(4.0)
    fine = bench.ask(encode_frame(2, "e"), 4.1, 0.05)
    text = fine.frame.payload[:25]
    ended = text.index(0)
    assert ended < lost.frame.payload.index(0)
    assert text[ended + 1 :] == lost.frame.payload[ended + 1 : 25]


def lose_gps(bench):
    bench.aircraft.sensors.gps = bench.aircraft.sensors.gps.__class__(0, 0, 0.0, (0.0, 0.0, 0.0), 0, False, 0.0, 2)


ERRORS = [
    # what goes wrong, error code in NaviData
    (lambda bench: None, 0),
    (lambda bench: setattr(bench.aircraft.pilot, "rc_quality", 0), 7),
    (lambda bench: bench.aircraft.faults.start("fc_reboot"), 3),
    (lose_gps, 5),
]


@pytest.mark.parametrize(("spoil", "code"), ERRORS)
def test_error_codes_reach_navidata_and_forbid_the_start(bench, spoil, code):
    spoil(bench)
    bench.run(2.5)
    received = bench.ask(encode_frame(2, "o", b"\x00"), 2.5, 0.05) or bench.ask(
        encode_frame(2, "o", b"\x64"), 2.6, 0.05
    )
    assert received.frame.payload[69] == code
    assert bench.board.flight.companion_error == code


@pytest.mark.parametrize(("asked", "given"), [(0, 0), (1, 1), (15, 15), (16, 15), (64, 15), (255, 15)])
def test_menu_pages(bench, asked, given):
    received = bench.ask(encode_frame(2, "l", bytes([asked])), 2.0)
    assert received.frame.payload[:2] == bytes([given, 15])
    assert f"[{given}]".encode() in received.frame.payload[:22]


def test_the_obsolete_display_format_is_refused_once(bench):
    received = bench.ask(encode_frame(2, "h", b"\x05\x0a"), 2.0, 2.0)
    assert len(received.frame.raw) == 34
    assert bench.ids() == "H"
