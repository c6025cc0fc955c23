"""What a flight of the whole daemon is judged by: the true place, and bytes on the wire against images."""

from __future__ import annotations

import asyncio

import pytest

from lab.fly import PERIOD, hold_of, images_to_wire
from lab.rigs.overtarget import HEIGHT, Made, Seen
from lab.rigs.wiretap import BAUD, BITS, frames_on_wire, tapped
from mkdaemon.client import Sample
from mkdaemon.protocol.framing import encode_frame
from mkdaemon.protocol.messages import ExternControlV2

STICKS = encode_frame(1, "b", bytes(range(7)))
BYTE = BITS / BAUD


def take(seen, suffix, at, **fields):
    seen.take(Sample(suffix, {"stamp": {"monotonic": at}, **fields}, ""))


def flight(*, farthest=0.1):
    """An aircraft that stands 10 cm beside its goal, but for one moment, while the machine flies from 100 s on."""
    seen = Seen()
    for number in range(1000):
        x = farthest if number == 750 else 0.1
        at = 100.0 + number * PERIOD
        take(seen, "sim/truth", at, controlled=True, position_enu=(x, 0.0, HEIGHT), velocity_enu=(0.0, 0.0, 0.0))
    return seen


@pytest.mark.parametrize(("farthest", "holds"), [(0.1, True), (0.6, False)])
def test_one_moment_far_from_the_goal_is_no_hold(farthest, holds):
    found = hold_of(flight(farthest=farthest), 101.0, 119.0)
    assert (found["holds"], found["farthest_cm"], found["height_rms_cm"]) == (holds, 100 * farthest, 0.0)
    assert found["rms_cm"] == pytest.approx(10.0, abs=1.0)


def test_a_flight_that_never_began_is_no_hold():
    assert hold_of(Seen(), 101.0, 119.0) == {"rms_cm": None, "height_rms_cm": None, "farthest_cm": None, "holds": False}


def test_phases_and_what_the_ladder_did_are_kept_once():
    seen = Seen()
    for phase in ("free", "leased", "leased", "flying"):
        take(seen, "control/status", 1.0, phase=phase, reason="asked for")
    take(seen, "event/failsafe", 2.0, action="hold", reason="no setpoint")
    assert seen.phases == ["free: asked for", "leased: asked for", "flying: asked for"]
    assert seen.failsafes == ["hold: no setpoint"]


@pytest.mark.parametrize(("height", "speed", "hovers"), [(2.0, 0.1, True), (1.5, 0.1, False), (2.0, 0.4, False)])
def test_the_pilot_hovers_when_high_and_slow_with_the_target_in_sight(height, speed, hovers):
    seen = Seen()
    take(seen, "sim/truth", 1.0, controlled=False, position_enu=(0.0, 0.0, height), velocity_enu=(speed, 0.0, 0.0))
    assert not seen.is_hovering()
    take(seen, "vision/down/pose", 1.0, latency=0.1, delivered=0.08)
    assert seen.is_hovering() is hovers


def stick(number):
    return ExternControlV2(pitch=0, roll=0, yaw=0, throttle=0, frame=number, config=1)


def test_a_frame_has_left_with_its_last_byte_and_waits_for_the_bytes_before():
    cut = 4
    heard = [(1.0, STICKS[:cut]), (2.0, STICKS[cut:] + STICKS)]
    times = [at for at, _ in frames_on_wire(heard)]
    rest = len(STICKS) - cut
    assert times == pytest.approx([2.0 + rest * BYTE, 2.0 + (rest + len(STICKS)) * BYTE])


def test_each_image_reaches_the_wire_with_the_first_frame_that_rests_on_it_or_on_a_newer_one():
    frames = [Made(7, 1.001, 1.04), Made(8, 1.001, 1.06), Made(9, 1.199, 1.24)]
    seen = Seen(captures=[1.0, 1.1, 1.2], deliveries=[0.01] * 3, latencies=[0.03] * 3, frames=frames)
    sticks = [(1.05, stick(7)), (1.07, stick(8)), (1.25, stick(9))]
    ways = images_to_wire(seen, sticks, 0.0)
    assert [sum(way[1:]) for way in ways] == pytest.approx([0.04, 0.14, 0.04])
    assert ways[0] == pytest.approx((0.01, 0.02, 0.01, 0.01))
    assert [sum(way[1:]) for way in images_to_wire(seen, sticks, 1.0)] == pytest.approx([0.14, 0.04])


def test_a_frame_that_was_never_written_leaves_its_image_to_the_next_one():
    frames = [Made(7, 1.0, 1.02), Made(8, 1.0, 1.05)]
    seen = Seen(captures=[1.0], deliveries=[0.0], latencies=[0.01], frames=frames)
    assert [sum(way[1:]) for way in images_to_wire(seen, [(1.09, stick(8))], 0.0)] == pytest.approx([0.09])
    assert images_to_wire(seen, [(9.0, stick(7))], 0.0) == []  # the number came again


async def test_the_tap_passes_everything_on_and_notes_what_the_daemon_wrote():
    arrived = asyncio.Queue()

    async def serve(reader, writer):
        while data := await reader.read(100):
            arrived.put_nowait(data)
            writer.write(b"answer")
        writer.close()

    async with await asyncio.start_server(serve, "127.0.0.1", 0) as boards:
        port = boards.sockets[0].getsockname()[1]
        async with tapped(f"127.0.0.1:{port}") as tap:
            scheme, host, found = tap.port.split(":")
            assert scheme == "tcp"
            for _ in range(2):  # a daemon that lost its line comes again
                reader, writer = await asyncio.open_connection(host, int(found))
                writer.write(STICKS)
                assert await arrived.get() == STICKS
                assert await reader.read(100) == b"answer"
                writer.close()
    assert b"".join(data for _, data in tap.heard) == 2 * STICKS
    assert [sent.throttle for _, sent in tap.sticks()] == [ExternControlV2.decode(bytes(range(7))).throttle] * 2
