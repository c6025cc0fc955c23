"""Commands that are made from the table of verbs."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from mkdaemon.cli.mkctl import verbforms
from mkdaemon.cli.mkctl.app import app as mkctl
from mkdaemon.cli.mkctl.connection import Connection
from mkdaemon.cli.program import run
from mkdaemon.errors import CommandRejectedError, ConfigError
from mkdaemon.telemetry.verbs import VERBS
from tests.client.fake import VEHICLE, fake_daemon
from tools import client_sources

BY_NAME = {verb.name: verb for verb in VERBS}


@pytest.mark.parametrize("verb", VERBS, ids=lambda verb: verb.name)
def test_every_verb_has_a_command_with_help_for_its_fields(verb, capsys):
    assert run(mkctl, ["do", verb.name.replace("_", "-"), "--help"]) == 0
    out = capsys.readouterr().out
    for name in verb.request.model_fields:
        assert (f"--{name.replace('_', '-')}" in out) == (name != "holder")


def test_a_verb_without_a_command_of_its_own_has_one_from_the_table(capsys):
    routes = [verb for verb in VERBS if verb.service == "route"]
    assert routes
    for verb in routes:
        assert run(mkctl, ["waypoints", verb.method, "--help"]) == 0
        assert verb.about in " ".join(capsys.readouterr().out.split())


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


async def test_the_answer_is_one_line_of_json_where_asked_for(capsys):
    await ask("rates", {}, json=True)
    assert json.loads(capsys.readouterr().out) == {"intervals": {"osd": 0.1}}


async def test_what_is_no_json_is_a_mistake_and_what_the_daemon_refuses_a_refusal():
    with pytest.raises(ConfigError, match="--interval 'soon': give JSON"):
        await ask("rates", {"stream": "osd", "interval": "soon"})
    with pytest.raises(CommandRejectedError, match="there is no verb"):
        await ask("route_start", {"confirm": True})


def test_a_new_verb_needs_a_line_of_the_table_and_nothing_else(monkeypatch):
    more = (
        replace(BY_NAME["labels"], name="polish", call="polish"),
        replace(BY_NAME["route_start"], name="settings_polish", call="settings.polish"),
        replace(BY_NAME["mixer_read"], name="lights_read", call="lights.read"),
    )
    monkeypatch.setattr(client_sources, "VERBS", (*VERBS, *more))
    made = client_sources.verb_calls()
    assert 'async def polish(self, board: Literal["fc", "nc", "mag"]) -> Labels:' in made
    assert "self.lights = LightsVerbs(self)" in made
    assert "async def polish(self, *, confirm: bool = False, on_progress: OnProgress | None = None)" in made
