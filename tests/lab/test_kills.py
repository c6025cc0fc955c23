"""One kill of each kind; the whole campaign is `python -m lab kills`."""

from __future__ import annotations

import pytest

from lab.kills.main import run_daemon_kills, run_mkctl_kills

pytestmark = pytest.mark.flight


@pytest.mark.parametrize("campaign", [run_mkctl_kills, run_daemon_kills], ids=["mkctl", "daemon"])
async def test_a_kill_during_a_procedure_leaves_the_live_set_as_it_was(campaign):
    kills = [kill async for kill in campaign(1, 7)]
    assert [kill.verb for kill in kills] == ["backup", "restore"]
    assert [kill for kill in kills if kill.is_wrong] == []
