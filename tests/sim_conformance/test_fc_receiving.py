"""FlightCtrl: what it makes of damaged, short, long and wrongly addressed frames (docs/firmware-notes, 2 to 4)."""

from __future__ import annotations

import itertools

import pytest

from mkdaemon.protocol.framing import encode_frame
from tests.sim_conformance.bench import fc_bench

VERSION = encode_frame(1, "v")

DANGLING = [b"#", b"#b", b"#bv", b"#bv@", b"#bd?]==", b"##", b"#bv@x", b"x#", b"#b#v"]


@pytest.fixture
def bench():
    return fc_bench()


@pytest.mark.parametrize("debris", DANGLING)
def test_a_dangling_frame_swallows_the_next_for_ever(bench, debris):
    bench.send(debris, 1.1)
    assert bench.ask(VERSION, 30.0) is None


@pytest.mark.parametrize("debris", [*DANGLING, b"", b"\r", b"noise", VERSION])
def test_two_carriage_returns_recover_from_everything(bench, debris):
    bench.send(debris, 1.1)
    bench.run(1.5)
    received = bench.ask(b"\r\r" + VERSION, 2.0)
    assert received.frame.id == "V"


@pytest.mark.parametrize("address", range(28))
@pytest.mark.parametrize(
    ("letter", "payload"),
    [("v", b""), ("g", b""), ("a", b"\x05"), ("t", bytes(16)), ("b", bytes([0, 0, 0, 0, 9, 1, 0]))],
)
def test_common_commands_are_answered_at_any_address_by_the_flightctrl(bench, address, letter, payload):
    assert bench.ask(encode_frame(address, letter, payload), 1.5).frame.address == 1


@pytest.mark.parametrize("letter", ["n", "p", "q", "u", "f"])
@pytest.mark.parametrize("address", [0, 2, 3])
def test_other_commands_want_the_own_address(letter, address):
    assert fc_bench().ask(encode_frame(address, letter, b"\x01"), 1.5) is None


@pytest.mark.parametrize("frame", [b"#bv@y\r", encode_frame(1, "Z"), encode_frame(1, "z"), b"#bv\r", b"#\r", b"\r\r\r"])
def test_no_answer_to_nonsense(frame):
    assert fc_bench().ask(frame, 1.5) is None


@pytest.mark.parametrize(("chars", "accepted"), [(218, True), (222, False), (226, False), (398, False)])
def test_longest_frame(bench, chars, accepted):
    frame = encode_frame(1, "v", bytes((chars - 6) // 4 * 3))
    assert len(frame) == chars
    assert (bench.ask(frame, 1.5) is not None) is accepted
    # an over-long frame is dropped and leaves nothing dangling
    assert bench.ask(VERSION, 3.0) is not None


@pytest.mark.parametrize(("frame", "number"), [(b"#ba@c\r", 31), (b"#bq@s\r", 5)], ids=["label", "settings"])
def test_short_label_and_settings_requests_read_checksum_characters(bench, frame, number):
    assert bench.ask(frame, 1.5).frame.payload[0] == number


@pytest.mark.parametrize("letter", ["d", "c"])
def test_an_empty_subscription_starts_a_640_ms_stream(bench, letter):
    bench.send(encode_frame(1, letter), 1.5)
    times = [received.first for received in bench.run(5.0)]
    gaps = [b - a for a, b in itertools.pairwise(times)]
    assert len(gaps) >= 4
    assert gaps == pytest.approx([0.666] * len(gaps), abs=0.01)


def test_a_short_b_is_filled_with_what_stood_in_the_buffer(bench):
    for at, frame, state in (
        (1.5, b"#bb>MQBEB\r", b"#bG>MQBEAR?@M==ME\r"),
        (2.5, b"#bb@d\r", b"#bGMCMJEAR?@M==MN\r"),
    ):
        bench.ask(frame, at)
        assert bench.ask(b"#bg@i\r", at + 0.5).frame.raw == state


def test_the_navictrl_time_request_spins_motor_4(bench):
    bench.send(b"#ct=M==D{\r", 1.5)
    bench.run(1.6)
    assert bench.board.motors.setpoints(1.6)[:4] == [1, 0, 0, 0x1F]
    bench.run(2.2)
    assert bench.board.motors.setpoints(2.2) is None


@pytest.mark.parametrize(("chars", "size"), [(22, 11), (26, 15), (30, 18)])
def test_the_old_control_frame_is_ignored_silently(bench, chars, size):
    frame = encode_frame(1, "b", bytes([0, 0, 0, 5, 5, 5, 90, 0, 0, 7, 1] + [0] * (size - 11)))
    assert len(frame) == chars
    assert bench.ask(frame, 1.5) is None
    assert bench.board.external.held.frame == 0


def test_frame_0_gives_no_confirmation(bench):
    assert bench.ask(encode_frame(1, "b", bytes([1, 2, 3, 4, 0, 1, 0])), 1.5) is None
    assert bench.board.external.held.pitch == 1


def test_a_new_layout_on_an_old_board_lands_in_the_wrong_fields():
    bench = fc_bench("2.08")
    bench.ask(encode_frame(1, "b", bytes([11, 22, 33, 44, 55, 1, 0])), 1.5)
    held = bench.board.external.held
    assert (held.pitch, held.roll, held.yaw) == (44, 55, 1), "throttle, frame and config became sticks"
