"""Vehicles whose daemon is alive, and recordings that are played, as they appear and disappear."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import ExitStack, asynccontextmanager, suppress
from dataclasses import dataclass
from typing import Final

import msgpack
import zenoh
from pydantic import ValidationError

from mkdaemon.bus.callbacks import direct
from mkdaemon.bus.names import REPLAY, ROOT, received_vehicle
from mkdaemon.client.playcontrol import control_key, status_key
from mkdaemon.client.samples import Sample, read_payload
from mkdaemon.client.transport import read_sample
from mkdaemon.client.vehicle import Vehicle
from mkdaemon.client.watch import Handover, Watch
from mkdaemon.errors import MkError
from mkdaemon.telemetry.play import PlayAction, PlayStatus

_TOKENS: Final = (f"{ROOT}/*/alive", f"{ROOT}/*/playing", f"{REPLAY}/*/playing")
ANSWER: Final = 2.0
"""Longest wait for the answer of a player [s]."""


@dataclass(frozen=True, slots=True, order=True)
class FleetSighting:
    """A daemon or player that is present.

    Attributes:
        name: of the vehicle.
        root: of its keys: `mk`, or `replay`.
        is_played: a recording is played under this name.
    """

    name: str
    root: str
    is_played: bool


class Fleet:
    """Every daemon and player at one endpoint.

    Attributes:
        here: who is there now.
    """

    def __init__(self, through: Vehicle) -> None:
        """Start without vehicles; `watch` finds them.

        Args:
            through: any client at the endpoint.
        """
        self.here: set[FleetSighting] = set()
        self._through, self._session = through, through.session
        self._loop = asyncio.get_running_loop()

    @asynccontextmanager
    async def watch(
        self, changed: Callable[[], None], played: Callable[[str, PlayStatus], None]
    ) -> AsyncIterator[None]:
        """Follow daemons and players that appear and disappear while the context lasts.

        Args:
            changed: called on the loop when `here` has changed.
            played: called on the loop with the vehicle and what its player says.
        """

        def on_token(sample: zenoh.Sample) -> None:
            whole = str(sample.key_expr)
            if received_vehicle(whole) is None:
                return  # a token with a wildcard names no vehicle
            root, name, token = whole.split("/")
            sighting = FleetSighting(name, root, token == "playing")
            is_here = sample.kind == zenoh.SampleKind.PUT
            with suppress(RuntimeError):  # the loop may be closing
                self._loop.call_soon_threadsafe(self._seen, sighting, is_here, changed)

        def on_status(sample: zenoh.Sample) -> None:
            whole = str(sample.key_expr)
            if received_vehicle(whole) is None:
                return
            name = whole.rpartition("/")[2]
            fields = read_payload(str(sample.encoding), sample.payload.to_bytes())
            with suppress(ValueError, RuntimeError):
                self._loop.call_soon_threadsafe(played, name, PlayStatus.model_validate(fields))

        with ExitStack() as stack:
            tokens = direct(on_token)
            for one in _TOKENS:
                stack.enter_context(self._session.liveliness().declare_subscriber(one, tokens, history=True))
            statuses = direct(on_status)
            stack.enter_context(self._session.declare_subscriber(status_key("*"), statuses))
            yield

    @property
    def vehicles(self) -> set[str]:
        """Names of those who are there under `mk`: daemons, and recordings that are played as one."""
        return {one.name for one in self.here if one.root == ROOT}

    def values(self, *suffixes: str) -> Watch:
        """What all vehicles publish under some keys, as it comes; `suffix` of a sample begins with the vehicle's name.

        Args:
            suffixes: keys without `mk/<vehicle>/`.
        """
        expressions = [zenoh.KeyExpr(f"{ROOT}/*/{suffix}") for suffix in suffixes]

        def read(sample: zenoh.Sample) -> Sample | None:
            whole = str(sample.key_expr)
            return None if received_vehicle(whole) is None else read_sample(sample, whole.removeprefix(f"{ROOT}/"))

        return Watch(self._session, expressions, read, Handover(self._loop))

    def client(self, sighting: FleetSighting) -> Vehicle:
        """A client of a daemon or player that is present."""
        return Vehicle(self._session, sighting.name, self._through.endpoint, root=sighting.root)

    async def control(self, name: str, action: PlayAction, **fields: float) -> PlayStatus:
        """Ask the player of a vehicle to do something.

        Args:
            name: of the vehicle.
            action: what to do.
            fields: others of a `PlayControl`.

        Raises:
            MkError: it does not answer, or refuses.
        """
        asked = {"action": action.value, **fields}
        get = self._session.get
        replies = await asyncio.to_thread(
            lambda: list(get(control_key(name), payload=msgpack.packb(asked), timeout=ANSWER))
        )
        answers = [reply.ok for reply in replies if reply.ok is not None]
        if not answers:
            raise MkError(f"no player plays a recording of {name} any more")
        fields = read_payload(str(answers[0].encoding), answers[0].payload.to_bytes())
        if "reason" in fields:
            raise MkError(str(fields["reason"]))
        try:
            return PlayStatus.model_validate(fields)
        except ValidationError as error:
            raise MkError(f"the player of {name} sends an unknown answer: update mkdaemon") from error

    def _seen(self, sighting: FleetSighting, is_here: bool, changed: Callable[[], None]) -> None:
        before = set(self.here)
        (self.here.add if is_here else self.here.discard)(sighting)
        if self.here != before:
            changed()
