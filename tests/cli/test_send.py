"""Requests on the command line: what is typed for a message and for a verb, and what is sent."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import pytest

from mkdaemon.cli.mkctl import verbforms
from mkdaemon.cli.mkctl.board_request import find_board
from mkdaemon.cli.mkctl.connection import Connection
from mkdaemon.cli.mkctl.send import describe_reply, request_forms
from mkdaemon.client import Vehicle
from mkdaemon.errors import CommandRejectedError, ConfigError
from mkdaemon.protocol.flags import MotorControllerItems
from mkdaemon.protocol.messages import ErrorText, MotorController, Settings
from mkdaemon.protocol.wire import Board
from mkdaemon.telemetry.verbs import VERBS
from tests.client.fake import VEHICLE, fake_daemon

FORMS = request_forms()


@pytest.mark.parametrize(
    ("form", "heard", "board"),
    [
        ("menu_request", ("fc", "nc"), Board.NC),
        ("label_request", ("nc",), Board.NC),
        ("display_request", ("fc",), Board.FC),
        ("display_request", None, Board.FC),
        ("motor_test", ("fc", "nc"), Board.FC),
    ],
)
async def test_the_board_at_the_end_of_the_line_is_asked_by_default(form, heard, board) -> None:
    async def latest() -> SimpleNamespace | None:
        return None if heard is None else SimpleNamespace(value=SimpleNamespace(boards=heard))

    client = SimpleNamespace(link=SimpleNamespace(state=SimpleNamespace(latest=latest)))
    assert await find_board(cast("Vehicle", client), FORMS[form].boards) is board


@pytest.mark.parametrize(
    ("key", "field", "text", "value"),
    [
        ("extern_control", "config", "valid,throttle_add", 3),
        ("extern_control", "config", "valid", 1),
        ("extern_control", "config", "0x81", 0x81),
        ("navi_parameter_request", "id", "target-speed", 0),
        ("navi_parameter_request", "id", "4", 4),
        ("motor_test", "motors", "20,0 0 0 0 0 0 0 0 0 0 0 0 0 0 0", (20, *(0,) * 15)),
        ("write_settings", "parameters", "6a" * 88, b"\x6a" * 88),
        ("write_mixer", "name", "Mine", "Mine"),
        ("settings_request", "index", "255", 255),
    ],
)
def test_what_is_typed_becomes_the_value(key: str, field: str, text: str, value: object) -> None:
    assert FORMS[key].read({field: text}) == {field: value}


@pytest.mark.parametrize(
    ("key", "field", "text", "message"),
    [
        ("extern_control", "pitch", "300", r"--pitch: '300' does not fit; it takes: -127\.\.127\."),
        ("extern_control", "pitch", "level", "'level' does not fit"),
        ("extern_control", "config", "sideways", "it takes: Name or number, joined by commas: valid "),
        ("navi_parameter_request", "id", "speed", "it takes: Name or number: target_speed"),
        ("navi_parameter_request", "id", "9", "'9' does not fit"),
        ("motor_test", "motors", "1 2 3", r"it takes: 16 numbers 0\.\.255"),
        ("motor_test", "motors", "300 " * 16, r"it takes: 16 numbers 0\.\.255"),
        ("write_settings", "parameters", "6a", r"it takes: 88\.\.179 bytes in hexadecimal"),
        ("write_settings", "parameters", "zz", "bytes in hexadecimal"),
        ("write_mixer", "name", "far too long a name", "it takes: At most 12 characters"),
        ("settings_request", "index", "13", "it takes: 1, 2, 3, 4, 5, 255"),
    ],
)
def test_what_does_not_fit_is_named_with_what_would(key: str, field: str, text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        FORMS[key].read({field: text})


def test_answers_are_shown_with_units_and_names() -> None:
    reply = MotorController.decode(bytes((1, 0, 3, 2, 0x82, 255, 30, 99, 64, 1, 7)))
    lines = dict(line.split(maxsplit=1) for line in describe_reply(reply).splitlines())
    assert lines["current_limit"] == "30 A"
    assert lines["status"] == "0 (success)"
    assert lines["items"].startswith(str(int(MotorControllerItems.CURRENT_LIMIT | MotorControllerItems.SAVE)))
    assert describe_reply(ErrorText(text="no GPS")).split(maxsplit=1) == ["text", "'no GPS'"]
    assert describe_reply(Settings(index=1, parameters=bytes(88))).splitlines()[1].split() == ["parameters", "00" * 88]


BY_NAME = {verb.name: verb for verb in VERBS}


async def ask(name, given, **connection):
    """Ask a fake daemon for a verb; what it was asked."""
    async with fake_daemon(replies={"do/mark": dict}) as daemon:
        await verbforms.ask(BY_NAME[name], given, Connection(VEHICLE, daemon.endpoint, **connection))
        return daemon.asked[-1]


async def test_words_and_numbers_become_the_fields_of_the_request(capsys):
    assert await ask("rates", {"stream": "osd", "interval": "0.25"}) == (
        "do/rates",
        {"stream": "osd", "interval": 0.25},
    )
    assert capsys.readouterr().out == f"{'intervals':24} {{osd=0.25}}\n"
    assert await ask("labels", {"board": "nc"}) == ("do/labels", {"board": "nc"})


async def test_what_is_not_given_is_not_sent_and_who_asks_is_filled_in(capsys):
    suffix, fields = await ask("mark", {"text": "now"})
    assert (suffix, fields["text"], fields.keys()) == ("do/mark", "now", {"text", "holder"})
    assert capsys.readouterr().out == "accepted\n"
    assert await ask("rates", {"stream": None, "interval": None}) == ("do/rates", {})


async def test_what_is_no_json_is_a_mistake_and_what_the_daemon_refuses_a_refusal():
    with pytest.raises(ConfigError, match="--interval 'soon': give JSON"):
        await ask("rates", {"stream": "osd", "interval": "soon"})
    with pytest.raises(CommandRejectedError, match="there is no verb"):
        await ask("route_start", {"confirm": True})
