"""The daemon's side of the bus: publishes, remembers last values, answers queries, takes setpoints.

Rules from measurements: a direct callback does nothing but stamp and hand over to the loop; everything is put with
congestion control DROP, so a slow subscriber cannot slow the line's reader; the session is closed explicitly.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import ExitStack, asynccontextmanager
from functools import partial
from types import MappingProxyType
from typing import Any, Final, Self

import zenoh
from pydantic import BaseModel

from mkdaemon.bus.answers import AnswerThread
from mkdaemon.bus.callbacks import direct
from mkdaemon.bus.codec import MEDIA_TYPE, encoding_of
from mkdaemon.bus.commandserver import CommandServer, Handler
from mkdaemon.bus.exposure import check_exposure
from mkdaemon.bus.floods import PLAIN_RATE, POSITION_RATE, ShedCounter, flood_settings
from mkdaemon.bus.intake import Arrived, SetpointIntake, Taker, Verifier, read_payload, read_signature
from mkdaemon.bus.keys import Use, find, of_use, roots
from mkdaemon.bus.names import key, received_suffix
from mkdaemon.bus.published import PublishedValues
from mkdaemon.bus.recording import BusRecorder, NoRecorder, recorded_taker
from mkdaemon.bus.schema import schema_json, schema_names
from mkdaemon.bus.senderclock import SenderClock
from mkdaemon.bus.session import close_session, open_session, session_config
from mkdaemon.bus.setpointroot import NEIGHBOURS, PLAIN_ROOT, below, extend_access, new_setpoint_root
from mkdaemon.config.bus import BusConfig
from mkdaemon.telemetry.signature import private_key

_JSON: Final = "application/schema+json"
LOOK: Final = 0.05
"""Duration of each look for setpoints at the plain keys [s]."""
TOKEN_LOOK: Final = 0.02
"""Between two looks at the token of the client that is watched [s]."""
TOKENS: Final = 8
"""Changes of it that are kept between two looks, the newest."""
UNKNOWN_SETPOINTS: Final = "setpoints to no key of a setpoint"
"""What was put to a wildcard, or to another word than a kind of setpoint."""

Watcher = Callable[[str, bool], None]
"""Takes a client's coming (True) or going (False), by its name; called on the loop."""


class Bus:
    """An open session. Everything runs on the loop it was opened on.

    Attributes:
        open_endpoints: endpoints open to the whole network; empty unless the configuration allows it.
        setpoint_root: below which the holder of the lease puts setpoints; only the holder knows it.
    """

    def __init__(
        self,
        session: zenoh.Session,
        cfg: BusConfig,
        vehicle: str,
        recorder: BusRecorder,
        clock: Callable[[], float],
        root: str,
    ) -> None:
        self.vehicle = vehicle
        self.open_endpoints: tuple[str, ...] = ()
        self.setpoint_root = root
        self._session = session
        self._cfg = cfg
        self._token = ExitStack()
        self._loop = asyncio.get_running_loop()
        self._recorder = recorder
        self._clock = clock
        self._published = PublishedValues(session, vehicle, recorder)
        self._shed = ShedCounter()
        self._sender = SenderClock()
        self._watched: zenoh.Subscriber[Any] | None = None
        self._uninvited: dict[str, Callable[[Arrived], None]] = {}
        self._secret_reports: list[str] = []
        self._commands = CommandServer(session, vehicle, recorder, self._shed, cfg.max_queries, clock)
        # A separate one: a client that does not read last values does not delay answers to commands.
        self._lookups = AnswerThread("bus.lookups", limit=4 * cfg.max_queries, limit_per_key=cfg.max_queries)

    @classmethod
    @asynccontextmanager
    async def open(
        cls,
        cfg: BusConfig,
        vehicle: str,
        recorder: BusRecorder | None = None,
        *,
        takes_images: bool = False,
        private_images: Mapping[str, str] = MappingProxyType({}),
        positions: Mapping[str, str | None] = MappingProxyType({}),
        clock: Callable[[], float] = time.monotonic,
    ) -> AsyncIterator[Self]:
        """Open a session, answer last-value and schema queries; close all on leaving. `announce` makes it known.

        Args:
            cfg: the session.
            vehicle: its name in every key.
            recorder: receives everything published and asked; none by default.
            takes_images: whether a camera brings its images over the bus: only then are long messages received.
            private_images: keys that only a camera's sender knows, by the plain ones.
            positions: secrets of sources of poses, by the keys of their reports without `mk/<vehicle>/`; None for
                no secret.
            clock: what a second is, for messages that are too many in it [s].

        Raises:
            ConfigError: an endpoint or the Zenoh file is wrong, or every program in the network could fly.
            MkError: the endpoint is in use.
        """
        root = new_setpoint_root(cfg.connect)
        plain = tuple(spec.suffix for spec in of_use(Use.SETPOINT))
        kinds = (*plain, *(below(root, suffix) for suffix in plain), *positions)
        rates = {suffix: POSITION_RATE if secret is None else PLAIN_RATE for suffix, secret in positions.items()}
        config = session_config(
            "peer",
            listen=cfg.listen,
            connect=cfg.connect,
            zenoh_file=cfg.zenoh_file,
            lease=cfg.lease,
            more={
                **flood_settings(vehicle, kinds, roots(Use.PUBLISHED), rates, takes_images=takes_images),
                "gateway": NEIGHBOURS,
            },
        )
        extend_access(config, vehicle, root, {**private_images, **_private_keys(vehicle, positions)})
        reachable = check_exposure(config, allow_open=cfg.allow_open)
        session = await open_session(config, listen=cfg.listen)
        try:
            bus = cls(session, cfg, vehicle, recorder or NoRecorder(), clock, root)
            bus.open_endpoints = reachable
            with bus._token:
                try:
                    for root in roots(Use.PUBLISHED):
                        bus._declare_lookup(f"{root}/**", bus._published.answer_last)
                    bus._declare_lookup("schema/**", bus._answer_schema)
                    yield bus
                finally:
                    bus.watch_client(None, lambda name, is_here: None)
                    await bus._commands.close()
                    await asyncio.to_thread(bus._lookups.close)
        finally:
            await close_session(session)

    @property
    def session(self) -> zenoh.Session:
        """The session itself, for what subscribes on its own: cameras that take their images from the bus."""
        return self._session

    def announce(self) -> None:
        """Show the liveliness token until the bus is closed: who sees it gets answers, so all is served before."""
        self._token.enter_context(self._session.liveliness().declare_token(key(self.vehicle, "alive")))

    def publish(self, suffix: str, value: BaseModel, *, schema: type[BaseModel] | None = None) -> None:
        """Put a value and remember it as the key's last; never waits, drops where a subscriber is too slow.

        Args:
            suffix: key without `mk/<vehicle>/`; must be in the table of keys.
            value: what to put.
            schema: the model that describes it, if not its own class.

        Raises:
            ValueError: the table of keys has no such published key.
        """
        self._published.put(suffix, value, schema)

    def counts(self) -> dict[str, int]:
        """Number of values published since the start, by key without `mk/<vehicle>/`."""
        return self._published.counts()

    async def wait_until_watched(self) -> None:
        """Return as soon as a client subscribes to a key of this vehicle."""
        watched = asyncio.Event()
        loop = self._loop

        def on_change(status: zenoh.MatchingStatus) -> None:
            loop.call_soon_threadsafe(changed, status.matching)

        def changed(is_watched: bool) -> None:
            if is_watched:
                watched.set()

        # What this session itself subscribes to, the setpoints, is no audience.
        outside = zenoh.Locality.REMOTE
        with self._session.declare_publisher(key(self.vehicle, "**"), allowed_destination=outside) as publisher:
            listener = publisher.declare_matching_listener(direct(on_change))
            with listener:
                present: zenoh.MatchingStatus = publisher.matching_status  # type: ignore[assignment]  # the stub errs
                if not present.matching:
                    await watched.wait()

    def serve(self, root: str, handler: Handler) -> None:
        """Answer every command below a root (`cmd`, `do`) with `handler`, each in its own task."""
        self._commands.serve(root, handler)

    async def stop_answering(self) -> None:
        """End what is being worked on; what is asked from now on gets no answer."""
        await self._commands.stop()

    def receive(self, suffix: str, take: Taker, verify: Verifier = lambda payload, proof: 0) -> None:
        """Hand every setpoint put below the secret root to `take`, with the time it arrived; see `SetpointIntake`.

        What is too long is not even copied. The holder's are put once more to the plain key; for what others put there
        see `refuse_uninvited`.

        Args:
            suffix: plain key without `mk/<vehicle>/`.
            take: called on the loop.
            verify: tells those of the holder from others; called on Zenoh's threads.
        """
        spec = find(suffix)
        encoding = MEDIA_TYPE if spec is None or spec.carries is None else encoding_of(spec.carries)

        recorded = recorded_taker(self._recorder, suffix, encoding, take)
        plain, remote = key(self.vehicle, suffix), zenoh.Locality.REMOTE
        publisher = self._session.declare_publisher(plain, encoding=encoding, allowed_destination=remote)

        def take_and_show(arrived: Arrived) -> None:
            recorded(arrived)
            if arrived.signed_for is not None and isinstance(arrived.payload, bytes):
                publisher.put(arrived.payload, attachment=arrived.proof, source_info=arrived.source)

        self._take_in(suffix, key(self.vehicle, below(self.setpoint_root, suffix)), take_and_show, verify, self._sender)
        self._uninvited[suffix] = recorded

    def receive_reports(self, suffix: str, take: Taker, verify: Verifier, secret: str | None) -> None:
        """Hand the reports of a source of poses to `take`, as setpoints are: the newest alone, verified on the way.

        They are not recorded here: what follows from them is.

        Args:
            suffix: plain key without `mk/<vehicle>/`.
            take: called on the loop.
            verify: tells those of the source from others; called on Zenoh's threads. What it returns names the clock of
                their stamps.
            secret: of the source: its reports come below the key that only its owner can name, and what others put to
                the plain key is refused. None: they come at the plain key, from any program.
        """

        def take_arrived(arrived: Arrived) -> None:
            take(arrived.at if arrived.sent is None else arrived.sent, arrived.payload, arrived.signed_for)

        plain = key(self.vehicle, suffix)
        whole = plain if secret is None else private_key(secret, plain)
        self._take_in(suffix, whole, take_arrived, verify, SenderClock())
        if secret is not None:
            self._uninvited[suffix] = take_arrived
            self._secret_reports.append(suffix)

    def _take_in(
        self, suffix: str, whole: str, take: Callable[[Arrived], None], verify: Verifier, sender: SenderClock
    ) -> None:
        """Hand what is put to a whole key to `take`, through a separate intake."""
        shed = partial(self._shed.add, f"samples to {suffix}")
        intake = SetpointIntake(self._loop, take, verify, shed, self._clock, sender)

        def on_sample(sample: zenoh.Sample) -> None:
            payload = read_payload(sample.payload, suffix)
            intake.arrived(payload, read_signature(sample.attachment), sample.source_info)

        self._session.declare_subscriber(whole, direct(on_sample, shed))

    async def refuse_uninvited(self) -> None:
        """Look at the plain keys for a moment, and have the newest samples refused; none is allowed there.

        Only for a moment: while this program subscribes, everything put there is sent to this computer.
        """
        places, remote = len(self._uninvited), zenoh.Locality.REMOTE
        looks = [
            self._session.declare_subscriber(
                key(self.vehicle, pattern), zenoh.handlers.RingChannel(places), allowed_origin=remote
            )
            for pattern in (f"{PLAIN_ROOT}/*", *self._secret_reports)
        ]
        try:
            await asyncio.sleep(LOOK)
            found = [one for look in looks for _ in range(places) if (one := look.handler.try_recv()) is not None]
        finally:
            for look in looks:
                look.undeclare()  # type: ignore[no-untyped-call]
        for sample in found:
            suffix = received_suffix(self.vehicle, str(sample.key_expr))
            take = None if suffix is None else self._uninvited.get(suffix)
            if suffix is None or take is None:
                self._shed.add(UNKNOWN_SETPOINTS)
                continue
            payload = read_payload(sample.payload, suffix)
            take(Arrived(time.monotonic(), payload, b"", None, sample.source_info))

    def take_shed(self) -> dict[str, int]:
        """Numbers of samples dropped by flood limits since the last call, by kind."""
        return self._shed.take()

    def watch_client(self, name: str | None, watcher: Watcher) -> None:
        """Hear when a client shows or loses its liveliness token, no longer when the one before does.

        Tokens of others, and those under wildcards, end in Zenoh: two strangers that showed and withdrew 4,000 a second
        each cost the pilot the lease in 4 of 4 flights while each token woke Python. If such a flood displaces the
        end of the client, its silence shows it.

        Args:
            name: of the client; None for no client.
            watcher: called at once where the client is there already.
        """
        if self._watched is not None:
            self._watched.undeclare()  # type: ignore[no-untyped-call]
            self._watched = None
        if name is None:
            return
        liveliness, where = self._session.liveliness(), key(self.vehicle, f"client/{name}")
        self._watched = liveliness.declare_subscriber(where, zenoh.handlers.RingChannel(TOKENS), history=True)
        self._look_for_client(self._watched, watcher)

    def _look_for_client(self, watched: zenoh.Subscriber[Any], watcher: Watcher) -> None:
        """Tell of what became of its token, now and again and again."""
        for _ in range(TOKENS):
            if watched is not self._watched or (sample := watched.handler.try_recv()) is None:
                break
            suffix = received_suffix(self.vehicle, str(sample.key_expr))
            if suffix is not None:
                watcher(suffix.rpartition("/")[2], sample.kind == zenoh.SampleKind.PUT)
        if watched is self._watched:
            self._loop.call_later(TOKEN_LOOK, self._look_for_client, watched, watcher)

    def _declare_lookup(self, suffix: str, answer: Callable[[zenoh.Query], None]) -> None:
        """Have queries answered without the loop."""

        def on_query(query: zenoh.Query) -> None:
            self._lookups.submit(query, answer)

        dropped = partial(self._shed.add, "queries that cannot be read")
        self._session.declare_queryable(key(self.vehicle, suffix), direct(on_query, dropped))

    def _answer_schema(self, query: zenoh.Query) -> None:
        for name in schema_names():
            whole = key(self.vehicle, f"schema/{name}")
            if query.key_expr.intersects(whole) and (schema := schema_json(name)) is not None:
                query.reply(whole, schema, encoding=_JSON)


def _private_keys(vehicle: str, secrets: Mapping[str, str | None]) -> dict[str, str]:
    """Private keys by the plain ones, of suffixes that have a secret."""
    plain = {key(vehicle, suffix): secret for suffix, secret in secrets.items()}
    return {each: private_key(secret, each) for each, secret in plain.items() if secret is not None}
