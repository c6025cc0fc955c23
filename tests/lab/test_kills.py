"""One kill of each program; `python -m lab kills` is the campaign, tests/daemon/procedures has it in virtual time."""

from __future__ import annotations

import pytest

from lab.kills import kill

pytestmark = pytest.mark.flight


@pytest.mark.parametrize(("victim", "verb"), [("mkctl", "backup"), ("daemon", "restore")])
async def test_a_kill_during_a_procedure_leaves_the_live_set_as_it_was(victim, verb):
    assert not (await kill(victim, verb, 7))["is_wrong"]
