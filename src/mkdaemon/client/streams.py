"""The values of one key, typed: as they come, and the last one with its age."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Final, Generic, TypeVar

from mkdaemon.client.samples import Sample
from mkdaemon.client.transport import Transport
from mkdaemon.client.watch import BACKLOG, Watch
from mkdaemon.errors import MkError, ProtocolError, SilenceError

_Value = TypeVar("_Value")
_WILD: Final = frozenset("*$?#/")
"""What a name within a key cannot hold."""


@dataclass(frozen=True, slots=True)
class LastValue(Generic[_Value]):
    """A last value.

    Attributes:
        value: the value.
        age: age of the value at the query [s].
    """

    value: _Value
    age: float


class Stream(Generic[_Value]):
    """The values of one key: `async for attitude in uav.state.attitude()`.

    Attributes:
        suffix: the key without `mk/<vehicle>/`.
    """

    def __init__(self, transport: Transport, suffix: str, model: str) -> None:
        """Describe a stream; nothing is subscribed yet.

        Args:
            transport: the daemon's client.
            suffix: the key without `mk/<vehicle>/`.
            model: `module:class` of its values in `mkdaemon.telemetry`, imported when it is needed.
        """
        self.suffix = suffix
        self._transport, self._model = transport, model

    def __call__(self, *, backlog: int = BACKLOG, silence: float | None = None) -> AsyncIterator[_Value]:
        """Iterate over the values as they arrive. The first step subscribes; the end of the loop unsubscribes.

        Args:
            backlog: values that may wait for a slow reader before the oldest is dropped; 1 keeps only the newest.
            silence: raise if no value arrives within this time [s]; None waits for ever.

        Raises:
            SilenceError: no value arrived for `silence` seconds.
            ProtocolError: this version does not know a value.
        """
        return self._values(self._watch(backlog), silence)

    @asynccontextmanager
    async def subscribed(
        self, *, backlog: int = BACKLOG, silence: float | None = None
    ) -> AsyncIterator[AsyncIterator[_Value]]:
        """Subscribe at once, so that no effect of a following command is missed; see `__call__`.

        Args:
            backlog: see `__call__`.
            silence: see `__call__`.
        """
        async with self._watch(backlog) as samples:
            yield self._typed(samples, silence)

    async def latest(self, *, patience: float = 3.0) -> LastValue[_Value] | None:
        """Ask the daemon for the last value; None if nothing was published yet.

        Args:
            patience: longest wait [s].

        Raises:
            CommandRejectedError: the daemon has too many queries to answer.
            ProtocolError: this version does not know the value.
        """
        sample = await self._transport.get(self.suffix, patience=patience)
        return None if sample is None else LastValue(self._read(sample), sample.age or 0.0)

    async def until(self, condition: Callable[[_Value], bool], *, patience: float) -> _Value:
        """Wait for a new value that meets a condition, and return it.

        Args:
            condition: whether a value meets it.
            patience: longest wait [s].

        Raises:
            SilenceError: no such value arrived in time.
        """
        async with self._watch(BACKLOG) as samples:
            try:
                async with asyncio.timeout(patience):
                    async for sample in samples:
                        if condition(value := self._read(sample)):
                            return value
            except TimeoutError:
                pass
        raise SilenceError(f"{self.suffix} was not as wanted within {patience:g} s")

    def _watch(self, backlog: int) -> Watch:
        return self._transport.watch(self.suffix, backlog=backlog)

    async def _values(self, watch: Watch, silence: float | None) -> AsyncIterator[_Value]:
        async with watch as samples:
            async for value in self._typed(samples, silence):
                yield value

    async def _typed(self, samples: AsyncIterator[Sample], silence: float | None) -> AsyncIterator[_Value]:
        while True:
            try:
                async with asyncio.timeout(silence):
                    sample = await anext(samples)
            except TimeoutError:
                raise SilenceError(f"{self.suffix} has been silent for {silence:g} s") from None
            yield self._read(sample)

    def _read(self, sample: Sample) -> _Value:
        """Make the value.

        Raises:
            ProtocolError: it is none that this version knows.
        """
        module, _, name = self._model.partition(":")
        value: Any = sample.value
        if not isinstance(value, getattr(import_module(f"mkdaemon.telemetry.{module}"), name)):
            raise ProtocolError(f"{sample.suffix} carries {sample.schema}, no {name}; update mkdaemon here or there")
        found: _Value = value
        return found


def part_of_key(name: str) -> str:
    """Return a name that is to stand in a key, for example of a camera.

    Raises:
        MkError: it would be no part, or several.
    """
    if not name or _WILD & set(name):
        raise MkError(f"{name!r} is not a part of a key: it has letters, digits, - and _")
    return name
