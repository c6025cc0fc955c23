"""An event of every kind, which the reading puts in words and every screen and gateway shows."""

from __future__ import annotations

from mkdaemon.telemetry.event import ClockEvent, CommandEvent, FailsafeEvent, LogEvent, ModeEvent
from mkdaemon.telemetry.mission import MissionEvent
from mkdaemon.telemetry.procedure import ProcedureProgress, ProcedureState
from mkdaemon.telemetry.record import MarkEvent
from tests.values import made

ACCEPTED = made(CommandEvent, key="do/rates", fields={"stream": "osd", "secret": "s"}, status="accepted")
REFUSED = made(
    CommandEvent, key="do/land", status="denied", token="no_target", reason="no target is seen.", fix="Look."
)
MODE = made(ModeEvent, before="free", after="leased", reason="anna took it")
FAILSAFE = made(FailsafeEvent, action="release", reason="silence", released=True)
WARNING = made(LogEvent, level="warning", text="the disk is\nslow")
ERROR = made(LogEvent, level="error", text="the disk is gone")
INFO = made(LogEvent, level="info", text="hello")
MARK = made(MarkEvent, text="here")
CLOCK = made(ClockEvent, step=-1.5)
UPLOADED = made(MissionEvent, action="uploaded", count=3)
INCOMPLETE = made(MissionEvent, action="incomplete", count=2)
RUNNING = made(ProcedureProgress, verb="backup", step=1, of=5, state=ProcedureState.RUNNING, text="set 1")
