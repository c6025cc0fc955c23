"""When the flight core ticks while it flies by images: at once after one, else at its own rate."""

from __future__ import annotations

import itertools

import pytest

from mkdaemon.control.actions import SendSticks
from mkdaemon.control.events import PoseSeen
from mkdaemon.control.output import SHORTEST_STEP
from mkdaemon.control.pacing import Pacing
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
            drive.send(PositionSetpoint, position=(0.0, 0.0, 2.0), frame=SetpointFrame.PAD)
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


@pytest.mark.parametrize("step", [0.01, 0.025])
def test_an_image_early_or_late_by_3_ms_is_answered_at_once(step):
    line = ControlLine("v2", shortest_step=step)
    _, frames, images = over_target(seconds=1.0, line=line, late=0.003)
    waits = [min(at for at in frames if at >= image) - image for image in images]
    assert len(images) > 15
    assert max(waits) <= STEP
    assert max(gaps(frames)) <= max(1 / CFG.rate, IMAGE + 0.007) + 2 * STEP


def test_an_image_right_after_a_frame_waits_until_the_boards_can_take_the_next():
    _, frames, images = over_target(seconds=2.0, image_every=0.028)
    waits = [min(at for at in frames if at >= image) - image for image in images]
    assert max(waits) <= SHORTEST_STEP
    assert min(gaps(frames)) >= SHORTEST_STEP - 1e-9


def test_setpoints_bring_no_frame_forward_there():
    _, seldom, _ = over_target(seconds=0.5, setpoint_every=0.1)
    _, often, _ = over_target(seconds=0.5, setpoint_every=0.005)
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


def by_images(apart, step=SHORTEST_STEP, images=3):
    """Ticks after the last of some images that were answered at once."""
    pacing = Pacing(CFG)
    pacing.sends(is_flying=True, is_by_images=True)
    at = 0.0
    for k in range(images):
        at = k * apart
        assert pacing.image_taken(at, is_ours=True)
        pacing.tick(at)
    ticks = []
    for _ in range(6):
        ticks.append(pacing.next_time(None, at, step))
        pacing.tick(ticks[-1])
    return [tick - at for tick in ticks]


@pytest.mark.parametrize(
    ("apart", "step", "expected"),
    [
        # The last of `between` ticks leaves room for the boards and for an image 3 ms early; the next one waits.
        (1 / 15, 0.01, [0.01789, 0.03578, 0.05367, 0.07367, 0.09367]),
        (1 / 30, 0.01, [0.02, 0.04033, 0.06033]),
        (1 / 15, 1 / 44, [0.03182, 0.07276, 0.09276]),  # 30 a second: one more would hold up the next image
        (1 / 20, 1 / 44, [0.02427, 0.05609]),
        (1 / 50, 0.01, [0.027, 0.047, 0.067]),
        (1 / 4.2, 0.025, [0.035, 0.07, 0.105, 0.14, 0.175, 0.21]),
        (1 / 3.9, 0.01, [0.02, 0.04]),  # too far apart for a rhythm
        (0.0, 0.025, [0.02, 0.04]),  # two of one moment have none
    ],
)
def test_ticks_between_images_keep_the_rate_and_leave_the_next_image_room(apart, step, expected):
    assert by_images(apart, step)[: len(expected)] == pytest.approx(expected, abs=3e-4)


def test_the_first_image_has_no_rhythm_yet():
    assert by_images(1 / 15, images=1)[:2] == pytest.approx([0.02, 0.04])


def test_images_of_another_target_and_those_of_a_flight_by_hand_are_not_answered():
    pacing = Pacing(CFG)
    assert not pacing.image_taken(0.0, is_ours=True)
    pacing.sends(is_flying=True, is_by_images=True)
    assert not pacing.image_taken(0.1, is_ours=False)
    pacing.tick(0.1)
    assert not pacing.answers_image
    assert pacing.image_taken(0.2, is_ours=True)
    pacing.tick(0.2)
    assert pacing.answers_image
    pacing.tick(0.3)
    assert not pacing.answers_image
    pacing.sends(is_flying=False, is_by_images=True)
    assert not pacing.image_taken(0.4, is_ours=True)


def test_while_nobody_flies_the_core_looks_ten_times_a_second_and_at_once_after_news():
    pacing = Pacing(CFG)
    assert pacing.tick(5.0) == float("inf")
    assert pacing.next_time(None, 0.0, 0.01) == pytest.approx(5.1)
    assert pacing.next_time(5.05, 0.0, 0.01) == pytest.approx(5.0502)
    pacing.hurry()
    assert pacing.next_time(None, 9.0, 0.01) == 5.0
    assert pacing.tick(5.3) == pytest.approx(0.3)


def test_in_flight_a_repetition_waits_half_a_period_longer_than_a_client_and_for_the_boards():
    pacing = Pacing(CFG)
    pacing.sends(is_flying=True, is_by_images=False)
    pacing.tick(5.0)
    assert pacing.next_time(None, 0.0, 0.01) == pytest.approx(5.03)
    assert pacing.next_time(None, 5.04, 0.01) == pytest.approx(5.04)
    assert pacing.next_time(5.035, 0.0, 0.01) == pytest.approx(5.0352), "left out shortly before a deadline"
    assert pacing.next_time(5.045, 0.0, 0.01) == pytest.approx(5.03)
    pacing.hurry()
    assert pacing.next_time(None, 5.01, 0.01) == pytest.approx(5.01)


def test_the_first_tick_is_due_at_once():
    pacing = Pacing(CFG)
    assert pacing.next_time(None, 0.0, 0.01) == float("-inf")
    assert not (pacing.is_paced or pacing.is_by_images or pacing.answers_image)
    pacing.tick(1.0)
    assert not pacing.answers_image
