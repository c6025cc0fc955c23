"""How stories of the whole daemon are judged: by the bytes on the wire, and by what the daemon says."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest

from lab.control.wallfaults import SILENCE, STORIES, Told, sum_up
from lab.rigs.overtarget import Seen
from lab.rigs.troubled import Trouble, stand_still
from mkdaemon.protocol.messages import ExternControlV2

EVENT = 10.0


def told(*phases, ended=20.0, **changes):
    """A flight that leans, with a stick frame every 20 ms; `changes` by time: level, release, silent."""
    sticks, mode, at = [], "lean", 7.0
    while at < ended:
        mode = {round(since, 2): name for name, since in changes.items()}.get(round(at, 2), mode)
        if mode != "silent":
            pitch, config = (9 if mode == "lean" else 0), int(mode != "release")
            sticks.append((at, ExternControlV2(pitch=pitch, roll=0, yaw=0, throttle=0, frame=1, config=config)))
        at = round(at + 0.02, 2)
    tap = SimpleNamespace(sticks=lambda: sticks)
    seen = Seen(phases=["flying: x flies", *phases])
    return Told(SimpleNamespace(tap=tap, seen=seen), EVENT, ended)


def test_times_count_from_the_event():
    one = told(level=10.3, release=11.0)
    assert (one.level(), one.released()) == pytest.approx((0.3, 1.0))
    assert one.gap() == pytest.approx(0.02)


def test_one_level_frame_by_chance_is_not_level():
    one = told(level=10.1, lean=10.16, release=11.0)
    assert one.level() == pytest.approx(1.0)


def test_what_comes_after_the_story_does_not_count():
    assert told(release=15.0, ended=14.0).released() == math.inf


def test_a_story_holds_in_time_and_with_a_reason_only():
    story = STORIES["operator_frozen"]
    reason = "releasing: no setpoint from x for 1.00 s"
    assert sum_up(story, [told(reason, level=10.3, release=11.0)])["broken"] == []
    assert sum_up(story, [told(reason, level=10.6, release=11.0)])["broken"] == ["level in time"]
    assert sum_up(story, [told(reason, level=10.3, release=12.0)])["broken"] == ["released in time"]
    assert sum_up(story, [told(level=10.3, release=11.0)])["broken"] == ["said"]


def test_silence_breaks_every_story():
    reason = "releasing: no setpoint from x for 1.00 s"
    silent = told(reason, silent=10.06, level=10.06 + SILENCE + 0.05, release=11.0)
    assert "no silence" in sum_up(STORIES["operator_frozen"], [silent])["broken"]


@pytest.mark.parametrize("which", list(Trouble))
def test_what_is_made_to_stand_still_is_there(which):
    owner, name, act = stand_still(which)
    assert callable(getattr(owner, name))
    assert callable(act)
