"""When the flight core ticks while it flies by images: at once after one, else at its own rate."""

from __future__ import annotations

import itertools

import pytest

from mkdaemon.control.actions import SendSticks
from mkdaemon.control.events import PoseSeen
from mkdaemon.control.output import LONGEST_STEP, SHORTEST_STEP
from mkdaemon.control.pacing import EARLY, Pacing
from mkdaemon.telemetry.control import ControlLine
from mkdaemon.telemetry.setpoint import PositionSetpoint, SetpointFrame
from tests.control.events import CFG, OPEN, PERIOD, Driver, pose

IMAGE = 1 / 30
STEP = 0.001


def over_target(*, seconds, image_every=IMAGE, setpoint_every=PERIOD, line=OPEN, late=0.0):
    """A flight by position of an aircraft that stands still over its target; it, and when images came in flight.

    Every second image comes too late.
    """
    drive, images, next_image, next_setpoint = Driver(line=line), [], 0.0, 0.0
    drive.take()
    end = seconds
    while drive.now < end:
        if drive.now >= next_image + late * (len(images) % 2):
            drive.core.feed(PoseSeen(pose(next_image)), drive.now)
            next_image += image_every
            images.append(drive.now)
        if drive.now >= next_setpoint:
            drive.sequence += 1
            stream = {"epoch": drive.epoch, "sequence": drive.sequence, "ttl": 0.3}
            drive.offer(PositionSetpoint(**stream, position=(0.0, 0.0, 2.0), frame=SetpointFrame.PAD))
            next_setpoint += setpoint_every
        if not drive.sticks:
            end = drive.now + seconds
        drive.run(STEP)
    frames = [at for at, action in drive.done if isinstance(action, SendSticks)]
    return drive, frames, [at for at in images if frames[0] + 0.2 < at < frames[-1] - 0.1]


def gaps(frames):
    return [after - before for before, after in itertools.pairwise(frames)]


def test_an_image_is_answered_at_once_and_between_two_the_core_keeps_its_own_rate():
    _, frames, images = over_target(seconds=2.0)
    waits = [min(at for at in frames if at >= image) - image for image in images]
    assert len(images) > 30
    assert max(waits) < STEP
    assert max(gaps(frames)) <= 1 / CFG.rate + STEP
    assert min(gaps(frames)) >= SHORTEST_STEP - 1e-9


@pytest.mark.parametrize(("image_every", "between"), [(1 / 15, 3), (1 / 30, 1), (1 / 50, 0)])
def test_between_two_images_lie_as_few_ticks_as_the_rate_needs(image_every, between):
    _, frames, _ = over_target(seconds=0.6, image_every=image_every)
    assert len(frames) / (frames[-1] - frames[0]) == pytest.approx((between + 1) / image_every, rel=0.1)


@pytest.mark.parametrize("step", [0.01, 0.025])
def test_an_image_early_or_late_by_3_ms_is_answered_at_once(step):
    line = ControlLine("v2", shortest_step=step)
    _, frames, images = over_target(seconds=1.0, line=line, late=0.003)
    waits = [min(at for at in frames if at >= image) - image for image in images]
    assert len(images) > 15
    assert max(waits) <= STEP
    assert max(gaps(frames)) <= max(1 / CFG.rate, IMAGE + 0.007) + 2 * STEP


def test_on_a_line_of_40_frames_a_second_images_are_answered_at_once():
    slow = ControlLine("v2", shortest_step=0.025)
    _, frames, images = over_target(seconds=1.0, line=slow)
    waits = [min(at for at in frames if at >= image) - image for image in images]
    assert max(waits) < STEP
    assert min(gaps(frames)) >= slow.shortest_step - 1e-9


def test_between_images_that_come_seldom_such_a_line_gets_all_it_takes():
    slow = ControlLine("v2", shortest_step=0.025)
    _, frames, images = over_target(seconds=1.0, line=slow, image_every=1 / 15)
    assert len(images) > 8
    assert max(gaps(frames)) < 0.04


def test_a_line_that_takes_hardly_any_frames_holds_up_no_decision():
    drive = Driver(line=ControlLine("v2", shortest_step=1.0))
    drive.fly()
    began = drive.now
    drive.run(2.0)
    frames = [(at, action) for at, action in drive.done if isinstance(action, SendSticks)]
    first_level = next(at for at, frame in frames if frame.age > CFG.limiter.setpoint_ttl)
    assert first_level - began < CFG.limiter.setpoint_ttl + 2 * LONGEST_STEP
    assert drive.releases


def test_an_image_right_after_a_frame_waits_until_the_boards_can_take_the_next():
    _, frames, images = over_target(seconds=2.0, image_every=0.028)
    waits = [min(at for at in frames if at >= image) - image for image in images]
    assert max(waits) <= SHORTEST_STEP
    assert min(gaps(frames)) >= SHORTEST_STEP - 1e-9


def test_setpoints_bring_no_frame_forward_there():
    _, seldom, _ = over_target(seconds=1.0, setpoint_every=0.1)
    _, often, _ = over_target(seconds=1.0, setpoint_every=0.005)
    assert len(often) == pytest.approx(len(seldom), abs=3)


def test_without_images_it_flies_on_at_its_own_rate_and_its_deadline_holds():
    drive, _, _ = over_target(seconds=1.0)
    drive.done.clear()
    drive.run(CFG.limiter.setpoint_ttl - 0.02)
    frames = [at for at, action in drive.done if isinstance(action, SendSticks)]
    assert gaps(frames) == pytest.approx([1 / CFG.rate] * (len(frames) - 1), abs=STEP)
    drive.run(2.0)
    assert drive.releases


def test_a_flight_by_sticks_does_not_heed_images():
    drive = Driver()
    drive.fly()
    for _ in range(100):
        drive.core.feed(PoseSeen(pose(drive.now)), drive.now)
        drive.run(0.003)
        drive.put()
    frames = [at for at, action in drive.done if isinstance(action, SendSticks)]
    assert len(frames) / 0.3 < 1.3 * CFG.rate


@pytest.mark.parametrize(("apart", "ticks"), [(0.25, 12), (0.2501, None), (0.1, 5)])
def test_images_up_to_a_quarter_of_a_second_apart_have_a_rhythm(apart, ticks):
    pacing = Pacing(CFG)
    pacing.sends(is_flying=True, is_by_images=True)
    for captured in (1.0, 1.0 + apart):
        pacing.image_taken(captured, is_ours=True)
    pacing.tick(2.0)
    until_next = pacing.next_time(None, 0.0, 0.01) - 2.0
    last = apart - 0.01 - EARLY
    assert until_next == pytest.approx(1 / CFG.rate if ticks is None else last / ticks)
