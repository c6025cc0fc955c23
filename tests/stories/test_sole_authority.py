"""One authority at a time: clients without a name are no exception."""

from __future__ import annotations

import pytest

from lab.rigs.cockpit import Boards, cockpit
from lab.rigs.linkrig import virtually
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.command import LeaseRequest


@virtually
async def test_clients_without_a_name_do_not_take_each_others_lease():
    async with cockpit(Boards("2.12a"), seed=1) as flown:
        take = LeaseRequest(action="take")
        first = await flown.flight.lease(take)
        with pytest.raises(CommandRejectedError) as caught:
            await flown.flight.lease(take)
        assert caught.value.token == "lease_held"
        assert first.holder in caught.value.reason
        second = await flown.flight.lease(LeaseRequest(action="take", force=True))
        assert second.holder != first.holder
        assert second.epoch > first.epoch
