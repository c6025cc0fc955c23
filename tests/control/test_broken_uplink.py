"""An uplink that breaks for half a second: the aircraft obeys its last sticks, and is flown on with the next ones."""

from __future__ import annotations

import math

import numpy as np

from lab.control.camera import CameraModel
from lab.control.flights import Flight
from mkdaemon.control.actions import PublishStatus, ReleaseAircraft
from mkdaemon.control.answers import PAUSE, AnswerWatch
from mkdaemon.control.estimator.model import AircraftModel
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.setpoint import PositionSetpoint, SetpointFrame
from mksim.config import WindClass
from tests.control.confirmingboard import ConfirmingBoard
from tests.control.coreflights import Told

STEP = 6.0
"""The client asks for a place 1 m away, and the uplink breaks [s]."""


class Stepping(ConfirmingBoard, Told):
    """A client holds a place beside the target, then asks for one on its other side."""

    farthest = 0.0

    def __init__(self, flight):
        super().__init__(flight)
        self.beside = []

    def _setpoint(self, goal, at):
        east = -0.5 if at < STEP else 0.5
        return PositionSetpoint(
            epoch=self._epoch, sequence=self._sequence, ttl=0.3, position=(east, 0.0, 2.0), frame=SetpointFrame.PAD
        )

    def _control(self, at):
        super()._control(at)
        if at > STEP:
            self.farthest = max(self.farthest, float(np.hypot(*self._place(at)[:2])))
        if STEP < at < STEP + 1.5 and self.estimates:
            self.beside.append(math.dist(self.estimates[-1].position[:2], self._place(at)[:2]))

    def phases(self):
        return {action.phase for _, action in self.of(PublishStatus)}


def stepping(seed):
    """A flight that goes on for a while after the step."""
    camera = CameraModel(rate=15.0)
    return Stepping(Flight(seed=seed, wind=WindClass.LIGHT, seconds=STEP + 3.5, start=1.9, camera=camera))


def test_sticks_that_did_not_arrive_are_not_believed_to_act():
    """The uplink breaks in the middle of a step: the last tilt acts on for 0.7 s, and our counter-tilt does not.

    With the lost frames believed to act, the estimate was 0.7 to 2.5 m beside the truth, and the first frames that
    arrived again tilted further away: 5 of 5 aircraft were lost.
    """
    rig = stepping(5)
    rig.broken = (STEP + 0.15, STEP + 0.85)
    record = rig.fly()
    assert record.lost == ""
    assert not rig.of(ReleaseAircraft)
    assert Phase.UNANSWERED not in rig.phases(), "it is no aircraft that does not obey"
    assert max(rig.beside) < 0.4


def test_an_uplink_that_heals_while_the_downlink_is_silent_gets_no_correction_twice():
    """Nothing shows for 0.4 s that frames arrive again: those whose confirmation is not due yet are taken to act.

    With all of them taken as lost, each frame asked for the whole correction again, and the aircraft carried all of
    it out: it tilted by 20 to 40 degrees, and went 1 to 10 m aside of a place that it held, or stepped to.
    """
    rig = stepping(2)
    breaks = STEP + 0.4
    rig.broken, rig.silent = (breaks, breaks + 0.32), (breaks + 0.32, breaks + 0.72)
    record = rig.fly()
    assert record.lost == ""
    assert not rig.of(ReleaseAircraft)
    assert rig.farthest < 1.2


def cut_line(*, silent_from=math.inf):
    """A watch that has got no confirmation since 1.0 s; it gets reports until the downlink falls silent, too."""
    watch = AnswerWatch(AircraftModel())
    for number in range(1, 101):
        at = 0.02 * number
        watch.sent(0.0, 0.0, at)
        watch.frame_written(number, at)
        if at <= 1.0:
            watch.frame_confirmed(number, at + 0.06)
        if not silent_from <= at < silent_from + 0.4:
            watch.attitude_received(at - AircraftModel().attitude_age, 0.0, 0.0, says_something=True)
    return watch


def test_a_frame_is_lost_once_reports_came_when_its_confirmation_was_due():
    watch = cut_line()
    assert watch.is_cut
    assert [at for at in (1.1, 1.5, 1.93, 1.95, 2.0) if watch.has_lost(at)] == [1.1, 1.5, 1.93]


def test_of_frames_whose_confirmations_were_due_in_a_silence_nothing_is_known():
    watch = cut_line(silent_from=1.4)
    assert watch.is_cut
    assert [at for at in (1.1, 1.3, 1.4, 1.7, 1.85) if watch.has_lost(at)] == [1.1, 1.3, 1.85]


def test_a_confirmation_ends_what_was_lost_before_it():
    watch = cut_line()
    watch.frame_confirmed(100, 2.06)
    assert not watch.is_cut
    assert not watch.has_lost(1.5)


def unmoved(confirmed):
    """A watch of sticks that swing for 3 s and tilt nothing; frames are confirmed up to a number."""
    watch = AnswerWatch(AircraftModel())
    for number in range(1, 151):
        at = 0.02 * number
        watch.sent(30.0 * math.sin(4.0 * at), 0.0, at)
        watch.frame_written(number, at)
        if number < confirmed:
            watch.frame_confirmed(number, at + 0.01)
        watch.attitude_received(at - 0.04, 0.0, 0.0, says_something=True)
    return watch


def test_confirmed_frames_that_tilt_nothing_are_unanswered_and_others_are_lost():
    assert unmoved(151).is_missing
    assert not unmoved(20).is_missing


def test_the_first_frame_that_is_confirmed_after_a_break_ends_what_was_found():
    watch = unmoved(20)
    watch.is_missing = True
    assert watch.missing_words(3.0)
    watch.frame_confirmed(150, 3.0 + PAUSE)
    assert not watch.missing_words(3.0 + PAUSE)
