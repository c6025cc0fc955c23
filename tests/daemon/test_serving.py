"""What runs beside each other in the daemon, and how it ends: in virtual time, on a bus that only keeps."""

from __future__ import annotations

import asyncio
import json
from contextlib import asynccontextmanager
from types import MappingProxyType

import pytest

from lab.rigs.linkrig import virtually
from mkdaemon.clock import Clock
from mkdaemon.config.root import Config
from mkdaemon.daemon import program
from mkdaemon.daemon.flightnote import FlightNotes
from mkdaemon.daemon.program import Daemon, run
from mkdaemon.daemon.watchdog import Notifier
from mkdaemon.errors import LinkLostError
from mkdaemon.link.session.knownflight import FlightMemory, FlightState, Sighting
from mkdaemon.protocol.boards import Board
from mkdaemon.protocol.evidence import Evidence
from mkdaemon.protocol.generations import Release
from tests.daemon.procedures import procedure_rig
from tests.places import CAPTURES

RECORDING = CAPTURES / "nc_mixed_60s.jsonl"


class Bus(procedure_rig.Bus):
    """Keeps what is published; nobody asks and nobody listens."""

    def __init__(self, open_endpoints=()):
        super().__init__()
        self.shed, self.open_endpoints = {}, open_endpoints
        self.audience = asyncio.Event()

    async def refuse_uninvited(self):
        pass

    def counts(self):
        return {}

    def take_shed(self):
        shed, self.shed = self.shed, {}
        return shed

    def announce(self):
        pass

    async def wait_until_watched(self):
        await self.audience.wait()


class GuardStub:
    """A guard that is no process."""

    def __init__(self, report, *, clock):
        self.is_over = False

    def start(self):
        pass

    async def wait_for_start(self):
        pass

    async def watch(self):
        self.changed(True)
        await asyncio.Event().wait()

    def port_closed(self):
        pass

    async def stop(self):
        self.is_over = True


def daemon(folder, port, bus=None, *, guard=True, kind=Daemon, **link):
    cfg = Config.model_validate(
        {
            "vehicle": {"name": "t", "state_folder": folder},
            "link": {"port": port, **link},
            "bus": {"listen": ()},
            "control": {"guard": guard},
        }
    )
    loop = asyncio.get_running_loop()
    return kind(cfg, bus or Bus(), Clock(monotonic=loop.time))


@pytest.fixture
def recording(tmp_path):
    """The first frames of a recording."""
    path = tmp_path / "short.jsonl"
    path.write_text("".join(RECORDING.read_text(encoding="utf-8").splitlines(keepends=True)[:50]), encoding="utf-8")
    return f"replay:{path}"


@pytest.mark.parametrize("listens_at", [None, 60.0])
@virtually
async def test_a_recording_is_played_when_somebody_listens_or_after_a_while_and_ends_the_daemon(
    recording, tmp_path, listens_at
):
    bus, loop = Bus(), asyncio.get_running_loop()
    if listens_at is not None:
        loop.call_later(listens_at, bus.audience.set)
    served = daemon(tmp_path, recording, bus, wait_for_port=listens_at is not None)
    await served.serve(asyncio.Event(), Notifier({}))
    frames = bus.values("raw/rx")
    assert len(frames) > 10
    assert frames[0].stamp.monotonic >= (listens_at or program.AUDIENCE_WAIT)
    assert loop.time() > frames[-1].stamp.monotonic + program.SETTLE / 2
    assert bus.values("health")


@virtually
async def test_what_an_earlier_daemon_knew_of_a_flight_is_remembered_and_told(tmp_path):
    clock = Clock(monotonic=asyncio.get_running_loop().time)
    releases = MappingProxyType({Board.NC: Release(0, 24, 0), Board.FC: Release(2, 12, 0)})
    sighting = Sighting(0.0, FlightState.FLYING, 60.0, 500, None)
    memory = FlightMemory(Evidence(releases=releases), "v2", sighting)
    FlightNotes(tmp_path, "/dev/tty-nothing", clock).write(memory)
    bus, stop = Bus(), asyncio.Event()
    asyncio.get_running_loop().call_later(0.5, stop.set)
    served = daemon(tmp_path, "/dev/tty-nothing", bus, wait_for_port=True, guard=False)
    await served.serve(stop, Notifier({}))
    assert any("stopped in flight behind a NaviCtrl; FC 2.12a" in event.text for event in bus.values("event/log"))
    assert served._link.flight_memory.firmware == "2.12a"


@virtually
async def test_what_the_guard_of_an_earlier_daemon_did_is_told_once(recording, tmp_path):
    (tmp_path / "guard.json").write_text(json.dumps({"wall": 1.0, "text": "2 neutral and 40 release frames sent"}))
    for expected in (1, 0):
        bus = Bus()
        await daemon(tmp_path, recording, bus).serve(asyncio.Event(), Notifier({}))
        told = [
            event for event in bus.values("event/failsafe") if "an earlier daemon stopped in flight" in event.reason
        ]
        assert len(told) == expected
        assert all("40 release frames" in event.reason for event in told)


@virtually
async def test_what_everybody_may_reach_and_what_was_shed_is_told(tmp_path):
    bus, stop, loop = Bus(("tcp/0.0.0.0:7447",)), asyncio.Event(), asyncio.get_running_loop()
    loop.call_later(1.0, lambda: bus.shed.update({"queries to do/lease": 900}))
    loop.call_later(20.0, stop.set)
    await daemon(tmp_path, "/dev/tty-nothing", bus, wait_for_port=True, guard=False).serve(stop, Notifier({}))
    texts = [event.text for event in bus.values("event/log") if event.level == "warning"]
    assert any("tcp/0.0.0.0:7447 is open" in text for text in texts)
    assert len([text for text in texts if "900 queries to do/lease" in text]) == 1


@pytest.mark.parametrize("has_place", [True, False])
@virtually
async def test_without_a_place_for_the_guards_report_the_daemon_says_so_and_runs(monkeypatch, tmp_path, has_place):
    monkeypatch.setattr(program, "GuardProcess", GuardStub)
    folder = tmp_path / "state" / "t"
    if not has_place:
        folder.parent.write_text("")
    bus, stop = Bus(), asyncio.Event()
    asyncio.get_running_loop().call_later(2.0, stop.set)
    served = daemon(folder, "/dev/tty-nothing", bus, wait_for_port=True)
    await served.serve(stop, Notifier({}))
    assert served._guard.is_over
    assert folder.is_dir() is has_place
    texts = bus.texts()
    assert "guard runs" in texts
    told = [text for text in texts if "the next daemon will not get the guard's report" in text]
    assert [str(folder) in text for text in told] == [True] * (not has_place)


@virtually
async def test_the_port_is_opened_when_the_guard_answers(monkeypatch, tmp_path):
    opened = []

    class Slow(GuardStub):
        async def wait_for_start(self):
            await asyncio.sleep(2.0)
            opened.append("guard")

    class Opening(Daemon):
        async def _run_line(self):
            opened.append("port")
            await super()._run_line()

    monkeypatch.setattr(program, "GuardProcess", Slow)
    stop = asyncio.Event()
    asyncio.get_running_loop().call_later(4.0, stop.set)
    await daemon(tmp_path, "/dev/tty-nothing", kind=Opening, wait_for_port=True).serve(stop, Notifier({}))
    assert opened == ["guard", "port"]


def with_daemon(monkeypatch, error):
    """Let `run` serve something that ends with an error."""

    class Failing:
        def __init__(self, cfg, bus, clock, black_box, last_word, reloading):
            pass

        async def serve(self, stop, notifier):
            raise error

    @asynccontextmanager
    async def opened(cfg, vehicle, recorder, *, takes_images, private_images, positions):
        yield Bus()

    monkeypatch.setattr(program, "Daemon", Failing)
    monkeypatch.setattr(program.Bus, "open", opened)
    monkeypatch.setattr(program, "spare_collector", lambda: None)
    return Config.model_validate({"link": {"port": "/dev/tty-nothing"}})


@pytest.mark.parametrize("beside", [[], [LinkLostError("no serial port")]], ids=["alone", "beside an error"])
async def test_a_defect_among_the_tasks_is_never_hidden_behind_an_error(monkeypatch, beside):
    cfg = with_daemon(monkeypatch, ExceptionGroup("line", [*beside, RuntimeError("wires crossed")]))
    with pytest.raises(ExceptionGroup) as caught:
        await run(cfg, asyncio.Event())
    assert caught.group_contains(RuntimeError, match="wires crossed")
