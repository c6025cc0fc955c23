"""What bytes on the wire begin and end with."""

from __future__ import annotations

import pytest

from lab.rigs.sticks import first_words, last_words, steering
from mkdaemon.protocol.messages import ExternControlV1, ExternControlV2, ExternControlV3, VersionRequest

TILT = ExternControlV2(pitch=20, roll=0, yaw=0, throttle=0, frame=3, config=1).to_frame()
FREE = ExternControlV2(pitch=0, roll=0, yaw=0, throttle=0, frame=4).to_frame()


@pytest.mark.parametrize("layout", [ExternControlV1, ExternControlV2, ExternControlV3])
def test_first_words_know_a_release_in_every_layout(layout):
    free = layout(pitch=0, roll=0, yaw=0, throttle=0, frame=200)
    steer = free.model_copy(update={"config": 1})
    assert first_words(b"\r\r" + free.to_frame()) == "release"
    assert first_words(steer.to_frame()) == "sticks"
    assert first_words(layout(pitch=1, roll=0, yaw=0, throttle=0).to_frame()) == "sticks"


def test_first_and_last_words_of_other_bytes():
    version = VersionRequest().to_frame()
    assert first_words(version + FREE) == "v"
    assert last_words(version + FREE) == "release"
    assert last_words(FREE + version) == "v"
    assert first_words(b"") == last_words(b"") == "nothing"
    assert steering(FREE + TILT + version + TILT) == 2
