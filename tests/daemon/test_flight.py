"""Flying by sticks in real time: lease and engagement, a stranger, and two clients that race."""

from __future__ import annotations

import pytest

from lab.rigs.live import LiveDaemon, live_daemon
from lab.rigs.pilot import Pilot
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.control import HolderGrant

pytestmark = [pytest.mark.flight, pytest.mark.real_time(tolerance=0.03)]
"""Two link tests unanswered for 0.1 s each are an outage, a setpoint lives for 0.3 s, and one standstill seldom comes
alone."""


async def take(client, holder, **more):
    return (await client.command("do", "lease", {"action": "take", "holder": holder, **more})).require()["epoch"]


def frames(flown: LiveDaemon, since: int = 0):
    """External control frames sent, in order, with their purpose."""
    sent = [sample.fields for sample in flown.samples[since:] if sample.suffix == "tx/fc/extern_control"]
    return [(frame["purpose"], frame["fields"]) for frame in sent]


def releases(flown: LiveDaemon, since: int):
    return [fields for purpose, fields in frames(flown, since) if purpose == "release" and fields["config"] == 0]


async def engage(flown, client, holder):
    """Take the lease and stream neutral sticks until they are sent."""
    pilot = Pilot(client, holder)
    assert await pilot.take()
    await pilot.__aenter__()
    await flown.until_phase("flying")
    return pilot


async def test_sticks_reach_the_board_and_leave_with_the_lease():
    async with live_daemon() as flown, flown.client() as client, client.token("alice"):
        pilot = await engage(flown, client, "alice")
        assert all(not fields["config"] or not fields["pitch"] for _, fields in frames(flown))
        pilot.sticks |= {"pitch": 20.0, "roll": 10.0, "yaw": -15.0, "throttle": 5.0}
        wanted = {"pitch": 20, "roll": -10, "yaw": -15, "throttle": 5, "config": 1}  # the wire counts roll to the left
        await flown.until(lambda: any(wanted.items() <= fields.items() for _, fields in frames(flown)))
        before = len(flown.samples)
        fields = {"action": "release", "epoch": pilot.epoch, "secret": pilot.secret}
        answer = await client.command("do", "lease", fields)
        assert answer.status == "accepted"
        await flown.until_phase("free")
        await pilot.stop()
        assert len(releases(flown, before)) >= 5
        sent = [purpose for purpose, _ in frames(flown, before)]
        assert "setpoint" not in sent[sent.index("release") :]
        shown = [sample.fields for sample in flown.samples if pilot.secret in str(sample.fields)]
        assert shown == [], "the secret of a lease is nowhere on the bus"


async def test_a_stranger_who_reads_the_bus_cannot_fly_under_the_lease_of_another():
    async with live_daemon() as flown, flown.client() as client, client.token("alice"), flown.client() as other:
        pilot = await engage(flown, client, "alice")
        stranger = Pilot(other, "alice")
        assert not await stranger.take()
        stranger.accept(HolderGrant(**flown.values("control/status")[-1]["lease"], secret="guessed", takes_stamps=True))
        stranger.sticks["pitch"], stranger.session.sequence = 60.0, 5000
        async with stranger:
            await flown.until(lambda: any(event["token"] == "not_holder" for event in flown.values("event/command")))
        assert (await other.command("do", "lease", {"action": "release", "epoch": pilot.epoch})).token == "not_holder"
        assert all(fields["pitch"] == 0 for _, fields in frames(flown))
        assert flown.values("control/status")[-1]["phase"] == "flying"
        await pilot.stop()


async def test_two_clients_race_and_no_frame_of_the_old_epoch_follows_the_new_lease():
    async with live_daemon() as flown, flown.client() as one, flown.client() as two:
        first = await engage(flown, one, "alice")
        first.sticks["pitch"] = 30.0
        await flown.until(lambda: any(fields["pitch"] == 30 for _, fields in frames(flown)))
        with pytest.raises(CommandRejectedError, match="lease_held"):
            await take(two, "bob")
        before = len(flown.samples)
        second = Pilot(two, "bob")
        assert await second.take(force=True)
        epoch = second.epoch
        async with second:  # the first one goes on streaming all the while
            await flown.until(lambda: any(out["epoch"] == epoch for out in flown.values("control/output")))
            second.sticks["roll"] = 25.0
            await flown.until(lambda: any(fields["roll"] == -25 for _, fields in frames(flown, before)))
        await first.stop()
        assert epoch > first.epoch
        epochs = [output["epoch"] for output in flown.values("control/output")]
        assert epochs == sorted(epochs)
        sent = [purpose for purpose, _ in frames(flown, before)]
        begun = sent.index("release")
        assert all(fields["pitch"] == 0 for purpose, fields in frames(flown, before)[begun:])
        refused = [event for event in flown.values("event/command") if event["token"] == "wrong_epoch"]
        assert refused
        assert flown.values("control/status")[-1]["refused"] > 0
