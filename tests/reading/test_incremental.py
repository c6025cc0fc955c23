"""A picture that is made of what has changed is the one that is made from nothing."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mkdaemon.reading import Reading
from mkdaemon.reading.diagnoses import diagnoses_of
from tests.reading.knownflight import KNOWN
from tests.reading.situations import SITUATIONS

VALUES = sorted(
    {(key, value.model_dump_json()): (key, value) for one in SITUATIONS for key, value in one.values.items()}.items()
)
"""Every value that differs between any two situations."""
CAMERAS = ("down", "front")


@st.composite
def steps(draw):
    """Values and looks in any order, at times of any order, near the limits of what is fresh and far from them."""
    now, found = 1000.0, []
    for _ in range(draw(st.integers(1, 16))):
        now += draw(st.sampled_from([-3.0, -0.3, 0.0, 1e-9, 0.05, 0.3, 0.5, 1.0, 3.0, 3.0000001, 10.0]))
        if draw(st.booleans()):
            found.append((now, None, None))
            continue
        key, value = draw(st.sampled_from(VALUES))[1]
        found.append((now, key.replace("/down/", f"/{draw(st.sampled_from(CAMERAS))}/"), value))
    return [*found, (now, None, None)]


def content(picture):
    """Everything that a picture says; its parts in another order than they are looked at by `diagnoses_of`."""
    parts = list(diagnoses_of(picture))
    return picture.alarms, picture.headline, picture.tone, picture.offers, picture.causes, parts, picture.facts


@settings(max_examples=100, deadline=None)
@given(steps())
def test_any_order_of_values_and_times_gives_the_picture_that_is_made_from_nothing(steps):
    reading, taken, pictures = Reading(), [], []
    for now, key, value in steps:
        if key is not None:
            reading.take(key, value, now)
            taken.append((key, value, now))
            continue
        afresh = Reading()
        for one in taken:
            afresh.take(*one)
        expected = content(afresh.at(now))
        assert content(reading.at(now)) == expected
        pictures.append((reading.at(now), expected))
    for picture, expected in pictures:  # a picture stays as it was, whatever came after it
        assert content(picture) == expected


def looked(reading, now, look):
    """How often a look is made for pictures at some moments."""
    count = 0

    def counted(known):
        nonlocal count
        count += 1
        return look(known)

    for moment in now:
        reading.at(moment).remembered(f"counted {id(look)}", counted)
    return count


def reading_of(at=1000.0, **changes):
    reading = Reading()
    for key, value in (KNOWN | changes).items():
        reading.take(key, value, at)
    return reading


LOOKS = {
    "value": lambda known: known.last("state/battery", object),
    "fresh": lambda known: known.fresh("health", object),
    "cameras": lambda known: known.cameras(),
    "silence": lambda known: known.is_silent,
    "limit": lambda known: known.is_over(1002.0),
    "age": lambda known: known.age(known.last("health", object)),
}


@pytest.mark.parametrize(
    ("look", "times"), [("value", 1), ("fresh", 2), ("cameras", 1), ("silence", 2), ("limit", 2), ("age", 5)]
)
def test_a_look_is_made_again_only_where_what_it_read_has_changed(look, times):
    assert looked(reading_of(), (1000.0, 1001.0, 1002.0, 1003.5, 1009.0), LOOKS[look]) == times
