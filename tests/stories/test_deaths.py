"""Clients that die while they fly, with the active release and without."""

from __future__ import annotations

from functools import partial

import pytest

from lab.rigs.boardport import ADAPTER_TIME
from lab.rigs.cockpit import Boards
from lab.stories import deaths as campaign
from lab.stories.deaths import RELEASE_TIME, Death
from mkdaemon.link.link import Link
from mkdaemon.link.session.traffic import ReleaseResult
from mkdaemon.telemetry.control import ReleaseOutcome

WAYS = tuple(Death)
SOME = (Death.KILLED, Death.TOKEN)
"""The stream ends, the token ends: what a board may make something of; the campaign dies of all on each."""
WATCHED = RELEASE_TIME + 0.4
"""The campaign watches longer for a relapse [s]; a client that is frozen is watched until the bus misses it."""
fly_session = partial(campaign.fly_session, tick=ADAPTER_TIME, watched=WATCHED)


@pytest.mark.parametrize(("fc", "ways"), [("2.08", SOME), ("2.12a", WAYS)])
def test_whatever_a_client_dies_of_the_aircraft_is_level_and_let_go_of(fc, ways):
    losses = fly_session(Boards(fc), seed=7, deaths=len(ways), ways=ways)
    assert {loss["death"] for loss in losses} == set(ways)
    assert not any(loss["is_wrong"] or loss["neutral"] is None for loss in losses), losses


class SilentRelease(Link):
    """A link that takes "stop sending" for a release: no release frames, and polling goes on."""

    async def release(self, reason):
        return ReleaseResult(ReleaseOutcome.NOT_SENT, 0, 0, reason)


def test_without_the_active_release_an_old_generation_obeys_a_dead_client_for_ever():
    """The trap of docs/safety.md: polling goes on, and each request keeps the last command alive."""
    ways = (Death.FROZEN,)
    [loss] = fly_session(Boards("2.08"), seed=1, deaths=1, link_class=SilentRelease, watched=5.5, ways=ways)
    assert loss["is_wrong"]
    assert loss["released"] is None, "the control should still be held"
