"""Who flies through the gateway, in virtual time: one at a time, under one lease, which ends when nobody does."""

from __future__ import annotations

import asyncio
import inspect
from types import SimpleNamespace

import pytest

from mkdaemon.config.gamepadfiles import load_mapping
from mkdaemon.errors import CommandRejectedError, ManoeuvreError, MkError
from mkdaemon.gateways.ros2.commands import AXES, BUTTONS, GONE, SILENCE, pad_facts
from mkdaemon.gateways.ros2.deck import FlightDeck, Habits
from mkdaemon.telemetry.path import PathPoint, PathUploadRequest
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

    async def follow(self, path):
        await self._fly(f"path of {len(path.points)}", 3.0)

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

    async def end(self):
        """The gateway ends; leases that were taken, and given back."""
        self.running.cancel()
        await asyncio.gather(self.running, return_exceptions=True)
        return self.daemon.taken, self.daemon.given_back

    @property
    def roll(self):
        """Of the newest setpoint."""
        return self.daemon.lease.streamed[-1][1]["roll"]


def flown(*refusals, newest=None, hold_for=60.0):
    """Let a test happen on a deck, in virtual time; `uav` is the aircraft's side, whose `end` ends the deck."""

    def decorate(story):
        async def main(**options):
            uav = Uav(*refusals)
            habits = Habits(load_mapping("xbox"), pad_facts(AXES, BUTTONS), hold_for, 1.5)
            deck = FlightDeck(uav, habits, newest or {})
            uav.running = asyncio.create_task(deck.run())
            await asyncio.sleep(0)
            await story(deck, uav, **options)
            await uav.end()

        def run(**options):
            run_virtually(main(**options))

        run.__name__, run.pytestmark = story.__name__, getattr(story, "pytestmark", [])
        parameters = list(inspect.signature(story).parameters.values())[2:]
        run.__signature__ = inspect.Signature(parameters)
        return run

    return decorate


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


@flown()
async def test_the_lease_is_taken_with_the_first_setpoint_and_given_back_when_none_comes(deck, uav):
    assert "no client flies" in deck.words
    await stream(deck, 1.0)
    assert deck.flown == "cmd_vel"
    await asyncio.sleep(GONE + 0.1)
    assert deck.flown == ""
    assert "cmd_vel has been silent too long" in deck.words
    assert await uav.end() == (1, 1)
    assert 18 <= len(uav.daemon.lease.streamed) <= 20, "nothing is repeated"
    assert uav.daemon.lease.streamed[0] == ("velocity", VELOCITY)


@flown()
async def test_a_lost_lease_is_not_taken_again_by_a_stream_that_goes_on(deck, uav):
    await stream(deck, 0.5)
    uav.daemon.lease.lose("the pilot's switch")
    await stream(deck, 3.0)
    assert "the pilot's switch" in deck.note
    await asyncio.sleep(SILENCE)
    await stream(deck, 0.5)
    assert deck.flown == "cmd_vel"
    assert (await uav.end())[0] == 2


PATH = PathUploadRequest(points=(PathPoint(position=(0.0, 0.0, 2.0)), PathPoint(position=(1.0, 0.0, 2.0), time=4.0)))


@flown()
async def test_a_refused_path_is_noted_and_one_is_flown_once_then_held_and_a_new_one_takes_its_place(deck, uav):
    lease = uav.daemon.lease
    lease.fails["path of 2"] = CommandRejectedError("path_refused", "the path cannot be flown: piece 1.", "Slow down.")
    deck.path_arrived(PATH)
    await asyncio.sleep(3.5)
    assert "piece 1" in deck.note
    lease.flown.clear()
    deck.path_arrived(PATH)
    await asyncio.sleep(1.0)
    assert deck.flown == "path"
    deck.path_arrived(PATH)
    await asyncio.sleep(2.5)
    assert (deck.flown, deck.note) == ("path", "path was interrupted: path was asked for")
    await asyncio.sleep(1.0)
    assert deck.flown == "hold"
    assert deck.note.startswith("at the end of the path; holds for 60 s")
    assert lease.flown == ["path of 2", "path of 2", "hold"]


@flown()
async def test_the_enable_button_flies_and_letting_go_of_it_levels_then_releases(deck, uav):
    await press_enable(deck, ABS_RX=1.0)
    assert deck.flown == "joy"
    assert uav.roll == 30.0
    await hold_pad(deck, 0.5, ABS_RX=1.0)
    assert uav.roll == 0.0
    assert uav.daemon.given_back == 0
    await hold_pad(deck, 0.6, ABS_RX=1.0)
    assert deck.flown == ""
    assert await uav.end() == (1, 1)


@flown()
async def test_a_pad_that_falls_silent_or_comes_late_is_level_after_a_quarter_of_a_second_and_released_after_0_9(
    deck, uav
):
    await press_enable(deck)
    for _ in range(60):
        deck.pad_arrived(STICKS_AT_REST | {"BTN_TL": 1.0, "ABS_RX": 1.0}, 0.5)
        await asyncio.sleep(0.02)
    assert uav.roll == 0.0, "what arrives late does not fly"
    await hold_pad(deck, 0.1)
    await press_enable(deck, ABS_RX=1.0)
    assert uav.roll == 30.0
    await asyncio.sleep(0.3)
    assert uav.roll == 0.0
    await asyncio.sleep(0.65)
    assert deck.flown == ""
    await asyncio.sleep(3.0)
    assert not deck._teleop.hands, "forgotten"


@flown()
async def test_the_pad_takes_over_from_a_stream_and_from_a_verb(deck, uav):
    await stream(deck, 0.3)
    await press_enable(deck)
    assert deck.flown == "joy"
    await stream(deck, 0.1)
    assert uav.daemon.lease.streamed[-1][0] == "stick"
    with pytest.raises(MkError, match="the pad of joy flies"):
        await deck.land()
    assert (await uav.end())[0] == 1, "the aircraft is not released in between"


@flown()
async def test_a_stream_flies_on_from_a_hold_under_the_same_lease(deck, uav):
    await deck.take_off()
    await stream(deck, 0.5)
    assert deck.flown == "cmd_vel"
    assert (await deck.hold()).startswith("holds for")
    assert "landed" in await deck.land()
    assert await uav.end() == (1, 1)


@flown()
async def test_a_verb_is_interrupted_by_another_and_by_a_release_and_says_so(deck, uav):
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
    await uav.end()
    assert uav.released == ["asked for in ROS"]
    assert uav.daemon.given_back == 1


@pytest.mark.parametrize(("is_engaged", "flown"), [(True, "hold"), (False, "")])
@flown()
async def test_a_manoeuvre_that_fails_holds_where_it_flies_and_is_let_go_of_else(deck, uav, is_engaged, flown):
    lease = uav.daemon.lease
    lease.engages = 0 if is_engaged else None
    lease.fails["land"] = ManoeuvreError("not landed within 60 s")
    with pytest.raises(ManoeuvreError, match="not landed"):
        await deck.land()
    assert deck.flown == flown


@flown()
async def test_a_setpoint_that_is_refused_is_told_and_ends_nothing(deck, uav):
    await stream(deck, 0.2)
    uav.daemon.lease.refuse(CommandRejectedError("no_estimate", "no target.", "look"))
    await stream(deck, 0.2)
    assert deck.flown == "cmd_vel"
    assert "no target" in deck.note
    deck.refused("joy holds a NaN or an infinity")
    assert "NaN" in deck.words
    assert (await uav.end())[1] == 1, "the end of the gateway gives the lease back"


@flown()
async def test_the_stop_button_asks_for_the_motors_to_stop(deck, uav):
    await hold_pad(deck, 0.1, ABS_Y=1.0)
    await hold_pad(deck, 1.5, BTN_MODE=1.0)
    await uav.end()
    assert uav.stopped == 1
