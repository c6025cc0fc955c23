"""One kill of each program; `python -m lab kills` is the campaign, tests/daemon/procedures has it in virtual time."""

from __future__ import annotations

import pytest

from lab.kills import kill_daemons, kill_mkctls

pytestmark = pytest.mark.flight


@pytest.mark.parametrize(
    ("kill", "verb"), [(kill_mkctls, "backup"), (kill_daemons, "restore")], ids=["mkctl", "daemon"]
)
async def test_a_kill_during_a_procedure_leaves_the_live_set_as_it_was(kill, verb):
    [found] = await kill(verb, 1, 7)
    assert not found["is_wrong"]
