"""One vehicle, as a program sees it through its daemon."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, Any, TypeVar, overload

import zenoh

from mkdaemon.bus.names import ROOT
from mkdaemon.client.lease import TAKING_OFF, Lease, Leases
from mkdaemon.client.navi import Navi
from mkdaemon.client.records import Records
from mkdaemon.client.samples import Sample, message_from
from mkdaemon.client.settings import VehicleSettings
from mkdaemon.client.summary import VehicleStatus
from mkdaemon.client.verbcalls import VerbCalls
from mkdaemon.errors import MkError, ProtocolError

if TYPE_CHECKING:
    from mkdaemon.protocol import Board, WireMessage

_Reply = TypeVar("_Reply", bound="WireMessage")


class Vehicle(VerbCalls):
    """A vehicle to whose daemon this program is connected; made by `connect`.

    Its values are typed streams (`uav.state.attitude()`), its verbs methods of the vehicle (`uav.release()`) or of one
    of its services (`uav.settings.backup()`).

    Attributes:
        lease: the right to fly.
        settings: parameter sets of the FlightCtrl.
        waypoints: the NaviCtrl's list.
        route: that list, flown by the pilot's switch.
        navi: flights of the NaviCtrl.
        paths: that the daemon keeps to be flown.
        mixer: of the FlightCtrl.
        motor_controllers: their configuration.
        records: recordings.
    """

    def __init__(self, session: zenoh.Session, vehicle: str, endpoint: str, *, root: str = ROOT) -> None:
        super().__init__(session, vehicle, endpoint)
        self._root = root
        self.lease = Leases(self)
        self.settings: VehicleSettings = VehicleSettings(self)
        self.navi: Navi = Navi(self)
        self.records: Records = Records(self)

    async def status(self) -> VehicleStatus:
        """The aircraft, its link and the holder of the lease, from their last values.

        Raises:
            MkError: no daemon serves this vehicle.
        """
        from mkdaemon.reading.known import KEYS

        found: dict[str, Sample] = {}
        for pattern in KEYS:
            found |= await self.get_all(pattern)
        if not found and (absence := await self.absence()) is not None:
            raise MkError(absence)
        return VehicleStatus(self.vehicle, found)

    @asynccontextmanager
    async def fly(
        self,
        *,
        height: float,
        target: str = "",
        patience: float = TAKING_OFF,
        force: bool = False,
        holder: str | None = None,
    ) -> AsyncIterator[Lease]:
        """Take the lease and take off; the context holds over the target, and lands on it at its end.

        The pilot starts the motors before, and stops them afterwards. Nothing is streamed between two
        calls of the lease, so let them follow each other: `lease.hold(seconds=5)` instead of `asyncio.sleep(5)`.

        After an error or Ctrl-C inside, the pilot gets the aircraft at once, without a landing. After
        `lease.land()` inside, the end of the context does not land again.

        Args:
            height: above the target [m].
            target: its name; empty for the one in sight.
            patience: longest time of the take-off [s].
            force: take the lease from its present holder.
            holder: name others see; else user, machine and process.

        Raises:
            CommandRejectedError: as `uav.lease()` and `lease.take_off()`.
            NotEngagedError: the daemon did not begin the take-off; the text names what it waited for.
            ManoeuvreError: not at height or not landed in time, or aborted.
            LeaseLostError: it did not take off or land; the text says why the daemon released the aircraft.
            MkError: no daemon serves this vehicle.
        """
        from mkdaemon.telemetry.control import Outcome

        async with self.lease(force=force, holder=holder) as lease:
            await lease.take_off(height, target=target, patience=patience)
            yield lease
            if lease.outcome is not Outcome.LANDED:
                await lease.land()

    async def schema(self, name: str) -> dict[str, Any] | None:
        """The JSON Schema of a payload; None for an unknown name.

        Args:
            name: name and version, as an encoding names them: `Attitude.v1`.

        Raises:
            MkError: the name is not a part of a key.
        """
        suffix = f"schema/{name}"
        sample = (await self.get_all(suffix)).get(suffix)
        return None if sample is None else sample.fields

    async def stop(self, *, in_flight: bool = False) -> None:
        """Stop the motors. Only a public fork of the FlightCtrl has this command; otherwise the pilot stops them.

        Args:
            in_flight: also if the aircraft flies, or may fly: it falls.

        Raises:
            CommandRejectedError: `flying_stop`; stock firmware; `commands.fork_arming` is not set.
            MkError: no daemon serves this vehicle.
        """
        from mkdaemon.protocol import Board
        from mkdaemon.protocol.messages import DisarmMotors
        from mkdaemon.telemetry.refusals import Token, refuse

        if not in_flight:
            flight = await self.state.flight.latest()
            if flight is None or flight.value.is_flying is not False:
                raise refuse(Token.FLYING_STOP)
        await self.request(Board.FC, DisarmMotors(), confirm=True)

    @overload
    async def request(
        self, board: Board, message: WireMessage, expect: type[_Reply], *, confirm: bool = False
    ) -> _Reply: ...

    @overload
    async def request(self, board: Board, message: WireMessage, *, confirm: bool = False) -> WireMessage | None: ...

    async def request(
        self, board: Board, message: WireMessage, expect: type[_Reply] | None = None, *, confirm: bool = False
    ) -> WireMessage | None:
        """Send a MikroKopter request through the daemon and return the board's typed reply.

        Args:
            board: the board that answers.
            message: the request, for example `SettingsRequest(index=255)`.
            expect: class the reply must have; a reply of another layout is an error.
            confirm: accept the danger that the message's declaration names.

        Returns:
            The reply; None if the board does not answer such a request.

        Raises:
            CommandRejectedError: it was refused, or the board did not answer in time; has token, reason and fix.
            ProtocolError: the reply has another class than expected, or an unknown one.
            MkError: no daemon serves this vehicle.
        """
        fields = message.model_dump()
        if confirm:
            fields["confirm"] = True
        answer = await self.command(board.word, message.spec.key, fields)
        reply = answer.require()
        found = message_from(answer.reply_type, reply) if answer.reply_type else None
        if expect is not None and not isinstance(found, expect):
            name = "nothing" if found is None else type(found).__name__
            raise ProtocolError(f"{board.word} answers {message.spec.key} with {name}, not {expect.__name__}")
        return found
