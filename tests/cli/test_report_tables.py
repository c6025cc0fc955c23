"""The message tables of the 2010 report, row by row: typed request and answer, key, CLI form, and a board that obeys.

Where a request has no answer, the board's state shows that it was obeyed.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import NamedTuple

import pytest

import mkdaemon.protocol.messages as m
from lab.rigs.grounded import GroundedAircraft
from lab.rigs.virtualline import Noise, VirtualLine
from mkdaemon.cli.mkctl.send import FORMS
from mkdaemon.client.samples import message_from
from mkdaemon.protocol.flags import ControlConfig, MotorControllerItems, NaviParameterId, PositionStatus, RedirectPort
from mkdaemon.protocol.messages.blctrl import motor_controller_checksum
from mkdaemon.protocol.procedures.steps import Patience, Pause, Procedure, ask
from mkdaemon.protocol.procedures.steps import Question as Asked
from mkdaemon.protocol.wire import MESSAGES, Board, WireMessage
from mksim.boards.flightctrl import FlightCtrl
from mksim.boards.generations import FC_GENERATIONS, NC_GENERATIONS
from mksim.boards.navictrl import NaviCtrl


class Boards:
    """A FlightCtrl, with or without the NaviCtrl in front, and the line to it."""

    def __init__(self, board: Board) -> None:
        self.fc = FlightCtrl(FC_GENERATIONS["2.12a"], GroundedAircraft(), seed=1)
        self.nc = NaviCtrl(NC_GENERATIONS["0.24"], self.fc, seed=1) if board is Board.NC else None
        self.line = VirtualLine(self.nc or self.fc, Noise(), random.Random(1))
        self.line.run(_wait(0.05))

    def ask(self, board: Board, message: WireMessage, kinds: tuple[type[WireMessage], ...]) -> WireMessage | None:
        question = Asked(board, message, kinds or (WireMessage,), lambda answer: bool(kinds), message.spec.key)
        return self.line.run(ask(question, Patience(attempts=2, timeout=1.0)))


def _wait(seconds: float) -> Procedure[None]:

    yield Pause(seconds)


class Row(NamedTuple):
    """One row of the report.

    Attributes:
        name: as the report has it.
        board: the board that answers.
        request: an example.
        answers: classes of the answer; empty where there is none.
        shows: what the answer, or the board without one, must show.
    """

    name: str
    board: Board
    request: WireMessage
    answers: tuple[type[WireMessage], ...]
    shows: Callable[[Boards, WireMessage], object]


FC, NC = Board.FC, Board.NC
POINT = m.WriteWaypoint024(
    longitude=87912345, latitude=530712345, altitude=150, status=PositionStatus.NEW, index=1, altitude_rate=30
)
TARGET = m.SendTarget024.decode(POINT.encode())
BL = m.WriteMotorController(
    motor=1, items=MotorControllerItems.CURRENT_LIMIT, pwm_scaling=255, current_limit=22,
    temperature_limit=99, current_scaling=64, bits=0, checksum=0,
)  # fmt: skip
BL = BL.model_copy(update={"checksum": motor_controller_checksum(BL.encode()[1:8])})
EASY = FlightCtrl(FC_GENERATIONS["2.12a"], GroundedAircraft(), seed=1).eeprom.sets[3]
MIXER = m.WriteMixer(name="Mine", motors=(64, 64, 0, 64, 64, -64, 0, 64) + (0,) * 56)
STICKS = m.ExternControlV2(pitch=10, roll=-5, yaw=3, throttle=0, frame=7, config=ControlConfig.VALID)

ROWS = [
    # Common commands
    Row("Analog Values", FC, m.LabelRequest(index=9), (m.Label,), lambda b, a: a.index == 9 and a.text),
    Row("ExternControl", FC, STICKS, (m.ControlConfirm,), lambda b, a: a.frame == 7),
    Row("Request Display (h)", FC, m.DisplayRequest(), (m.Display,), lambda b, a: len(a.text) == 80),
    Row("Request Display (l)", FC, m.MenuRequest(page=1), (m.Menu,), lambda b, a: a.page == 1),
    Row("Version", FC, m.VersionRequest(), (m.VersionFc210,), lambda b, a: a.release == "2.12a"),
    Row("Debug Request", FC, m.DebugRequest(interval=50), (m.DebugDataFc,), lambda b, a: len(a.analog) == 32),
    Row("Reset", FC, m.Reset(), (), lambda b, a: _is_rebooting(b)),
    Row("Get ExternControl", FC, m.ControlStateRequest(), (m.ControlStateV2,), lambda b, a: a.config == 0),
    # FlightCtrl
    Row("Compass Heading", FC, m.CompassHeading(heading=123), (), lambda b, a: b.fc.forced_heading == 123),
    Row("Engine Test", FC, m.MotorTest(motors=(20, *(0,) * 15)), (m.MotorTestDone,), lambda b, a: True),
    Row(
        "Settings Request",
        FC,
        m.SettingsRequest(index=255),
        (m.Settings,),
        lambda b, a: a.parameters[:144] == b.fc.live.raw,
    ),
    Row(
        "Write Settings",
        FC,
        m.WriteSettings(index=4, parameters=EASY),
        (m.SettingsWritten,),
        lambda b, a: a.index == b.fc.eeprom.active == 4,
    ),
    Row("Read PPM Channels", FC, m.ReceiverRequest(), (m.Receiver200,), lambda b, a: len(a.channels) == 35),
    Row("Set 3D-Data Interval", FC, m.AttitudeRequest(interval=10), (m.AttitudeDataFc210,), lambda b, a: a.pitch == 0),
    Row("Mixer Request", FC, m.MixerRequest(), (m.Mixer,), lambda b, a: a.motors[:4] == (64, 64, 0, 64)),
    Row(
        "Mixer Write", FC, MIXER, (m.MixerWritten,), lambda b, a: a.stored == 1 and b.fc.eeprom.mixer == MIXER.encode()
    ),
    Row(
        "Change Setting",
        FC,
        m.SelectSettings(index=2),
        (m.SettingsSelected,),
        lambda b, a: b.fc.live.raw == b.fc.eeprom.sets[2],
    ),
    Row(
        "Serial Poti", FC, m.SerialChannels(channels=(100, *(0,) * 11)), (), lambda b, a: b.fc.serial_channels[0] == 100
    ),
    Row(
        "BL Parameter Request",
        FC,
        m.MotorControllerRequest(motor=1),
        (m.MotorController,),
        lambda b, a: a.done == 1 and a.motor == 1,
    ),
    Row(
        "BL Parameter Write",
        FC,
        BL,
        (m.MotorControllerWritten,),
        lambda b, a: a.done == 1 and b.fc.eeprom.motor_configs[0][3] == 22,
    ),
    # NaviCtrl
    Row("Serial Link Test", NC, m.EchoRequest(pattern=0x5AA5), (m.Echo,), lambda b, a: a.pattern == 0x5AA5),
    Row("Error Text", NC, m.ErrorTextRequest(), (m.ErrorText,), lambda b, a: a.text),
    Row("Send Target Position", NC, TARGET, (), lambda b, a: b.nc and b.nc.navigator.points.count == 1),
    Row("Send Waypoint", NC, POINT, (m.WaypointWritten,), lambda b, a: a.index == b.nc.navigator.points.count == 1),
    Row("Request Waypoint", NC, m.WaypointRequest(index=1), (m.WaypointCount,), lambda b, a: a.count == 0),
    Row("Request OSD-Data", NC, m.OsdRequestV1(interval=50), (m.OsdData5,), lambda b, a: a.version == 5),
    Row("Redirect UART", NC, m.Redirect(port=RedirectPort(0)), (), lambda b, a: _answers_fc(b)),
    Row(
        "3D-Data Interval (NC)",
        NC,
        m.AttitudeRequest(interval=10),
        (m.AttitudeDataNc, m.AttitudeDataNcSticks),
        lambda b, a: a.pitch == 0,
    ),
    Row(
        "Get NC-Param",
        NC,
        m.NaviParameterRequest(id=NaviParameterId.TARGET_SPEED),
        (m.NaviParameter,),
        lambda b, a: a.id == NaviParameterId.TARGET_SPEED and _keeps_parameter(b),
    ),
    Row(
        "Set NC-Param",
        NC,
        m.WriteNaviParameter(id=NaviParameterId.TARGET_SPEED, value=25),
        (m.NaviParameter,),
        lambda b, a: a.value == b.nc.parameters[0] == 25,
    ),
]


def _is_rebooting(boards: Boards) -> bool:
    """A reset FlightCtrl answers nothing for its start of 5 s, and then again."""
    silent = boards.ask(FC, m.VersionRequest(), (m.VersionFc210,)) is None
    boards.line.run(_wait(6.0))
    return silent and boards.ask(FC, m.VersionRequest(), (m.VersionFc210,)) is not None


def _keeps_parameter(boards: Boards) -> bool:
    """What was never set answers garbage; what was set answers itself."""
    target = NaviParameterId.TARGET_SPEED
    boards.ask(NC, m.WriteNaviParameter(id=target, value=-3), (m.NaviParameter,))
    answer = boards.ask(NC, m.NaviParameterRequest(id=target), (m.NaviParameter,))
    return isinstance(answer, m.NaviParameter) and answer.value == -3


def _answers_fc(boards: Boards) -> bool:
    """Behind the redirected port the FlightCtrl answers."""
    return boards.ask(FC, m.VersionRequest(), (m.VersionFc210,)) is not None


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_every_row_is_typed_keyed_sent_and_answered(row: Row) -> None:
    spec = row.request.spec
    assert MESSAGES[row.board, spec.id, spec.layout] is type(row.request)
    form = FORMS[spec.key]
    assert row.board in form.boards
    assert form.command == spec.key.replace("_", "-")
    assert {slot.name for slot in spec.slots} >= {field.name for field in form.fields if field.is_required}
    assert (spec.reply is None) == (not row.answers) or row.name == "Compass Heading"

    boards = Boards(row.board)
    answer = boards.ask(row.board, row.request, row.answers)
    if not row.answers:
        assert answer is None
        assert row.shows(boards, row.request)
        return
    assert isinstance(answer, row.answers)
    assert answer.spec.id == spec.reply
    assert row.shows(boards, answer)
    # What the daemon puts on the bus becomes the same message again at the client.
    assert message_from(f"{type(answer).__name__}.v1", dict(answer.__dict__)) == answer


def test_the_rows_cover_every_request_of_the_report() -> None:
    asked = {(row.board, row.request.spec.id) for row in ROWS}
    assert {letter for board, letter in asked if board is FC} == set("abhlvdRgKtqspcnmfyuw")
    assert {letter for board, letter in asked if board is NC} == set("zeswxoucj")
