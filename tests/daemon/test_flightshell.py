"""The shell of the flight core: what it brings to the core, and how it carries out the core's orders."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace

import pytest

from lab.rigs.linkrig import virtually
from mkdaemon.clock import Clock
from mkdaemon.config.control import ControlConfig
from mkdaemon.control.actions import SendSticks
from mkdaemon.control.core import FlightCore
from mkdaemon.control.events import PoseSeen, SightRefused
from mkdaemon.control.limiter import StickCounts
from mkdaemon.daemon.deck import Deck
from mkdaemon.daemon.eyes import PoseSink
from mkdaemon.daemon.flight import FlightControl
from mkdaemon.daemon.procedures import Interlock
from mkdaemon.daemon.releases import RELEASE_TIMEOUT
from mkdaemon.daemon.verbs import Verbs
from mkdaemon.errors import CommandRejectedError
from mkdaemon.link.session.traffic import FrameNumber, ReleaseResult, SetpointQueued, SetpointRefused
from mkdaemon.telemetry.command import AbortRequest, ReleaseRequest
from mkdaemon.telemetry.control import ControlLine, EstimateValue, Phase, ReleaseOutcome
from mkdaemon.telemetry.path import PathPoint, PathUploadRequest
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.vision import PoseRefused
from tests.control.admission.situations import GOOD
from tests.control.events import pose
from tests.daemon.procedures.procedure_rig import Bus
from tests.values import made

DONE = ReleaseResult(ReleaseOutcome.CONFIRMED, 5, 5, "test")
ESTIMATE = made(EstimateValue, target="pad", position=(0.0, 0.0, 2.0), caution=0.25)


STICKS = SendSticks(StickCounts(0, 0, 0, 60), 1e9, epoch=1, sequence=3, age=0.01, is_limited=False)


class Core(FlightCore):
    """A flight core that also wants what a test gives it."""

    def __init__(self):
        super().__init__(ControlConfig(), first_epoch=1)
        self.wanted = []

    def tick(self, now, **more):
        wanted, self.wanted = self.wanted, []
        return [*super().tick(now, **more), *wanted]


class Shell:
    """A running shell; its link keeps every release and ends none by itself."""

    def __init__(self):
        self.bus, self.core, self.releases = Bus(), Core(), []
        clock = Clock(monotonic=asyncio.get_running_loop().time)
        self.fates = []
        link = SimpleNamespace(
            control_line=lambda: ControlLine("v2"),
            release=self.release,
            released_at=float("-inf"),
            send_setpoint=lambda build, *, deadline: self.fates.pop(0),
        )
        deck = self.deck = Deck(ControlConfig(), self.bus, clock, first_epoch=1, core=self.core)
        self.audit = deck.audit
        self.watched = []
        self.flight = FlightControl(
            deck, link, clock=clock, watch_client=lambda name, watcher: self.watched.append((name, watcher))
        )

    def release(self, reason):
        self.releases.append(asyncio.get_running_loop().create_future())
        return self.releases[-1]

    async def __aenter__(self):
        self.task = asyncio.create_task(self.flight.run())
        await asyncio.sleep(0)
        return self

    async def __aexit__(self, *_):
        self.task.cancel()
        await asyncio.gather(self.task, return_exceptions=True)


@virtually
async def test_a_release_that_never_ends_is_answered_as_a_timeout_and_control_goes_on():
    async with Shell() as shell:
        verbs = Verbs(shell.flight, shell.flight._link, shell.audit, Interlock(lambda: GOOD), {})
        began = asyncio.get_running_loop().time()
        result = await verbs.answer("do/release", b"")
        assert (result.status, result.token) == ("timeout", "timeout")
        assert asyncio.get_running_loop().time() - began == pytest.approx(RELEASE_TIMEOUT, abs=0.1)
        again = asyncio.create_task(verbs.answer("do/release", b""))
        await asyncio.sleep(0.1)
        shell.releases[-1].set_result(DONE)
        assert (await again).status == "accepted"
        assert shell.flight.phase is Phase.FREE


@virtually
async def test_who_stops_waiting_for_a_release_takes_nobody_elses_answer_away():
    async with Shell() as shell:
        impatient, patient = (asyncio.create_task(shell.flight.release(ReleaseRequest())) for _ in range(2))
        await asyncio.sleep(0.1)
        impatient.cancel()
        await asyncio.sleep(0)
        shell.releases[0].set_result(DONE)
        assert await patient is DONE


@virtually
async def test_a_release_by_the_guard_ends_control_and_neutral_sticks_do_not():
    async with Shell() as shell:
        shell.flight.guard_acted(False)
        await asyncio.sleep(0.1)
        assert shell.releases == []
        shell.flight.guard_acted(True)
        await asyncio.sleep(0.1)
        assert len(shell.releases) == 1
        assert shell.flight.phase is Phase.RELEASING
        actions = [event.action for event in shell.bus.values("event/failsafe")]
        assert actions[:2] == ["guard neutral", "guard release"]


@virtually
async def test_a_line_that_refuses_frames_ends_nothing_and_is_told():
    """The line fell silent between the look of the flight loop and its order."""
    refused = SetpointRefused(refuse(Token.LINK_DOWN, state="down", detail="nothing arrives any more"))
    async with Shell() as shell:
        for fates in ([refused] * 3, [SetpointQueued(FrameNumber(7))], [refused]):
            shell.fates = list(fates)
            shell.core.wanted = [STICKS] * len(fates)
            await asyncio.sleep(1.1)
            assert shell.fates == []
        assert not shell.task.done()
        assert [output.frame for output in shell.bus.values("control/output")] == [7]
        told = [event.text for event in shell.bus.values("event/log")]
        assert len(told) == 2
        assert all(text.startswith("stick frame not sent: link_down: ") for text in told)


async def test_a_pose_and_a_refusal_reach_the_core_and_the_bus_and_other_values_only_the_bus():
    told, bus, refused = [], Bus(), PoseRefused.model_construct(camera="down")
    sink = PoseSink(lambda event, now: told.append((event, now)), bus, Clock(monotonic=lambda: 1.2))
    sink.publish("vision/down/pose", pose(1.0))
    sink.publish("vision/down/refused", refused)
    sink.publish("vision/down/stats", ESTIMATE)
    assert told == [(PoseSeen(pose(1.0)), 1.2), (SightRefused(refused), 1.2)]
    assert [key for key, _ in bus.published] == ["vision/down/pose", "vision/down/refused", "vision/down/stats"]


@virtually
async def test_a_path_that_can_be_flown_is_stored_and_another_one_refused():
    flight = Shell().flight
    start = PathPoint(position=(0.0, 0.0, 1.5))
    near, far = (PathUploadRequest(points=(start, PathPoint(position=(x, 0.0, 1.5), speed=0.5))) for x in (1.0, 900.0))
    assert flight.store_path(near).length == pytest.approx(1.0, abs=0.01)
    with pytest.raises(CommandRejectedError) as refused:
        flight.store_path(far)
    assert refused.value.token == "path_refused"


@virtually
async def test_with_nothing_flown_an_abort_is_refused():
    with pytest.raises(CommandRejectedError) as refused:
        Shell().flight.abort(AbortRequest(reason="enough"))
    assert refused.value.token == "nothing_flown"
