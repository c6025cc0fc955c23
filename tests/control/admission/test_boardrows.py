"""Whether a dangerous request may be sent: every declared danger against what it must meet."""

from __future__ import annotations

from dataclasses import replace

import pytest

import mkdaemon.protocol.messages as messages
from mkdaemon.config.commands import CommandsConfig
from mkdaemon.control.admission.beginnings import BoardRequest, Procedure
from mkdaemon.control.admission.rows import refusal
from mkdaemon.control.admission.situation import Work
from mkdaemon.errors import CommandRejectedError
from mkdaemon.protocol.wire import MESSAGES, Board
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.danger import Confirm, Danger, Switch
from mkdaemon.telemetry.refusals import Token
from tests.control.admission.situations import GOOD

DANGEROUS = {cls.__name__: cls.spec.danger for cls in MESSAGES.values() if cls.spec.danger}


def check(
    danger: Danger,
    *,
    confirmed=True,
    switches=tuple(Switch),
    motors: bool | None = False,
    testing=False,
    unproven="",
):
    """Raise why a request of this danger is refused."""
    request = BoardRequest(
        board="fc",
        name="x",
        danger=danger,
        is_confirmed=confirmed,
        switches=frozenset(switches),
        unproven=unproven,
    )
    error = refusal(request, replace(GOOD, motors_running=motors, is_testing_motors=testing))
    if error is not None:
        raise error


def token_of(danger: Danger, **terms):
    with pytest.raises(CommandRejectedError) as caught:
        check(danger, **terms)
    assert "{" not in caught.value.reason + caught.value.fix
    assert "(detail)" not in caught.value.reason
    return caught.value.token


@pytest.mark.parametrize("name", sorted(DANGEROUS))
def test_every_declared_danger_refuses_for_its_reasons_and_passes_when_they_are_met(name):
    danger = DANGEROUS[name]
    if danger.never:
        assert token_of(danger) == Token.NEVER
        return
    check(danger)
    if danger.switch:
        assert token_of(danger, switches=()) == Token.NOT_ENABLED
    if danger.stopped:
        assert token_of(danger, motors=True) == Token.MOTORS_RUNNING
        assert token_of(danger, motors=None) == Token.MOTORS_UNKNOWN
    if danger.confirm is Confirm.ALWAYS:
        assert token_of(danger, confirmed=False) == Token.NOT_CONFIRMED
    if danger.confirm is Confirm.IN_FLIGHT:
        check(danger, confirmed=False)
        assert token_of(danger, confirmed=False, motors=True) == Token.NOT_CONFIRMED
        assert token_of(danger, confirmed=False, motors=None) == Token.NOT_CONFIRMED
        check(danger, motors=True)
    if danger.proven:
        with pytest.raises(CommandRejectedError, match=Token.BOARD_UNPROVEN):
            check(danger, unproven="nc answered it")


def test_the_refusals_come_in_this_order():
    danger = Danger(effect="x", confirm=Confirm.ALWAYS, stopped=True, switch=Switch.RESET)
    assert token_of(danger, confirmed=False, switches=(), motors=True) == Token.NOT_ENABLED
    assert token_of(danger, confirmed=False, motors=True) == Token.MOTORS_RUNNING
    assert token_of(danger, confirmed=False, motors=None) == Token.MOTORS_UNKNOWN
    assert token_of(danger, confirmed=False) == Token.NOT_CONFIRMED


def test_what_safety_forbids_in_flight_is_forbidden_whatever_the_configuration():
    """docs/safety.md: never t s m w j u and q 10..29 with motors running or unknown; R never in flight."""
    letters = {
        cls.spec.id
        for (board, _, _), cls in MESSAGES.items()
        if board is Board.FC and cls.spec.danger and (cls.spec.danger.stopped or cls.spec.danger.never)
    }
    assert set("tsmwjuqfR") <= letters
    reset = MESSAGES[Board.NC, "R", "1"].spec.danger
    assert reset is not None
    assert reset.stopped


@pytest.mark.parametrize(
    ("message", "is_dangerous"),
    [
        (messages.SettingsRequest(index=messages.ACTIVE_SET), False),
        (messages.SettingsRequest(index=1), True),
        (messages.DisplayRequest(keys_inverted=messages.ALL_KEYS_UP, interval=10), False),
        (messages.DisplayRequest(keys_inverted=0xFE), True),
        (messages.MotorTest(motors=(0,) * 16), False),
        (messages.MotorTest(motors=(0,) * 15 + (1,)), True),
        (messages.MotorTest4(motors=(0,) * 4), False),
    ],
    ids=repr,
)
def test_harmless_values_of_dangerous_requests_pass_freely(message, is_dangerous):
    danger = message.spec.danger
    assert danger is not None
    assert danger.applies(message.__dict__) is is_dangerous


def test_a_motor_test_may_go_on_although_it_turns_motors():
    test, write = DANGEROUS["MotorTest"], DANGEROUS["WriteMixer"]
    assert token_of(test, motors=True) == Token.MOTORS_RUNNING
    check(test, motors=True, testing=True)
    assert token_of(test, motors=None, testing=True) == Token.MOTORS_UNKNOWN
    assert token_of(write, motors=True, testing=True) == Token.MOTORS_RUNNING


def test_every_switch_is_a_field_of_the_configuration():
    assert {switch.value for switch in Switch} == set(CommandsConfig.model_fields)


@pytest.mark.parametrize(
    "wanted", [BoardRequest(board="fc", name="x", is_slow=True), Procedure(verb="x", is_alone=True)]
)
@pytest.mark.parametrize(
    ("phase", "leases", "said"),
    [
        (Phase.FREE, 0, None),
        (Phase.FREE, 1, "leased"),
        (Phase.LEASED, 0, "leased"),
        (Phase.FLYING, 0, "flying"),
        (Phase.RELEASING, 0, "releasing"),
    ],
)
def test_what_keeps_stick_frames_away_is_refused_with_the_phase_there_is(wanted, phase, leases, said):
    error = refusal(wanted, replace(GOOD, phase=phase, work=Work(leases=leases), motors_running=False))
    assert (error is None) is (said is None)
    assert error is None or (error.token == "flying" and said in error.reason)
