"""When the flight core ticks while it flies by images: at once after one, else at its own rate."""

from __future__ import annotations

import itertools

import pytest

from mkdaemon.control.actions import SendSticks
from mkdaemon.control.output import SHORTEST_STEP
from mkdaemon.telemetry.setpoint import PositionSetpoint, SetpointFrame
from tests.control.events import CFG, PERIOD, Driver, pose

IMAGE = 1 / 30
STEP = 0.001


def over_target(*, seconds, image_every=IMAGE, setpoint_every=PERIOD):
    """A flight by position of an aircraft that stands still over its target; it, and when images came in flight."""
    drive, images, next_image, next_setpoint = Driver(), [], 0.0, 0.0
    drive.take()
    end = seconds
    while drive.now < end:
        if drive.now >= next_image:
            drive.core.pose_received(pose(drive.now))
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
    assert max(gaps(frames)) == pytest.approx(1 / CFG.rate, abs=STEP)
    assert min(gaps(frames)) >= SHORTEST_STEP - 1e-9


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
        drive.core.pose_received(pose(drive.now))
        drive.run(0.003)
        drive.put()
    frames = [at for at, action in drive.done if isinstance(action, SendSticks)]
    assert len(frames) / 0.3 < 1.3 * CFG.rate
