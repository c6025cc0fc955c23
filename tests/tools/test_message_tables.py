"""Whoever searches docs/troubles.md for a printed message finds its row: no table of messages is left out."""

from __future__ import annotations

import re
import string

import pytest

from mkdaemon.link.session import verdict
from mkdaemon.telemetry.link import LinkCondition
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.vision import Alarm
from mkdaemon.vision.pipeline import ALARM_ADVICE
from tests.places import DOCS, ROOT
from tools.docs import make_page
from tools.message_tables import messages, verdict_reasons

PAGE = (DOCS / "troubles.md").read_text(encoding="utf-8")


def is_found(printed):
    """Whether a row of the page begins with a printed message, whatever its words in braces are filled with."""
    for row in re.findall(r"^\| (.*?) \|", PAGE, re.MULTILINE):
        parts = string.Formatter().parse(row)
        if re.fullmatch(
            "".join(re.escape(fixed) + ("" if name is None else ".+?") for fixed, name, *_ in parts), printed
        ):
            return True
    return False


def words_of(token):
    return {name for _, name, _, _ in string.Formatter().parse(token.reason + token.fix) if name}


@pytest.mark.parametrize("token", list(Token))
def test_a_printed_refusal_is_found(token):
    refusal = refuse(token, **dict.fromkeys(words_of(token), 7))
    assert is_found(f"{refusal.token}: {refusal.reason}")


@pytest.mark.parametrize("condition", list(LinkCondition))
def test_a_state_of_the_line_is_found(condition):
    assert is_found(f"link {condition.value}")


def test_the_reasons_of_a_state_are_found():
    numbers = {name: 7 for reason in verdict_reasons() for _, name, _, _ in string.Formatter().parse(reason) if name}
    reasons = [reason.format_map(numbers) for reason in verdict_reasons()]
    assert verdict.comes_and_goes(7, 7.0) in reasons
    assert [reason for reason in reasons if not is_found(reason.partition(": ")[0])] == []


@pytest.mark.parametrize("alarm", list(Alarm))
def test_an_alarm_of_a_camera_is_found(alarm):
    assert is_found(ALARM_ADVICE.get(alarm, f"camera alarm {alarm.value}").partition(": ")[0])


def test_the_search_of_the_site_finds_a_message_with_its_numbers():
    """It finds a part of a page that has all words; a number before a unit or a noun is none."""
    [separator] = re.findall(r"^ +separator: '(.*)'$", (ROOT / "mkdocs.yml").read_text(encoding="utf-8"), re.MULTILINE)
    parts = [
        {word.lower() for word in re.split(separator, part)} for part in re.split("^#+ ", PAGE, flags=re.MULTILINE)
    ]
    for printed in (
        "mkctl: battery_low: the battery is low: 11.3 V. Land and change the battery.",
        "holds the lease for another 5.0 s. Ask the holder, or take it with `--force`.",
        "no pose for 1.2 s",
        "this program did not run for 0.7 s",
        "tag in view, 4 poses refused",
        "disk_full: 12 MB are free for recordings, less than 200 MB.",
    ):
        wanted = {word.lower() for word in re.split(separator, printed)}
        assert any(wanted <= words for words in parts), printed


def test_another_message_is_not_found():
    assert not is_found("lease_held: bob holds")
    assert not is_found("the aircraft is on fire")


def test_the_page_is_ordered_by_what_is_printed():
    printed = [message.printed for message in messages()]
    assert printed == sorted(printed, key=lambda words: re.sub(r"\W+", " ", words).casefold())
    assert make_page("docs/troubles.md", ROOT) == PAGE
