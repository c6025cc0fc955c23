"""Pause and speed of a player, for those who look at what it plays: asked for over the bus."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

import zenoh

from mkdaemon.bus.answers import AnswerThread
from mkdaemon.bus.callbacks import direct
from mkdaemon.bus.codec import encode, encoding_of, read_command
from mkdaemon.bus.names import REPLAY
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.command import CommandResult, refused
from mkdaemon.telemetry.play import PlayControl, PlayStatus

_QUERIES: Final = 16
"""That may wait for an answer."""
_LONGEST: Final = 256
"""An honest request has 30 bytes."""


def control_key(vehicle: str) -> str:
    """The key at which the player of a vehicle is asked."""
    return f"{REPLAY}/control/{vehicle}"


def status_key(vehicle: str) -> str:
    """The key at which the player of a vehicle says how far it is."""
    return f"{REPLAY}/status/{vehicle}"


@contextmanager
def answer_controls(session: zenoh.Session, vehicle: str, obey: Callable[[PlayControl], PlayStatus]) -> Iterator[None]:
    """Let a player be paused, and its speed changed, while the context lasts.

    Args:
        session: where it is asked for.
        vehicle: that is played.
        obey: does it and returns the status; called on a separate thread.
    """
    answers = AnswerThread("play.controls", limit=_QUERIES, limit_per_key=_QUERIES)
    key = control_key(vehicle)

    def answer(query: zenoh.Query) -> None:
        payload = b"" if query.payload is None else query.payload.to_bytes()
        try:
            if len(payload) > _LONGEST:
                payload = b""
            status = obey(read_command(PlayControl, payload))
        except CommandRejectedError as refusal:
            query.reply(key, encode(refused(refusal)), encoding=encoding_of(CommandResult))
            return
        query.reply(key, encode(status), encoding=encoding_of(PlayStatus))

    def on_query(query: zenoh.Query) -> None:
        answers.submit(query, answer)

    handler = direct(on_query)
    with session.declare_queryable(key, handler):
        try:
            yield
        finally:
            answers.close()
