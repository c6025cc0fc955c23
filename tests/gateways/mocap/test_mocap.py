"""The gateway to motion capture systems, before a library that is played: the real one needs a system."""

from __future__ import annotations

import asyncio
import math
import threading
from types import SimpleNamespace
from unittest.mock import Mock

import pytest

from lab.rigs.waiting import wait_until
from mkdaemon.clock import Clock
from mkdaemon.errors import ConfigError
from mkdaemon.gateways.mocap.gateway import Body, MocapGateway
from mkdaemon.gateways.mocap.systems import SYSTEMS, BodyPose, find_system, frames_of

HERE = BodyPose((1.0, 2.0, 0.5), (1.0, 0.0, 0.0, 0.0))
THERE = BodyPose((1.1, 2.0, 0.5), (1.0, 0.0, 0.0, 0.0))


class Sender:
    """Keeps what is put."""

    def __init__(self):
        self.sent, self.told = [], []

    def send(self, position, quaternion, *, age):
        self.sent.append((position, quaternion, age))

    def publish_health(self, health):
        self.told.append(health)


def gateway(*names, connect=lambda: iter(()), now=None):
    bodies = [Body(name, "mocap", Sender()) for name in names]
    lines = []
    return MocapGateway("vicon at there", connect, bodies, 0.004, lines.append, now or (lambda: 100.0)), bodies, lines


def test_each_body_goes_to_its_own_source_once_and_a_hidden_one_nowhere():
    made, (first, second), _ = gateway("a", "b")
    made.measured({"a": HERE, "c": THERE})
    assert first.sender.sent == [(HERE.position, HERE.quaternion, 0.004)]
    assert second.sender.sent == []
    assert (first.lost, second.lost) == (0, 1)
    made, (body,), _ = gateway("a")
    for pose in (HERE, HERE, THERE):
        made.measured({"a": pose})
    assert [sent[0] for sent in body.sender.sent] == [HERE.position, THERE.position]
    assert body.lost == 1


def test_health_has_rate_losses_and_who_is_seen_or_that_nothing_is():
    now = Mock(return_value=100.0)
    made, (body,), _ = gateway("a", now=now)
    for k in range(50):
        now.return_value += 0.01
        made.measured({"a": BodyPose((k * 0.001, 0.0, 0.0), HERE.quaternion)} if k % 5 else {"z": HERE})
    health = made.health_of(body, Clock())
    assert (health.rate, health.frames, health.lost, health.seen) == (40.0, 50.0, 10, ("a",))
    assert health.reason == ""
    made, (body,), _ = gateway("dron7", now=now)
    made.measured({"drone7": HERE})
    assert made.health_of(body, Clock()).reason == ""
    now.return_value += 4.0
    made.measured({"drone7": HERE, "wand": THERE})
    assert made.health_of(body, Clock()).reason == "body 'dron7' is not seen; bodies that are: drone7, wand"
    made, (body,), _ = gateway("a", now=now)
    made.measured({"a": HERE})
    now.return_value += 2.0
    assert "vicon at there sends nothing" in made.health_of(body, Clock()).reason


async def test_a_lost_system_is_reached_again_and_says_so(monkeypatch):
    monkeypatch.setattr("mkdaemon.gateways.mocap.gateway.RETRIES", (0.001,))
    monkeypatch.setattr("mkdaemon.gateways.mocap.gateway.HEALTH", 0.01)
    attempts, ended = [], threading.Event()

    def connect():
        attempts.append(1)
        if len(attempts) == 1:
            raise RuntimeError("no route")
        yield {"a": BodyPose((float(len(attempts)), 0.0, 0.0), HERE.quaternion)}
        if len(attempts) == 2:
            raise RuntimeError("the connection was lost")
        ended.wait(10.0)

    made, (body,), lines = gateway("a", connect=connect, now=None)
    running = asyncio.create_task(made.run())
    await wait_until(lambda: len(body.sender.sent) == 2 and body.sender.told)
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)
    ended.set()  # after the gateway's end: its thread says nothing any more
    again = [f"vicon at there: {why}; next attempt in 0.001 s" for why in ("no route", "the connection was lost")]
    assert [line for line in lines if line.startswith("vicon")] == again
    assert made.reconnections >= 2


class Library:
    """The library as documented: `connect`, `waitForNextFrame`, `rigidBodies`."""

    __version__ = "1.1"

    def __init__(self, *frames, unknown=False):
        self.frames, self.unknown, self.asked = list(frames), unknown, None

    def connect(self, kind, options):
        if self.unknown:
            raise RuntimeError("Unknown motion capture type!")
        self.asked = kind, options
        return self

    def waitForNextFrame(self):
        if not self.frames:
            raise RuntimeError("the end")
        self.rigidBodies = self.frames.pop(0)


def body(*position, w=1.0):
    return SimpleNamespace(position=position, rotation=SimpleNamespace(w=w, x=0.0, y=0.0, z=0.0))


def test_bodies_are_read_and_hidden_ones_left_out():
    hidden = {"nan": body(math.nan, 0.0, 0.0), "zero": body(0.0, 0.0, 0.0), "none": body(1, 1, 1, w=0.0)}
    library = Library({"a": body(1.0, 2.0, 0.5)} | hidden)
    frames = frames_of(library, find_system("vicon"), "there")
    assert next(frames) == {"a": HERE}
    assert library.asked == ("vicon", {"hostname": "there"})
    with pytest.raises(RuntimeError, match="the end"):
        next(frames)


async def test_a_kind_that_the_library_was_built_without_ends_the_gateway(monkeypatch):
    monkeypatch.setattr("mkdaemon.gateways.mocap.gateway.HEALTH", 0.01)
    made, _, _ = gateway("a", connect=lambda: frames_of(Library(unknown=True), find_system("fzmotion"), "x"))
    with pytest.raises(ConfigError, match="built without fzmotion: use another protocol"):
        await made.run()


def test_systems_have_their_own_words_and_a_wrong_one_lists_them():
    assert len({system.word for system in SYSTEMS}) == len(SYSTEMS)
    with pytest.raises(ConfigError, match="'vicom' is no motion capture system: vicon, optitrack"):
        find_system("vicom")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["vicon", "x"], "name at least one body"),
        (["vicon", "x", "--body", "a"], "write BODY=VEHICLE"),
        (["vicon", "x", "--body", "a=mk1", "--latency-ms", "900"], "0 to 500"),
        (["vicon", "x", "--body", "a=mk1", "--secret-file", "/nowhere/secret"], "secret_file"),
    ],
)
def test_a_mistake_on_the_command_line_is_one_line(arguments, words):
    from mkdaemon.cli.mkdaemon.gateway import app

    with pytest.raises(ConfigError, match=words):
        app(["mocap", *arguments], exit_on_error=False, result_action="return_value")
