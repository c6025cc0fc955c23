"""Who flies through the gateway, in virtual time: one at a time, under one lease, which ends when nobody does."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace

import pytest

from mkdaemon.config.gamepadfiles import load_mapping
from mkdaemon.errors import CommandRejectedError, ManoeuvreError, MkError
from mkdaemon.gateways.ros2.commands import AXES, BUTTONS, GONE, SILENCE, pad_facts
from mkdaemon.gateways.ros2.deck import FlightDeck, Habits
from mkdaemon.virtualtime import run_virtually
from tests.cli.teleop.rig import FakeDaemon
from tests.client.sessionlease import SessionLease

VELOCITY = {"velocity": (0.1, 0.0, 0.0), "frame": "body", "yaw_rate": 0.0}
STICKS_AT_REST = dict.fromkeys((*AXES, *BUTTONS), 0.0)


class Lease(SessionLease):
    """A lease whose manoeuvres take a second; what they were, in order."""

    def __init__(self):
        super().__init__()
        self.flown = []
        self.fails = {}

    async def _fly(self, name, seconds):
        self.flown.append(name)
        await asyncio.sleep(seconds)
        self.send(None)
        if name in self.fails:
            raise self.fails.pop(name)

    async def take_off(self, height):
        await self._fly(f"take_off {height:g}", 1.0)

    async def land(self):
        await self._fly("land", 1.0)

    async def hold(self, *, seconds):
        await self._fly("hold", seconds)


class Uav:
    """Gives leases and takes releases."""

    def __init__(self, *refusals):
        self.daemon = FakeDaemon(*refusals)
        self.daemon.lease = Lease()
        self.lease = self.daemon.take
        self.released, self.stopped = [], 0

    async def release(self, reason):
        self.released.append(reason)
        return SimpleNamespace(status=SimpleNamespace(value="confirmed"), confirmed=5, sent=5)

    async def stop(self):
        self.stopped += 1


def fly(story, *refusals, newest=None, hold_for=60.0):
    """Let a story happen on a deck; returns the aircraft's side."""
    uav = Uav(*refusals)

    async def main():
        habits = Habits(load_mapping("xbox"), pad_facts(AXES, BUTTONS), hold_for, 1.5)
        deck = FlightDeck(uav, habits, newest or {})
        running = asyncio.create_task(deck.run())
        await asyncio.sleep(0)
        await story(deck)
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)

    run_virtually(main())
    return uav


async def stream(deck, seconds, stream=None, kind="velocity", fields=None):
    """Send setpoints twenty times a second."""
    for _ in range(round(seconds / 0.05)):
        deck.command_arrived(stream or deck.velocity, kind, fields or VELOCITY)
        await asyncio.sleep(0.05)


async def hold_pad(deck, seconds, **moved):
    """Send the state of the pad fifty times a second."""
    for _ in range(round(seconds / 0.02)):
        deck.pad_arrived(STICKS_AT_REST | moved, 0.0)
        await asyncio.sleep(0.02)


async def press_enable(deck, **moved):
    """Lower the thrust stick once, then hold the enable button."""
    await hold_pad(deck, 0.1, ABS_Y=1.0)
    await hold_pad(deck, 0.5, BTN_TL=1.0, **moved)


def test_the_lease_is_taken_with_the_first_setpoint_and_given_back_when_none_comes():
    async def story(deck):
        assert "no client flies" in deck.words
        await stream(deck, 1.0)
        assert deck.flown == "cmd_vel"
        await asyncio.sleep(GONE + 0.1)
        assert deck.flown == ""
        assert "cmd_vel has been silent too long" in deck.words

    uav = fly(story)
    assert (uav.daemon.taken, uav.daemon.given_back) == (1, 1)
    assert 18 <= len(uav.daemon.lease.streamed) <= 20
    assert uav.daemon.lease.streamed[0] == ("velocity", VELOCITY)


def test_nothing_is_repeated_for_a_publisher_that_hangs():
    async def story(deck):
        await stream(deck, 0.5)
        count = len(uav_of(deck).daemon.lease.streamed)
        await asyncio.sleep(0.5)
        assert len(uav_of(deck).daemon.lease.streamed) == count

    fly(story)


def uav_of(deck):
    return deck._uav


def test_a_lost_lease_is_not_taken_again_by_a_stream_that_goes_on():
    async def story(deck):
        await stream(deck, 0.5)
        uav_of(deck).daemon.lease.lose("the pilot's switch")
        await stream(deck, 3.0)
        assert "the pilot's switch" in deck.note
        await asyncio.sleep(SILENCE)
        await stream(deck, 0.5)
        assert deck.flown == "cmd_vel"

    uav = fly(story)
    assert uav.daemon.taken == 2


def test_a_refused_lease_is_asked_for_once():
    held = CommandRejectedError("lease_held", "somebody flies.", "wait")

    async def story(deck):
        await stream(deck, 3.0)
        assert deck.flown == ""
        assert "somebody flies" in deck.note

    assert fly(story, held).daemon.taken == 0


def test_the_topic_that_flies_is_not_disturbed_by_the_other():
    async def story(deck):
        await stream(deck, 0.5)
        deck.command_arrived(deck.pose, "position", {})
        assert deck.flown == "cmd_vel"
        assert "setpoint_pose is left out" in deck.note

    assert {kind for kind, _ in fly(story).daemon.lease.streamed} == {"velocity"}


def test_the_enable_button_flies_and_letting_go_of_it_levels_then_releases():
    async def story(deck):
        await press_enable(deck, ABS_RX=1.0)
        assert deck.flown == "joy"
        assert uav_of(deck).daemon.lease.streamed[-1][1]["roll"] == 30.0
        await hold_pad(deck, 0.5, ABS_RX=1.0)
        assert uav_of(deck).daemon.lease.streamed[-1][1]["roll"] == 0.0
        assert uav_of(deck).daemon.given_back == 0
        await hold_pad(deck, 0.6, ABS_RX=1.0)
        assert deck.flown == ""

    uav = fly(story)
    assert (uav.daemon.taken, uav.daemon.given_back) == (1, 1)


def test_a_pad_that_falls_silent_is_level_after_a_quarter_of_a_second_and_released_after_0_9():
    async def story(deck):
        await press_enable(deck, ABS_RX=1.0)
        await asyncio.sleep(0.3)
        assert uav_of(deck).daemon.lease.streamed[-1][1]["roll"] == 0.0
        await asyncio.sleep(0.65)
        assert deck.flown == ""
        await asyncio.sleep(3.0)
        assert not deck._teleop.hands, "forgotten"

    fly(story)


def test_the_state_of_a_pad_is_as_old_as_its_stamp():
    async def story(deck):
        await press_enable(deck)
        for _ in range(60):
            deck.pad_arrived(STICKS_AT_REST | {"BTN_TL": 1.0, "ABS_RX": 1.0}, 0.5)
            await asyncio.sleep(0.02)
        assert uav_of(deck).daemon.lease.streamed[-1][1]["roll"] == 0.0, "what arrives late does not fly"

    fly(story)


def test_the_pad_takes_over_from_a_stream_and_from_a_verb():
    async def story(deck):
        await stream(deck, 0.3)
        await press_enable(deck)
        assert deck.flown == "joy"
        await stream(deck, 0.1)
        assert uav_of(deck).daemon.lease.streamed[-1][0] == "stick"
        with pytest.raises(MkError, match="the pad of joy flies"):
            await deck.land()

    uav = fly(story)
    assert uav.daemon.taken == 1, "the aircraft is not released in between"


def test_on_the_ground_the_thrust_stick_must_be_at_its_lowest():
    async def story(deck):
        await press_enable(deck)
        assert deck.flown == ""
        assert "lowest" in deck.note

    fly(story, newest={"state/flight": SimpleNamespace(is_flying=False)})


def test_take_off_holds_then_lands_when_nobody_flies_on():
    async def story(deck):
        assert "at 1.5 m; holds for 5 s" in await deck.take_off()
        assert deck.flown == "hold"
        await asyncio.sleep(4.5)
        assert uav_of(deck).daemon.lease.flown == ["take_off 1.5", "hold"]
        await asyncio.sleep(2.0)
        assert deck.flown == ""

    uav = fly(story, hold_for=5.0)
    assert uav.daemon.lease.flown == ["take_off 1.5", "hold", "land"]
    assert (uav.daemon.taken, uav.daemon.given_back) == (1, 1)


def test_a_stream_flies_on_from_a_hold_under_the_same_lease():
    async def story(deck):
        await deck.take_off()
        await stream(deck, 0.5)
        assert deck.flown == "cmd_vel"
        assert (await deck.hold()).startswith("holds for")
        assert "landed" in await deck.land()

    uav = fly(story)
    assert (uav.daemon.taken, uav.daemon.given_back) == (1, 1)


def test_a_verb_is_interrupted_by_another_and_by_a_release_and_says_so():
    async def story(deck):
        taking_off = asyncio.create_task(deck.take_off())
        await asyncio.sleep(0.3)
        await stream(deck, 0.2)
        assert deck.flown == "take_off", "a stream does not interrupt it"
        landing = asyncio.create_task(deck.land())
        with pytest.raises(MkError, match="take_off was interrupted: land was asked for"):
            await taking_off
        await asyncio.sleep(0.3)
        assert "confirmed: 5 of 5" in await deck.release()
        with pytest.raises(MkError, match="land was interrupted"):
            await landing
        assert deck.flown == ""

    uav = fly(story)
    assert uav.released == ["asked for in ROS"]
    assert uav.daemon.given_back == 1


@pytest.mark.parametrize(("is_engaged", "flown"), [(True, "hold"), (False, "")])
def test_a_manoeuvre_that_fails_holds_where_it_flies_and_is_let_go_of_else(is_engaged, flown):
    async def story(deck):
        lease = uav_of(deck).daemon.lease
        lease.engages = 0 if is_engaged else None
        lease.fails["land"] = ManoeuvreError("not landed within 60 s")
        with pytest.raises(ManoeuvreError, match="not landed"):
            await deck.land()
        assert deck.flown == flown

    fly(story)


def test_a_setpoint_that_is_refused_is_told_and_ends_nothing():
    async def story(deck):
        await stream(deck, 0.2)
        uav_of(deck).daemon.lease.refuse(CommandRejectedError("no_estimate", "no target.", "look"))
        await stream(deck, 0.2)
        assert deck.flown == "cmd_vel"
        assert "no target" in deck.note
        deck.refused("joy holds a NaN or an infinity")
        assert "NaN" in deck.words

    fly(story)


def test_the_stop_button_asks_for_the_motors_to_stop():
    async def story(deck):
        await hold_pad(deck, 0.1, ABS_Y=1.0)
        await hold_pad(deck, 1.5, BTN_MODE=1.0)

    assert fly(story).stopped == 1


def test_the_end_of_the_gateway_gives_the_lease_back():
    async def story(deck):
        await stream(deck, 0.5)

    assert fly(story).daemon.given_back == 1
