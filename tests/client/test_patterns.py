"""Patterns that no key can match."""

from __future__ import annotations

import pytest

from mkdaemon.client.patterns import is_known, known_keys, require_known
from mkdaemon.errors import MkError


@pytest.mark.parametrize(
    "pattern",
    ["state/attitude", "state/*", "**", "*", "*/status", "rx/nc/osd", "rx/*/osd", "tx/any/*", "rx/fc/unknown",
     "vision/down/pose", "vision/*/stats", "setpoint/stick", "event/mission", "health", "tf"],
)  # fmt: skip
def test_patterns_of_keys_that_exist_are_known(pattern):
    require_known(pattern)


@pytest.mark.parametrize(
    ("pattern", "nearest"),
    [
        ("state/atitude", "state/attitude"),
        ("state/attitude/*", "state/attitude"),
        ("rx/nc/ods", "rx/nc/osd"),
        ("rx/fc/osd", "rx/nc/osd"),
        ("control/staus", "control/status"),
        ("vision/down/poses", "vision/*/pose"),
    ],
)
def test_a_misspelt_pattern_names_the_nearest_key(pattern, nearest):
    with pytest.raises(MkError, match=r"^no key matches") as told:
        require_known(pattern)
    assert f"did you mean {nearest}" in str(told.value)


@pytest.mark.parametrize(
    ("pattern", "words"),
    [
        ("attitude", "did you mean state/attitude, setpoint/attitude or rx/fc/attitude?"),
        ("osd", "did you mean rx/nc/osd, "),
        ("stat/**", "did you mean state/**?"),
        ("state/nope/*", "did you mean state/gps or "),
        ("nope", "keys begin with raw, state, link, "),
    ],
)
def test_what_is_no_key_is_told_what_keys_there_are(pattern, words):
    with pytest.raises(MkError) as told:
        require_known(pattern)
    assert words in str(told.value)


@pytest.mark.parametrize("pattern", ["do/lease", "cmd/fc/version_request", "schema/Attitude.v1", "alive", "xyzzy"])
def test_what_is_asked_and_never_published_is_no_key_to_watch(pattern):
    assert not is_known(pattern)


def test_frames_are_known_by_board_and_message():
    known = known_keys()
    assert {"rx/nc/osd", "rx/fc/attitude", "tx/fc/settings_request", "rx/other/unknown"} <= set(known)
    assert len(known) == len(set(known))
