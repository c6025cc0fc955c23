"""One kill of each program; `python -m lab kills` is the campaign, tests/daemon/procedures has it in virtual time."""

from __future__ import annotations

import pytest

from lab.kills.main import run_daemon_kills, run_mkctl_kills

pytestmark = pytest.mark.flight


@pytest.mark.parametrize(
    ("campaign", "verb"), [(run_mkctl_kills, "backup"), (run_daemon_kills, "restore")], ids=["mkctl", "daemon"]
)
async def test_a_kill_during_a_procedure_leaves_the_live_set_as_it_was(campaign, verb):
    kills = [kill async for kill in campaign(1, 7, [verb])]
    assert [kill.verb for kill in kills] == [verb]
    assert [kill for kill in kills if kill.is_wrong] == []
