"""A daemon that dies at any moment of a procedure leaves what the next one needs to make the live set live again.

What a death leaves is the FlightCtrl and the disk, and each changes only where a request arrives or a file is changed.
So a procedure is stopped before every such change in turn, at every place between two, and that is every moment there
is. The board stands at the level of messages (`tests.protocol.procedures.talk`): a life costs milliseconds.
"""

from __future__ import annotations

import asyncio
from concurrent.futures import Future
from types import SimpleNamespace

import msgpack
import pytest

from lab.rigs.linkrig import virtually
from lab.rigs.waiting import wait_until
from mkdaemon.clock import Clock
from mkdaemon.control.events import NOTED
from mkdaemon.control.vehicle import VehicleMemory
from mkdaemon.daemon.audit import Audit
from mkdaemon.daemon.procedures import Interlock, Journal, ProcedureRunner
from mkdaemon.errors import CommandRejectedError, RequestTimeoutError
from mkdaemon.link.labels import LabelCache
from mkdaemon.protocol.wire import Board
from tests.control.admission.situations import situation_of
from tests.control.events import link_state
from tests.daemon.procedures.procedure_rig import Bus
from tests.protocol.procedures.talk import FlightCtrl

ANSWER = 0.02
"""A request takes so long to arrive, and its answer as long to come back [s]."""


class World:
    """What outlives a daemon: the board, and when the next death comes.

    Attributes:
        board: the FlightCtrl.
        changes: requests that arrived and changes of files so far.
        at: the change before which something happens; None for never.
        what: happens then.
        arrived: called when a request has arrived and before it is answered.
        is_dead: nothing arrives anywhere any more.
    """

    def __init__(self, at=None, what=None):
        self.board = FlightCtrl()
        self.arrived = lambda: None
        self.changes, self.at, self.what, self.is_dead = 0, at, what, False

    def happens(self):
        """Whether the moment for what happens has come; it happens once."""
        if self.changes != self.at or self.what is None:
            return False
        what, self.what = self.what, None
        what()
        return True

    def reaches(self):
        """Whether the next change takes place."""
        self.happens()
        self.changes += not self.is_dead
        return not self.is_dead

    def die(self):
        self.is_dead = True


class Disk:
    """Changes files at once, as long as the daemon lives."""

    def __init__(self, world):
        self.world = world

    def submit(self, work, /, *arguments):
        done = Future()
        if self.world.reaches():
            done.set_result(work(*arguments))
        return done


class Line:
    """A link to a FlightCtrl; of a dead daemon nothing arrives."""

    def __init__(self, world):
        self.world = world
        self.is_up, self.direct_board = True, Board.FC
        self.is_discovering = self.lacks_flightctrl = False
        self.boards, self.doubt = frozenset({Board.FC}), None
        self.dialect = SimpleNamespace(fc_release="2.12a", read_only_reason=None)

    async def request(self, message, *, board, timeout, retries, purpose):  # noqa: ASYNC109
        await asyncio.sleep(ANSWER)
        if self.world.happens():
            await asyncio.sleep(0)  # what was cancelled by it does not arrive
        answer = self.world.board(message) if self.world.reaches() else None
        self.world.arrived()
        await asyncio.sleep(ANSWER)
        if answer is None:
            await asyncio.sleep(timeout)
            raise RequestTimeoutError("no answer")
        return answer


class Guard:
    """Lets everything pass."""

    async def check_step(self, board, message):
        pass

    async def prove_board(self, board, message):
        await asyncio.sleep(0)


class Life:
    """One daemon, as far as procedures go."""

    def __init__(self, world, folder):
        self.world, self.bus = world, Bus()
        clock = Clock(monotonic=asyncio.get_running_loop().time)
        facts = VehicleMemory()
        facts.link_changed(link_state())
        facts.motors_running = lambda now, within=2.0: False
        self.interlock = Interlock(lambda: situation_of(facts, clock.now()))
        self.runner = ProcedureRunner(
            Line(world),
            facts,
            lambda event, now: NOTED,
            self.bus,
            Audit(self.bus, clock),
            Guard(),
            self.interlock,
            Journal(folder, Disk(world)),
            LabelCache(None),
            clock,
        )

    async def __aenter__(self):
        self.task = asyncio.create_task(self.runner.run())
        return self

    async def __aexit__(self, *_):
        self.task.cancel()
        await asyncio.gather(self.task, return_exceptions=True)

    async def ask(self, verb, fields):
        """What was answered: `accepted`, or why not."""
        try:
            return (await self.runner.verbs[verb](msgpack.packb(fields))).status.value
        except CommandRejectedError as error:
            return error.token

    @property
    def is_idle(self):
        return not self.interlock.running and not self.runner._recovery.notes


def changed(board, slots):
    return [{"slot": slot, "raw": bytes((*board.sets[slot][:20], 1, 2, 3, *board.sets[slot][23:]))} for slot in slots]


BACKUP = ("settings_backup", lambda board: {})
OTHERS = ("settings_restore", lambda board: {"sets": changed(board, (1, 4)), "confirm": True})
ACTIVE = ("settings_restore", lambda board: {"sets": changed(board, (2, 3)), "confirm": True})
BY_NAME = ("settings_write", lambda board: {"values": {"gyro_p": 7}, "slot": 5, "confirm": True})
EVERY = pytest.mark.parametrize(
    "procedure", [BACKUP, OTHERS, ACTIVE, BY_NAME], ids=["backup", "others", "active", "by name"]
)
SOME = pytest.mark.parametrize("procedure", [BACKUP, ACTIVE], ids=["backup", "active"])
"""One that only reads, and one that writes the live set."""


async def count_changes(procedure, folder):
    """How many changes the procedure makes when nothing happens to it, and what it leaves live."""
    verb, fields = procedure
    world = World()
    async with Life(world, folder) as life:
        assert await life.ask(verb, fields(world.board)) == "accepted"
    assert list(folder.iterdir()) == []
    return world.changes, world.board.live


async def until_dead_or_idle(world, life):
    """Wait until the daemon has died, or has nothing to do any more."""
    await asyncio.sleep(0)
    await wait_until(lambda: world.is_dead or life.is_idle, within=60.0, step=0.005)


async def live_on(world, folder):
    """Start the next daemon and let it do what the last one owes; returns what it told."""
    world.is_dead = False
    async with Life(world, folder) as life:
        await wait_until(lambda: life.is_idle, within=120.0, step=0.05)
        assert life.interlock.owed is None
    return life.bus.texts()


def assert_whole(world, folder):
    """The active set is the one it was, it is live, and nothing is owed."""
    assert world.board.active == FlightCtrl().active
    assert world.board.live == world.board.sets[world.board.active]
    assert list(folder.iterdir()) == []


@EVERY
@virtually
async def test_a_death_at_any_moment_leaves_the_live_set_as_it_was(procedure, tmp_path):
    verb, fields = procedure
    changes, _ = await count_changes(procedure, tmp_path)
    old = FlightCtrl().live
    assert changes > 10
    for at in range(changes):
        world = World(at)
        world.what = world.die
        async with Life(world, tmp_path) as life:
            asked = asyncio.create_task(life.ask(verb, fields(world.board)))
            await until_dead_or_idle(world, life)
            asked.cancel()
        await live_on(world, tmp_path)
        assert_whole(world, tmp_path)
        assert world.board.live == old, f"killed before change {at} of {changes}"


@SOME
@virtually
async def test_a_second_death_while_the_next_daemon_restores_changes_nothing(procedure, tmp_path):
    """The first death is where most is at stake: the last moment before the note goes."""

    verb, fields = procedure
    changes, _ = await count_changes(procedure, tmp_path)
    for second in range(20):
        world = World(changes - 1)
        world.what = world.die
        async with Life(world, tmp_path) as life:
            asked = asyncio.create_task(life.ask(verb, fields(world.board)))
            await until_dead_or_idle(world, life)
            asked.cancel()
        world.is_dead, world.at, world.what = False, world.changes + second, world.die
        async with Life(world, tmp_path) as life:
            await until_dead_or_idle(world, life)
        if not world.is_dead:
            break
        await live_on(world, tmp_path)
        assert_whole(world, tmp_path)
        assert world.board.live == FlightCtrl().live, f"killed before change {second} of the recovery"
    assert second > 4, "it was restored in so many steps"


@SOME
@pytest.mark.parametrize("when", ["before a request arrives", "before it is answered"])
@pytest.mark.parametrize("how", ["cancelled", "the daemon ends"])
@virtually
async def test_who_ends_a_procedure_in_order_at_any_moment_finds_the_live_set_as_it_was(procedure, how, when, tmp_path):
    verb, fields = procedure
    changes, new = await count_changes(procedure, tmp_path)
    old, answers = FlightCtrl().live, set()
    for at in range(changes):
        world, ended = World(at), []
        async with Life(world, tmp_path) as life:

            def end(life=life, ended=ended):
                if how == "cancelled":
                    ended.append(asyncio.create_task(life.ask("cancel", {})))
                else:
                    life.task.cancel()

            def arrived(world=world, end=end, at=at):
                if world.changes == at + 1:
                    world.arrived = lambda: None
                    end()

            if when == "before a request arrives":
                world.what = end
            else:
                world.arrived = arrived
            answers.add(answer := await life.ask(verb, fields(world.board)))
            await asyncio.gather(*ended)
            if answer == "cancelled" and how == "cancelled":
                assert world.board.live == world.board.sets[3], f"change {at}: cancelled, and another set is live"
            if how == "cancelled":
                await wait_until(lambda life=life: life.is_idle, step=0.05)
        await live_on(world, tmp_path)
        assert_whole(world, tmp_path)
        assert world.board.live in ((old, new) if answer != "accepted" else (new,))
    assert "cancelled" in answers <= {"cancelled", "live_set_unproven", "accepted"}
