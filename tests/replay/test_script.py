"""What was seen on the clock goes to who saw it, and what came in comes in between."""

from __future__ import annotations

from mkdaemon.record.entry import Entry, Kind, TimeBase
from mkdaemon.record.looks import Look
from mkdaemon.replay.script import Moment, Script

BASE = TimeBase("", 0)


def arriving(place, kind=Kind.PORT_READ):
    return Moment(float(place), Entry(kind, "mk/t/port", b"", "", float(place), 0.0, BASE, 1), place)


def looks(actors):
    return [Look(actor, 10.0 + place) for place, actor in enumerate(actors)]


def test_everybody_sees_what_he_saw_in_his_order():
    script = Script(looks("abab"))
    assert [script.take_look("b"), script.take_look("a"), script.take_look("a")] == [11.0, 10.0, 12.0]
    assert script.next_look == Look("b", 13.0)
    assert script.next_of("a") is None
    assert script.take_look("a") is None
    assert script.take_look("b") == 13.0
    assert script.next_look is None


def test_nobody_sees_what_came_after_an_input_that_has_not_come():
    script = Script(looks("aa"), [arriving(1)])
    assert script.next_input is None
    assert script.take_look("a") == 10.0
    assert script.take_look("a") is None
    assert script.next_input is not None
    assert script.take_input().at == 1.0
    assert script.take_look("a") == 11.0
    assert script.next_input is None


def test_who_looks_less_often_is_in_step_again():
    script = Script(looks("aab"))
    script.skip_look()
    script.skip_look()
    assert script.next_look == Look("b", 12.0)


def test_what_waits_in_the_port_changes_between_two_looks():
    script = Script(looks("aaa"), backlogs=[(1, 40), (2, 0)])
    waiting = [script.backlog]
    for _ in range(3):
        script.take_look("a")
        waiting.append(script.backlog)
    assert waiting == [0, 40, 0, 0]


def test_what_comes_in_before_somebody_looks_again_is_known():
    script = Script(looks("ab"), [arriving(0), arriving(1, Kind.PORT_OPENED)])
    assert script.brings(Kind.PORT_OPENED, before="b")
    assert not script.brings(Kind.PORT_OPENED, before="a")
    assert not script.brings(Kind.QUERY, before="b")
    assert not Script(looks("b")).brings(Kind.PORT_OPENED, before="b")


def test_what_came_in_while_somebody_was_at_work_follows_his_look():
    script = Script(looks("ab"), [arriving(1)])
    assert script.comes_next() is None
    script.take_look("a")
    assert script.comes_next() is not None
    assert Script(looks("a")).comes_next() is None
