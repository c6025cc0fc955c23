"""Mixer, motor controllers and labels: read, stored, read back, compared; what a board refuses or changes is told."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from mkdaemon.errors import CommandRejectedError, RequestTimeoutError
from mkdaemon.protocol.flags import MotorControllerItems, MotorControllerStatus
from mkdaemon.protocol.messages import (
    Label,
    LabelRequest,
    Mixer,
    MixerRequest,
    MixerWritten,
    MotorController,
    MotorControllerRequest,
    MotorControllerWritten,
    NaviVersionClassic,
    VersionFc210,
    VersionRequest,
    WriteMixer,
    WriteMotorController,
)
from mkdaemon.protocol.messages.blctrl import motor_controller_checksum
from mkdaemon.protocol.procedures import Patience
from mkdaemon.protocol.procedures.labels import read_labels
from mkdaemon.protocol.procedures.mixer import write_mixer
from mkdaemon.protocol.procedures.motor_controllers import change_motor_controller, configure
from mkdaemon.protocol.wire import Board, WireMessage

from .talk import Reply, drive

PATIENCE = Patience(2)
WANTED = WriteMixer(name="Quadro", motors=(64, 64, 0, 64) * 16)
OTHER = (64, 64, 0, 64) * 15 + (1, 2, 3, 4)


def mixer_board(stored: int, name: str, motors: tuple[int, ...]) -> Callable[[WireMessage], Reply]:
    def answer(message: WireMessage) -> Reply:
        if isinstance(message, WriteMixer):
            return MixerWritten(stored=stored)
        assert isinstance(message, MixerRequest)
        return Mixer(name=name, motors=motors)

    return answer


def test_a_mixer_is_stored_and_read_back() -> None:
    stored = drive(write_mixer(WANTED, PATIENCE), mixer_board(1, "Quadro", WANTED.motors))
    assert (stored.name, stored.motors) == ("Quadro", WANTED.motors)


@pytest.mark.parametrize(
    ("board", "words"),
    [
        (mixer_board(0, "Quadro", WANTED.motors), "mixer_refused"),
        (mixer_board(1, "Quadro", OTHER), r"mixer_differs: .*rows \[16\]"),
        (mixer_board(1, "Hexa", WANTED.motors), "mixer_differs: .*its name"),
    ],
)
def test_a_mixer_that_is_not_the_one_sent_is_told(board: Callable[[WireMessage], Reply], words: str) -> None:
    with pytest.raises(CommandRejectedError, match=words):
        drive(write_mixer(WANTED, PATIENCE), board)


def controller_board(*, read: int = 1, written: int = 1, keeps: bool = True) -> Callable[[WireMessage], Reply]:
    state = {"current_limit": 30}

    def answer(message: WireMessage) -> Reply:
        if isinstance(message, WriteMotorController):
            if keeps:
                state["current_limit"] = message.current_limit
            return MotorControllerWritten(done=written, status=MotorControllerStatus.MOTORS_RUNNING)
        assert isinstance(message, MotorControllerRequest)
        found = MotorController.decode(bytes((read, 1, message.motor, 2, 0, 255, 30, 99, 64, 0, 7)))
        return found.model_copy(update=state)

    return answer


def test_a_motor_controller_is_changed_and_read_back() -> None:
    procedure = change_motor_controller(3, {"current_limit": 20}, PATIENCE, reverse=None, save=False)
    assert drive(procedure, controller_board()).current_limit == 20


@pytest.mark.parametrize(
    ("board", "words"),
    [
        (controller_board(read=0), "motor_controller_refused: motor controller 3"),
        (controller_board(written=0), "motor_controller_refused: motor controller 3: motors running"),
        (controller_board(keeps=False), "motor_controller_differs: motor controller 3: current_limit is 30, not 20"),
    ],
)
def test_a_motor_controller_that_does_not_follow_is_told(board: Callable[[WireMessage], Reply], words: str) -> None:
    with pytest.raises(CommandRejectedError, match=words):
        drive(change_motor_controller(3, {"current_limit": 20}, PATIENCE, reverse=None, save=False), board)


PRESENT = MotorController.decode(bytes((1, 0, 3, 2, 0, 255, 30, 99, 64, 0x02, 7)))
NOTHING: dict[str, int | None] = dict.fromkeys(["pwm_scaling", "current_limit", "temperature_limit", "current_scaling"])


@pytest.mark.parametrize(
    ("given", "reverse", "save", "items"),
    [
        ({"current_limit": 20}, None, False, MotorControllerItems.CURRENT_LIMIT),
        ({"pwm_scaling": 200}, None, True, MotorControllerItems.PWM_SCALING | MotorControllerItems.SAVE),
        ({}, True, False, MotorControllerItems.BITS),
        ({"temperature_limit": 0}, False, False, MotorControllerItems.TEMPERATURE_LIMIT | MotorControllerItems.BITS),
    ],
)
def test_only_what_is_given_is_applied(
    given: dict[str, int], reverse: bool | None, save: bool, items: MotorControllerItems
) -> None:
    write = configure(PRESENT, {**NOTHING, **given}, reverse=reverse, save=save)
    assert write.items == items
    assert (write.motor, write.revision) == (3, 2)
    assert write.checksum == motor_controller_checksum(write.encode()[1:8])
    for name in NOTHING:
        assert getattr(write, name) == given.get(name, getattr(PRESENT, name))


NAMES = tuple(f"Channel {index}" for index in range(32))
CHECKSUM = sum(sum(name.ljust(16).encode()) for name in NAMES) & 0xFF


def fc_version(checksum: int) -> WireMessage:
    return VersionFc210.decode(bytes((2, 12, 11, checksum, 0, 0, 0, 22, 103, 1)))


NC_VERSION = NaviVersionClassic.decode(bytes((0, 24, 11, 0, 1, 0, 0, 0, 0, 0)))


def read_from(board: Board, version: WireMessage, names: tuple[str, ...] = NAMES) -> tuple[str, ...]:
    """Read the labels of a board of some version that tells these names."""

    def talk(request: WireMessage) -> Reply:
        if isinstance(request, VersionRequest):
            return version
        known = isinstance(request, LabelRequest) and request.index < len(names)
        return Label(index=request.index, text=names[request.index]) if known else None

    return drive(read_labels(board, Patience(2)), talk)


@pytest.mark.parametrize(("board", "version"), [(Board.FC, fc_version(CHECKSUM)), (Board.NC, NC_VERSION)])
def test_all_labels_have_the_checksum_where_the_board_tells_one(board: Board, version: WireMessage) -> None:
    assert read_from(board, version) == NAMES


def test_a_wrong_checksum_and_silence_are_named() -> None:
    with pytest.raises(CommandRejectedError, match="labels_inconsistent: the checksum of the labels differs"):
        read_from(Board.FC, fc_version(CHECKSUM ^ 1))
    with pytest.raises(RequestTimeoutError, match="label 0: no answer from the FC in 2 attempts"):
        read_from(Board.FC, fc_version(0), ())
