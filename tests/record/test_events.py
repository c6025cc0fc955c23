"""Everything that the flight core can be told comes back from a recording as it was, without the secret of a lease."""

from __future__ import annotations

import msgpack
import pytest

from mkdaemon.control.activeset import Gate, GateKind, KnownSet
from mkdaemon.control.estimator.model import AircraftModel
from mkdaemon.control.events import (
    DUE,
    NOTED,
    AbortAsked,
    ActiveSetRead,
    CellsKnown,
    ClientGone,
    Event,
    EyeStats,
    FrameNotSent,
    FreeDisk,
    GuardActed,
    GuardChanged,
    LeaseAsked,
    LineChanged,
    LinkMeasured,
    LinkVerdict,
    ListChanged,
    ModelKnown,
    MotorTestSent,
    PathUploaded,
    PoseSeen,
    ReleaseAsked,
    Released,
    Reply,
    SetpointAccepted,
    SetpointUnreadable,
    SetpointUnsigned,
    SightRefused,
)
from mkdaemon.errors import MkError
from mkdaemon.record.entry import EntryKind
from mkdaemon.record.events import DERIVED, TICK, pack_event, suffix_of, unpack_event
from mkdaemon.record.reader import Recording
from mkdaemon.telemetry.command import AbortRequest, LeaseRequest, ReleaseRequest
from mkdaemon.telemetry.control import ControlLine, LeaseGrant, Obstacle, ReleaseOutcome
from mkdaemon.telemetry.link import LinkHealth, LinkState
from mkdaemon.telemetry.path import PathPiece, PathPoint, PathUploadRequest
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.setpoint import PositionSetpoint, StickSetpoint
from mkdaemon.telemetry.vision import PoseRefused, VisionPose, VisionStats
from tests.places import DATA

KEY = b"k" * 16
STICKS = StickSetpoint(epoch=7, sequence=3, ttl=0.3, pitch=1.5, roll=0, yaw=0, throttle=-1)
ERROR = refuse(Token.NOT_LEASED)


def recorded(suffix, model):
    """A value of the recording over a target."""
    for entry in Recording(DATA / "recordings" / "fc_over_target.mcap").entries():
        if entry.kind is EntryKind.SAMPLE and entry.suffix == suffix:
            return model.model_validate(msgpack.unpackb(entry.payload))
    raise AssertionError(suffix)


REFUSED = {"camera": "down", "sequence": 7, "stamped_by": "driver", "target": "pad", "refusal": "off_course"}
REFUSED |= {"decode_age": 0.4, "has_attitude": False}


PATH = (PathPoint(position=(0.0, 0.0, 2.0)), PathPoint(position=(1.0, 0.0, 2.0), speed=0.5, stop=1.0))


def events():
    asked = LeaseRequest(action="take", holder="pilot")
    found = KnownSet(Gate(GateKind.CHANNEL, 251, 7), "Sport", emergency_throttle=None)
    return [
        SetpointAccepted(STICKS, 7),
        SetpointUnsigned(PositionSetpoint(epoch=1, sequence=2, ttl=0.2, frame="pad", position=(0.0, 1.0, 2.0))),
        SetpointUnreadable("setpoint/stick", {"pitch": "x", "more": [1, b"\x00"]}, ERROR, False),
        LeaseAsked(asked, ""),
        LeaseAsked(asked, "", found),
        ReleaseAsked(ReleaseRequest(reason="enough")),
        AbortAsked(AbortRequest(reason="enough")),
        PathUploaded(PathUploadRequest(points=PATH)),
        PathUploaded(PathUploadRequest(pieces=(PathPiece(duration=2.0, x=(0.0, 0.1), y=(1.0,), z=(2.0,)),))),
        CellsKnown(4),
        ClientGone("pilot"),
        MotorTestSent(),
        ListChanged(),
        PoseSeen(recorded("vision/down/pose", VisionPose)),
        SightRefused(PoseRefused(stamp=recorded("vision/down/pose", VisionPose).stamp, **REFUSED)),
        EyeStats(recorded("vision/down/stats", VisionStats)),
        FreeDisk(None),
        FreeDisk(1e9),
        ModelKnown(AircraftModel(rad_per_count=0.1)),
        ActiveSetRead(found),
        LineChanged(ControlLine("v2", Obstacle.DEAF, "busy", 0.02)),
        LinkVerdict(recorded("link/state", LinkState)),
        LinkMeasured(recorded("link/health", LinkHealth)),
        FrameNotSent(ERROR),
        GuardChanged(True),
        GuardActed(),
        Released(ReleaseOutcome.CONFIRMED),
        Released(None),
    ]


def as_fields(event):
    """An event by its fields; an exception is equal to none but itself."""
    return {name: str(getattr(event, name)) for name in type(event).__slots__}


@pytest.mark.parametrize("event", events(), ids=lambda event: type(event).__name__)
def test_an_event_comes_back_as_it_was(event):
    found = unpack_event(suffix_of(event), pack_event(event, NOTED, KEY))
    assert type(found) is type(event)
    assert as_fields(found) == as_fields(event)


def test_every_event_is_recorded_or_follows_from_bytes():
    # By name: a dataclass with slots is made of another class of this name, which may never be collected.
    made = {type(event).__name__ for event in events()} | {kind.__name__ for kind in DERIVED}
    assert made == {kind.__name__ for kind in Event.__subclasses__()}
    assert TICK not in {suffix_of(event) for event in events()}


def test_the_secret_of_a_lease_is_replaced_by_the_same_word_everywhere():
    taken = LeaseAsked(LeaseRequest(action="take", holder="pilot"), "top")
    grant = LeaseGrant(holder="pilot", epoch=7, ttl=1.0, left=1.0, secret="top")
    renewed = LeaseAsked(LeaseRequest(action="renew", epoch=7, secret="top"), "next")
    guessed = LeaseAsked(LeaseRequest(action="renew", epoch=7, secret="tip"), "")
    packed = [pack_event(taken, Reply(lease=grant), KEY), pack_event(renewed, DUE, KEY), pack_event(guessed, None, KEY)]
    assert not any(b"top" in payload or b"tip" in payload for payload in packed)
    first, second, third = (unpack_event(suffix_of(taken), payload) for payload in packed)
    assert first.secret == second.request.secret != third.request.secret
    assert msgpack.unpackb(packed[0])["reply"]["lease"]["secret"] == first.secret
    assert pack_event(first, Reply(lease=grant.model_copy(update={"secret": first.secret}))) == packed[0]
    assert pack_event(taken, NOTED, b"another recording") != pack_event(taken, NOTED, KEY)


@pytest.mark.parametrize(
    ("suffix", "payload"),
    [
        ("core/NoSuchEvent", b"\x80"),
        ("core/ClientGone", b"\xc1"),
        ("core/ClientGone", msgpack.packb({"event": {}})),
        ("core/FreeDisk", msgpack.packb({"event": {"free": "much"}})),
        ("core/SetpointAccepted", msgpack.packb({"event": {"setpoint": {}, "signed_for": 1}})),
    ],
)
def test_an_event_of_another_version_is_refused_in_a_line(suffix, payload):
    with pytest.raises(MkError, match="not as the event is today"):
        unpack_event(suffix, payload)
