"""What is played, for those who ask: last values with the age they had at that moment, schemas, and no command.

A vehicle that is played under `mk/<name>/` answers as its daemon did, so that `mkctl --vehicle <name> status` shows it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Final

import zenoh

from mkdaemon.bus.answers import AnswerThread
from mkdaemon.bus.callbacks import direct
from mkdaemon.bus.codec import encode, encoding_of, with_age
from mkdaemon.bus.keys import Use, find
from mkdaemon.bus.schema import schema_json, schema_names
from mkdaemon.client.playselection import Played, PlaySelection
from mkdaemon.telemetry.command import CommandResult, refused
from mkdaemon.telemetry.refusals import Token, refuse

PLAYING: Final = "playing"
"""Liveliness token below everything that is played. Not `alive`: a daemon that comes up beside it must be seen."""
PAST: Final = "past"
"""Parameter of a query: all values from this time before the played place on [s]; without it the last ones."""
AHEAD: Final = "ahead"
"""Likewise, up to this time after it."""
LONGEST: Final = 1e9
"""Of both [s]."""
_COMMANDS: Final = frozenset({"do", "cmd"})
_QUERIES: Final = 64
"""Questions that may wait for an answer; a quarter of them of one key."""


class PlayedValues:
    """The last values of what is played."""

    def __init__(self, session: zenoh.Session, selection: PlaySelection, place: Callable[[], float]) -> None:
        """Know nothing yet.

        Args:
            session: where they are asked for.
            selection: what is played.
            place: how far the recording has come [s; Unix time].
        """
        self._session, self._selection, self._place = session, selection, place
        self._last: dict[str, Played] = {}
        self._roots = sorted({"/".join(key.split("/")[:2]) for key in selection.counts})

    def restart(self, at: float) -> None:
        """Know what was recorded before a time [s; Unix time], and nothing else."""
        self._last = {played.key.whole: played for played in self._selection.before(at)}

    def take(self, played: Played) -> None:
        """Know one more; on the thread that plays."""
        self._last[played.key.whole] = played

    @contextmanager
    def answering(self, asked: Callable[[], None]) -> Iterator[None]:
        """Answer while the context lasts, and show the names that are played under.

        Args:
            asked: hears of every question; called on Zenoh's threads.
        """
        answers = AnswerThread("play.answers", limit=_QUERIES, limit_per_key=_QUERIES // 4)

        def on_query(query: zenoh.Query) -> None:
            asked()
            answers.submit(query, self._answer)

        handler = direct(on_query)
        with ExitStack() as stack:
            stack.callback(answers.close)
            for root in self._roots:
                stack.enter_context(self._session.declare_queryable(f"{root}/**", handler))
                stack.enter_context(self._session.liveliness().declare_token(f"{root}/{PLAYING}"))
            yield

    def _answer(self, query: zenoh.Query) -> None:
        asked = str(query.key_expr)
        suffix = asked.split("/", 2)[-1]
        spec = find(suffix)
        is_command = suffix.partition("/")[0] in _COMMANDS or (spec is not None and spec.use is Use.QUERY)
        if is_command and not suffix.startswith("schema/") and "*" not in asked:
            query.reply(asked, encode(refused(refuse(Token.RECORDING))), encoding=encoding_of(CommandResult))
            return
        place = self._place()
        around = self._span(query, place)
        last = {whole: one for whole, one in list(self._last.items()) if query.key_expr.intersects(whole)}
        for at, key, entry in [*(last[whole] for whole in last.keys() - {one.key.whole for one in around}), *around]:
            stamp = entry.stamp
            # As old as it was when it was put, and what has passed in the recording since then.
            delay = entry.received - stamp.monotonic if stamp.boot == entry.base.boot else 0.0
            query.reply(key.whole, with_age(entry.payload, delay + place - at), encoding=entry.encoding)
        for name in schema_names():
            for here in self._roots:
                whole = f"{here}/schema/{name}"
                if query.key_expr.intersects(whole) and (schema := schema_json(name)) is not None:
                    query.reply(whole, schema, encoding="application/schema+json")

    def _span(self, query: zenoh.Query, place: float) -> list[Played]:
        """The values around the place that are asked for: `past` before it, and `ahead` behind it [s]."""
        past, ahead = (_seconds(query.parameters.get(name)) for name in (PAST, AHEAD))
        if past + ahead <= 0.0:
            return []
        return self._selection.between(place - past, place + ahead, lambda whole: query.key_expr.intersects(whole))


def _seconds(text: str | None) -> float:
    """A length [s] as it is asked for; 0 for none."""
    try:
        found = float(text or 0.0)
    except ValueError:
        return 0.0
    return min(max(found, 0.0), LONGEST) if found == found else 0.0
