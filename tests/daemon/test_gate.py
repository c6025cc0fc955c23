"""Which requests are dangerous and what they must show: the table against the messages, then every refusal."""

from __future__ import annotations

import re

import pytest

import mkdaemon.protocol.messages as messages
from mkdaemon.config.commands import CommandsConfig
from mkdaemon.daemon.gate import RULES, check, rule_for
from mkdaemon.daemon.vitals import MOTORS_AGE, PROOF_AGE, TEST_LASTS, Vitals
from mkdaemon.errors import CommandRejectedError
from mkdaemon.protocol.wire import MESSAGES, Board, Direction
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.command import REFUSALS, Status, refuse
from mkdaemon.telemetry.link import LinkCondition, LinkState
from tests.places import SOURCE

ALL_ON = CommandsConfig(**dict.fromkeys(CommandsConfig.model_fields, True))

REQUESTS = {}
for (_owner, _, _), _cls in MESSAGES.items():
    if _cls.spec.direction is Direction.TO_BOARD:
        REQUESTS.setdefault((_owner, _cls.spec.key), _cls)
MINIMAL = {
    "motor_test": {"motors": [30] + [0] * 15},
    "settings_request": {"index": 2},
    "display_request": {"keys_inverted": 0xFE, "interval": 0},
    "motor_controller_request": {"motor": 1},
    "select_settings": {"index": 2},
    "redirect": {"port": 0},
    "compass_heading": {"heading": 90},
    "serial_channels": {"channels": [0] * 12},
    "receiver_bridge": {"mode": 1},
    "settings_reset": {"index": 11},
    "beep": {"duration": 1, "count": 1},
    "recalibrate": {"what": 1},
    "write_navi_parameter": {"id": 0, "value": 1},
}


def request_for(board, key):
    """A request of this kind that declares its danger."""
    cls = REQUESTS[(board, key)]
    fields = MINIMAL.get(key)
    if fields is not None:
        return cls.model_validate(fields)
    return cls.decode(bytes(cls.spec.size))


def vitals(motors=None, at=100.0):
    known = Vitals("")
    if motors is not None:
        known.motors_said(motors, at)
    return known


def judge(board, key, *, confirmed=True, cfg=ALL_ON, motors=False, now=100.0):
    message = request_for(board, key)
    rule = rule_for(board, message)
    assert rule is not None
    check(board, message, rule, confirmed=confirmed, cfg=cfg, vitals=vitals(motors), now=now)


def token_of(*args, **kwargs):
    with pytest.raises(CommandRejectedError) as caught:
        judge(*args, **kwargs)
    assert caught.value.reason
    assert caught.value.fix
    assert "{" not in caught.value.reason + caught.value.fix
    assert "(detail)" not in caught.value.reason
    return caught.value.token


def test_every_message_that_declares_a_danger_has_a_rule_and_no_rule_is_without_message():
    dangerous = {place for place, cls in REQUESTS.items() if cls.spec.danger}
    assert dangerous - set(RULES) == set()
    assert set(RULES) - set(REQUESTS) == set()


@pytest.mark.parametrize(("board", "key"), sorted(RULES), ids=lambda value: getattr(value, "word", value))
def test_every_rule_refuses_for_its_reasons_and_passes_when_they_are_met(board, key):
    rule = RULES[(board, key)]
    if rule.never:
        assert token_of(board, key) == "never"
        return
    judge(board, key)
    if rule.option:
        assert token_of(board, key, cfg=CommandsConfig()) == "not_enabled"
    if rule.stopped:
        assert token_of(board, key, motors=True) == "motors_running"
        assert token_of(board, key, motors=None) == "motors_unknown"
        assert token_of(board, key, now=100.0 + MOTORS_AGE + 0.01) == "motors_unknown"
    if rule.confirm:
        assert token_of(board, key, confirmed=False) == "not_confirmed"
    if rule.confirm_in_flight:
        judge(board, key, confirmed=False)
        assert token_of(board, key, confirmed=False, motors=True) == "not_confirmed"
        assert token_of(board, key, confirmed=False, motors=None) == "not_confirmed"
        judge(board, key, motors=True)


def test_what_safety_forbids_in_flight_is_forbidden_whatever_the_configuration():
    """docs/safety.md: never t s m w j u and q 10..29 with motors running or unknown; R never in flight."""
    letters = {
        cls.spec.id
        for place, cls in REQUESTS.items()
        if place[0] is Board.FC and place in RULES and (RULES[place].stopped or RULES[place].never)
    }
    assert set("tsmwjuqfR") <= letters
    assert RULES[(Board.NC, "reset")].stopped


def test_harmless_forms_of_dangerous_requests_pass_freely():
    settings = messages.SettingsRequest(index=0xFF)
    assert rule_for(Board.FC, settings) is None
    assert rule_for(Board.NC, messages.DisplayRequest(keys_inverted=0xFF, interval=10)) is None
    assert rule_for(Board.NC, messages.EchoRequest(pattern=1)) is None
    assert rule_for(Board.FC, messages.MotorTest(motors=(0,) * 16)) is None, "it stops a test"


def test_a_motor_test_may_go_on_although_it_turns_motors():
    message = request_for(Board.FC, "motor_test")
    known = vitals(motors=True)
    terms = {"confirmed": True, "cfg": ALL_ON, "vitals": known}
    with pytest.raises(CommandRejectedError, match="motors_running"):
        check(Board.FC, message, RULES[(Board.FC, "motor_test")], now=100.0, **terms)
    known.motor_test_sent(99.5)
    check(Board.FC, message, RULES[(Board.FC, "motor_test")], now=100.0, **terms)
    with pytest.raises(CommandRejectedError, match="motors_running"):
        check(Board.FC, message, RULES[(Board.FC, "motor_test")], now=99.5 + TEST_LASTS + 0.1, **terms)
    with pytest.raises(CommandRejectedError, match="motors_running"):
        write = request_for(Board.FC, "write_mixer")
        check(Board.FC, write, RULES[(Board.FC, "write_mixer")], now=100.0, **terms)


# -- what the gate asks --------------------------------------------------------------------------------------------


STAMP = Stamp(monotonic=5.0, wall=6.0)


def link_state(openings=1, redirected_to="", condition=LinkCondition.UP):
    return LinkState(
        condition=condition, reason="", since=STAMP, stamp=STAMP, port="x", baud=57600, hears_board=True,
        board_hears_us=True, openings=openings, redirected_to=redirected_to,
    )  # fmt: skip


def test_a_version_reply_proves_a_board_until_it_is_old_or_the_line_has_changed():
    known = vitals()
    known.link_said(link_state())
    assert not known.is_proven(Board.FC, 0.0)
    assert known.last_named() == "no board answered one"
    known.version_said(Board.FC, "2.12a", 10.0)
    assert known.is_proven(Board.FC, 10.0 + PROOF_AGE)
    assert not known.is_proven(Board.FC, 10.0 + PROOF_AGE + 0.01)
    assert not known.is_proven(Board.NC, 10.0)
    assert known.last_named() == "fc answered it"
    known.link_said(link_state(condition=LinkCondition.DEGRADED))
    assert known.is_proven(Board.FC, 10.0)
    known.link_said(link_state(redirected_to="fc"))
    assert not known.is_proven(Board.FC, 10.0)
    known.version_said(Board.FC, "2.12a", 11.0)
    known.link_said(link_state(openings=2, redirected_to="fc"))
    assert not known.is_proven(Board.FC, 11.0)


def test_vehicle_alive_is_not_daemon_alive():
    known = Vitals("a note")
    silent = known.health(STAMP, read_only="unknown firmware")
    assert (silent.is_alive, silent.link, silent.read_only) == (False, "absent", "unknown firmware")
    for condition, alive in ((LinkCondition.UP, True), (LinkCondition.ONE_WAY, True), (LinkCondition.MUTE, False)):
        known.link_said(link_state(condition=condition))
        assert known.health(STAMP, read_only=None).is_alive is alive


# -- refusals ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("token", sorted(REFUSALS))
def test_every_refusal_says_why_and_what_to_do(token):
    words = set(re.findall(r"{(\w+)", REFUSALS[token].reason + REFUSALS[token].fix))
    numbers = {"left": 1.0}
    error = refuse(token, **{word: numbers.get(word, f"<{word}>") for word in words})
    assert error.token == token
    assert all(f"<{word}>" in error.reason + error.fix for word in words - set(numbers))
    assert error.reason.endswith(".")
    assert error.fix.strip().endswith((".", ">"))
    assert REFUSALS[token].status not in {Status.ACCEPTED, Status.NOT_OBSERVABLE}


def test_every_token_used_by_the_daemon_and_the_link_is_in_the_table():
    used = set()
    for part in ("daemon", "control", "bus", "link"):
        for source in (SOURCE / part).rglob("*.py"):
            text = source.read_text(encoding="utf-8")
            used |= set(re.findall(r"(?:refuse|CommandRejectedError)\(\s*\"(\w+)\"", text))
    assert used - set(REFUSALS) == set()
    assert {"lease_held", "line_budget", "not_confirmed"} <= used


def test_a_refusal_never_fails_for_a_missing_word():
    assert "(detail)" in refuse("busy").reason
    with pytest.raises(KeyError):
        refuse("no_such_token")
