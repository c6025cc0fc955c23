"""The FlightCtrl's mixer: read it, or store one and compare what is stored.

Source: docs/protocol.md, "FlightCtrl commands".
"""

from __future__ import annotations

from mkdaemon.protocol.messages import Mixer, MixerRequest, MixerWritten, WriteMixer
from mkdaemon.protocol.procedures.steps import Patience, Procedure, Progress, Question, insist
from mkdaemon.protocol.wire import Board
from mkdaemon.telemetry.refusals import Token, refuse

ROWS = 16
"""Motors of a mixer; four numbers each: throttle, pitch, roll, yaw."""


def read_mixer(patience: Patience) -> Procedure[Mixer]:
    """Read the mixer.

    Raises:
        RequestTimeoutError: no answer; the FlightCtrl is older than 0.73, or the line is bad.
    """
    return (yield from insist(Question(Board.FC, MixerRequest(), (Mixer,), lambda _: True, "mixer"), patience))


def write_mixer(wanted: WriteMixer, patience: Patience) -> Procedure[Mixer]:
    """Store a mixer, read it back and compare. The FlightCtrl uses it at once.

    Raises:
        RequestTimeoutError: no answer.
        CommandRejectedError: `mixer_refused`; `mixer_differs`: do not fly.
    """
    slow = Patience(patience.attempts, max(patience.timeout, WriteMixer.spec.policy(Board.FC).timeout))
    yield Progress(0, 2, "storing the mixer")
    question = Question(Board.FC, wanted, (MixerWritten,), lambda _: True, "store the mixer")
    if not (yield from insist(question, slow)).stored:
        raise refuse(Token.MIXER_REFUSED)
    yield Progress(1, 2, "reading it back")
    stored = yield from read_mixer(patience)
    if (stored.name, stored.motors) != (wanted.name, wanted.motors):
        rows = [n + 1 for n in range(ROWS) if stored.motors[4 * n : 4 * n + 4] != wanted.motors[4 * n : 4 * n + 4]]
        raise refuse(Token.MIXER_DIFFERS, where=f"rows {rows}" if rows else "its name")
    yield Progress(2, 2, "stored and read back")
    return stored
