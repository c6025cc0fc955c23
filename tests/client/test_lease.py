"""The lease as a program holds it: engagement, loss, and release however the context is left."""

from __future__ import annotations

import asyncio
import subprocess
import sys

import pytest

from lab.rigs.waiting import wait_until
from mkdaemon.errors import CommandRejectedError, LeaseLostError, ManoeuvreError
from mkdaemon.telemetry.control import Outcome, Phase
from mkdaemon.telemetry.path import PathPoint, PathStored, PathUploadRequest
from mkdaemon.telemetry.refusals import Token, refuse
from tests.client.fake import EPOCH, SECRET, connected

KINDS = {"takeoff": "height", "position": "position", "land": "epoch"}
"""Kinds of setpoints and a field of each, in the order in which to look for them."""
RELEASE = ("do/lease", {"action": "release", "epoch": EPOCH, "secret": SECRET})


@pytest.fixture
async def lease(uav):
    async with uav.lease() as found:
        yield found


@pytest.mark.real_time(tolerance=0.1)
async def test_neutral_sticks_are_streamed_until_the_daemon_engages_then_the_wanted_ones():
    async with connected(engages=10) as (daemon, uav):
        async with uav.lease() as lease:
            await lease.stick(pitch=-12, throttle=5, seconds=0.3)
            assert lease.is_engaged
            await wait_until(lambda: daemon.setpoints[-1]["pitch"] == -12.0)
        pitches = [setpoint["pitch"] for setpoint in daemon.setpoints]
        first = pitches.index(-12.0)
        assert first >= 10  # on a busy machine more are sent: what cannot leave at once is dropped
        assert pitches == [0.0] * first + [-12.0] * (len(pitches) - first)
        assert {setpoint["throttle"] for setpoint in daemon.setpoints} == {5.0}
        numbers = [setpoint["sequence"] for setpoint in daemon.setpoints]
        assert numbers == sorted(set(numbers)) and numbers[0] >= 1 and numbers[-1] <= lease.setpoints
        assert {(setpoint["epoch"], setpoint["ttl"]) for setpoint in daemon.setpoints} == {(EPOCH, 0.3)}
        assert daemon.asked[-1] == RELEASE


async def test_a_lease_somebody_holds_is_refused_with_token_reason_and_fix(daemon, uav):
    daemon.holder = "somebody"
    with pytest.raises(CommandRejectedError, match="somebody holds the lease") as refused:
        async with uav.lease():
            pytest.fail("nobody may fly")
    assert refused.value.token == "lease_held"
    assert "--force" in refused.value.fix
    async with uav.lease(force=True, ttl=2.0, holder="me"):
        assert daemon.asked[-1][1] == {"action": "take", "holder": "me", "force": True, "ttl": 2.0}
        await wait_until(lambda: "me" in daemon.clients)
    await wait_until(lambda: "me" not in daemon.clients)


async def test_a_lease_that_is_refused_for_a_moment_is_asked_for_again(daemon, uav):
    daemon.passing = [
        refuse(Token.LINK_DOWN, state="one_way", detail=""),
        refuse(Token.BUSY, detail="a release is under way"),
    ]
    async with uav.lease(holder="me"):
        assert daemon.holder == "me" and not daemon.passing
    daemon.passing = [refuse(Token.LINK_DOWN, state="down", detail="no board")] * 100
    with pytest.raises(CommandRejectedError, match="no board"):
        async with uav.lease():
            pytest.fail("without a link nothing can be flown")


async def test_an_exception_and_a_cancellation_release_the_aircraft(daemon, uav):
    with pytest.raises(ZeroDivisionError):
        async with uav.lease():
            raise ZeroDivisionError
    assert daemon.asked[-1] == RELEASE

    async def fly():
        async with uav.lease() as lease:
            await lease.stick(throttle=0, seconds=60)

    daemon.asked.clear()
    flying = asyncio.create_task(fly())
    await wait_until(lambda: daemon.phase is Phase.FLYING)
    flying.cancel()
    with pytest.raises(asyncio.CancelledError):
        await flying
    assert daemon.asked[-1] == RELEASE


async def test_a_lease_can_be_renewed_and_looked_at_and_own_streams_set_one_setpoint_at_a_time(uav, daemon):
    assert await uav.lease.show() is None
    async with uav.lease(holder="me") as lease:
        assert (await lease.renew()).epoch == EPOCH
        assert (await uav.lease.show()).holder == "me"
    async with uav.lease() as lease:
        lease.set.stick(pitch=1, roll=2, yaw=3, throttle=4, ttl=0.2)
        await wait_until(lambda: daemon.setpoints)
        wanted = {"pitch": 1.0, "roll": 2.0, "yaw": 3.0, "throttle": 4.0, "ttl": 0.2, "epoch": EPOCH, "sequence": 1}
        wanted["after_abort"] = 0
        assert daemon.setpoints == [wanted]


async def test_every_manoeuvre_streams_its_fields_and_the_name_of_its_target(daemon, uav):
    calls = {
        "goto": ({"target": "pad-c", "yaw": 0.1}, {"position": [0.1, 0.0, -0.2], "frame": "pad", "yaw": 0.1}),
        "velocity": ({"target": "pad-b", "frame": "body"}, {"velocity": [0.1, 0.0, -0.2], "frame": "body"}),
        "hold": ({"target": "pad-a"}, {"target": "pad-a"}),
    }
    async with uav.lease() as lease:
        for name, (options, fields) in calls.items():
            await getattr(lease, name)(*[0.1, 0.0, -0.2] * (name != "hold"), **options, seconds=0.1)
            await wait_until(lambda options=options: daemon.setpoints[-1]["target"] == options["target"])
            sent = [one for one in daemon.setpoints if one["target"] == options["target"]]
            assert all(fields.items() <= one.items() for one in sent), "as it is from the beginning"
        landing = asyncio.create_task(lease.land(target="pad-d"))
        await wait_until(lambda: daemon.setpoints[-1]["target"] == "pad-d")
        daemon.lose("it stands", outcome=Outcome.LANDED)
        await landing


@pytest.mark.parametrize(
    ("reason", "outcome"),
    [
        ("no image of pad for 3.1 s", Outcome.SIGHT_LOST),
        ("landed on pad, says somebody", None),
        ("landed on its back", Outcome.LANDED_ASIDE),
    ],
)
async def test_a_landing_that_ends_otherwise_is_a_lost_lease_whatever_the_words(daemon, lease, reason, outcome):
    landing = asyncio.create_task(lease.land())
    await wait_until(lambda: lease.is_engaged)
    daemon.lose(reason, outcome=outcome)
    with pytest.raises(LeaseLostError, match=reason):
        await landing
    assert lease.outcome is outcome


async def test_what_was_aborted_says_so_and_the_next_call_ends_the_abort(daemon, lease):
    going = asyncio.create_task(lease.goto(0.0, 0.0, 2.0, patience=1.0))
    await wait_until(lambda: lease.is_engaged)
    daemon.say(Phase.ABORTED, "aborted: the operator saw something", aborts=3)
    with pytest.raises(ManoeuvreError, match="aborted: the operator saw something"):
        await going
    assert {setpoint["after_abort"] for setpoint in daemon.setpoints} == {0}
    before = lease.setpoints
    landing = asyncio.create_task(lease.land())
    await wait_until(lambda: daemon.setpoints[-1]["sequence"] > before)
    daemon.lose("it stands", outcome=Outcome.LANDED)
    await landing
    assert {each["after_abort"] for each in daemon.setpoints if each["sequence"] > before} == {3}


async def test_the_context_of_a_flight_takes_off_and_lands(daemon, uav):
    def fly():
        kind = next(kind for kind, field in KINDS.items() if field in daemon.setpoints[-1])
        if kind == "land":
            daemon.lose("landed on pad", outcome=Outcome.LANDED)
        elif daemon.phase is Phase.FLYING:
            daemon.say(Phase.FLYING, "flies", manoeuvre=kind, is_done=True)

    daemon.follow = fly
    async with uav.fly(height=1.5, holder="me") as lease:
        assert {setpoint["height"] for setpoint in daemon.setpoints} == {1.5}
        await lease.goto(0.5, 0.0, 1.5)
        assert (daemon.setpoints[-1]["position"], lease.outcome) == ([0.5, 0.0, 1.5], None)
    assert "height" not in daemon.setpoints[-1]
    assert lease.outcome is Outcome.LANDED
    assert RELEASE not in daemon.asked


PATH = PathUploadRequest(points=(PathPoint(position=(0.0, 0.0, 2.0)), PathPoint(position=(1.0, 0.0, 2.0), speed=0.5)))
STORED = PathStored(id="p1", pieces=1, duration=4.0, length=1.0, speed=0.5, acceleration=0.4, climb=0.0)


async def test_a_path_is_uploaded_flown_paused_and_flown_on(daemon, lease):
    daemon.replies["do/path_upload"] = lambda: dict(STORED)
    daemon.follow = lambda: daemon.say(Phase.FLYING, "flies", manoeuvre="path", stage="follows the path")
    with pytest.raises(ManoeuvreError, match="no path is flown"):
        lease.pause_path()
    flight = asyncio.create_task(lease.follow(PATH, target="pad"))
    await wait_until(lambda: lease.is_engaged)
    lease.pause_path()
    await wait_until(lambda: daemon.setpoints[-1]["paused"])
    lease.resume_path()
    await wait_until(lambda: not daemon.setpoints[-1]["paused"])
    daemon.follow = lambda: daemon.say(Phase.FLYING, "flies", manoeuvre="path", is_done=True)
    await flight
    (uploaded,) = (fields for suffix, fields in daemon.asked if suffix == "do/path_upload")
    assert uploaded == {"points": [{"position": [0.0, 0.0, 2.0]}, {"position": [1.0, 0.0, 2.0], "speed": 0.5}]}
    await lease.follow(STORED)
    assert len([suffix for suffix, _ in daemon.asked if suffix == "do/path_upload"]) == 1
    flown = {(each["path"], each["run"], each["target"]) for each in daemon.setpoints}
    assert flown == {("p1", 1, "pad"), ("p1", 2, "")}
    with pytest.raises(ManoeuvreError, match="no path is flown"):
        lease.resume_path()


async def test_a_flight_that_fails_inside_is_given_back_and_not_landed(daemon, uav):
    daemon.follow = lambda: daemon.say(Phase.FLYING, "flies", manoeuvre="takeoff", is_done=True)
    with pytest.raises(ZeroDivisionError):
        async with uav.fly(height=1.5):
            1 / 0  # noqa: B018 - the program's mistake
    assert all("height" in setpoint for setpoint in daemon.setpoints)
    assert RELEASE in daemon.asked


IMPORTED_LATE = """
import asyncio, sys
from contextlib import asynccontextmanager
from mkdaemon.client.answers import Answer
from mkdaemon.client.lease import Leases
from mkdaemon.telemetry.status import Status

class Quiet:
    def __init__(self): self.loaded = set()
    @asynccontextmanager
    async def token(self, name): yield
    @asynccontextmanager
    async def watch(self, *patterns, **_):
        async def none():
            await asyncio.Event().wait()
            yield
        yield none()
    def stream(self, suffix): return self
    def put(self, payload, **_): pass
    async def command(self, target, name, fields, **_):
        if fields["action"] == "take":
            self.loaded = set(sys.modules)
            grant = {"holder": "me", "epoch": 1, "ttl": 5.0, "left": 5.0, "secret": "s"}
            return Answer(Status.ACCEPTED, grant)
        return Answer(Status.ACCEPTED, {})

async def main():
    quiet = Quiet()
    async with Leases(quiet)() as lease:
        lease.set.stick(pitch=0, roll=0, yaw=0, throttle=0)
    print(sorted(name for name in set(sys.modules) - quiet.loaded if name.startswith(("mkdaemon", "pydantic"))))

asyncio.run(main())
"""


def test_nothing_is_imported_any_more_once_the_lease_is_held():
    """An import takes a second on a busy companion: setpoints would grow stale, and old status seem new."""
    done = subprocess.run([sys.executable, "-c", IMPORTED_LATE], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
