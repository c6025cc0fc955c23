"""From devices to setpoints, fifty times a second and at once after a change: the loop of `mkctl teleop`."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import suppress
from typing import Final

from mkdaemon.cli.mkctl.teleop.devices import Device, DeviceLostError
from mkdaemon.cli.mkctl.teleop.padrecording import PadRecorder
from mkdaemon.client.leasekeeper import LeaseKeeper
from mkdaemon.client.session import SessionState
from mkdaemon.client.teleop.teleop import Teleop, TeleopOutput
from mkdaemon.config.gamepad import Gamepad
from mkdaemon.errors import MkError

PERIOD: Final = 0.02
"""Between two setpoints [s]; the daemon sends as many stick frames a second (docs/configuration.md, control.rate)."""
GAP: Final = 0.002
"""Shortest interval between two setpoints [s]. The daemon sends the newest setpoint in each of its periods: after a
longer gap a change could miss a period, and wait for two."""


class TeleopSession:
    """Devices, the pure teleop, and the lease.

    Attributes:
        teleop: what decides.
        keeper: the lease.
        devices: every device that is there, by its name.
        output: what was decided last.
        notice: what happened last that a person should know.
        is_on_ground: whether the aircraft stands; None if unknown.
        recorder: writes the session to a file; None for none.
        ticked: is set after every tick, for what must not delay one.
    """

    def __init__(self, keeper: LeaseKeeper, ask_stop: Callable[[], None] = lambda: None) -> None:
        self.teleop = Teleop()
        self.keeper = keeper
        self.devices: dict[str, Device] = {}
        self.output = TeleopOutput(None, "starting")
        self.notice = ""
        self.is_on_ground: bool | None = None
        self.ticked = asyncio.Event()
        self.recorder: PadRecorder | None = None
        self._ask_stop = ask_stop
        self._loop = asyncio.get_running_loop()
        self._news = asyncio.Event()
        self._ticked_at = self._loop.time()

    @property
    def now(self) -> float:
        """The time [s; monotonic]."""
        return self._loop.time()

    def attach(self, device: Device, pad: Gamepad) -> None:
        """Take a device and its mapping."""
        self.devices[device.name] = device
        self.teleop.attach(device.name, pad, device.facts, self._loop.time())
        self.notice = f"{device.facts.name} is there"
        if self.recorder is not None:
            self.recorder.attached(device, pad, self.now)

    def reported(self, name: str, control: str, raw: float, at: float) -> None:
        """Take a change that a device reported; it is sent at once.

        Args:
            name: of the device.
            control: axis or button; empty where the device only wants to be asked now.
            raw: as it came.
            at: when [s].
        """
        hands = self.teleop.hands.get(name)
        if hands is not None:
            if control:
                hands.reported(control, raw, at)
                if self.recorder is not None:
                    self.recorder.reported(name, control, raw, at)
            self._news.set()

    def lost(self, name: str, reason: str) -> None:
        """Take note that a device is gone; if it flew the aircraft, release at once."""
        device = self.devices.pop(name, None)
        if device is not None:
            device.close()
            self.notice = reason
            self.teleop.detach(name, reason)
            if self.recorder is not None:
                self.recorder.lost(name, reason, self.now)
            self._news.set()

    async def run(self, stop: asyncio.Event) -> None:
        """Stream until stopped; then release the aircraft."""
        try:
            while not stop.is_set():
                await self._wait()
                self.tick()
        finally:
            for device in self.devices.values():
                device.close()
            await self.keeper.close()

    async def _wait(self) -> None:
        """Wait for a change, at most a period after the tick before, at least the gap."""
        with suppress(TimeoutError):
            async with asyncio.timeout_at(self._ticked_at + PERIOD):
                await self._news.wait()
        await asyncio.sleep(max(self._ticked_at + GAP - self._loop.time(), 0.0))
        self._news.clear()

    def tick(self) -> None:
        """Ask every device, decide, and stream."""
        now = self._ticked_at = self._loop.time()
        for device in list(self.devices.values()):
            try:
                state = device.ask(now)
            except DeviceLostError as error:
                self.lost(device.name, str(error))
                continue
            if state is not None:
                self.teleop.hands[device.name].asked(state.values, state.at)
                if self.recorder is not None:
                    self.recorder.asked(device.name, state, now)
        self._carry_out(self.teleop.tick(now, is_engaged=self.keeper.is_engaged, is_on_ground=self.is_on_ground))
        self.ticked.set()

    def _carry_out(self, output: TeleopOutput) -> None:
        self.output = output
        if self.recorder is not None:
            self.recorder.decided(output, self.now)
        if output.stop_motors:
            self._ask_stop()
        if output.let_go:
            self.keeper.give_back()
            self._notify_devices(output.reason)
        if output.setpoint is None:
            return
        try:
            if self.keeper.flight.state is SessionState.FREE:
                self.keeper.begin()
            self.keeper.stream(output.setpoint.kind, output.setpoint.fields)
        except MkError as error:
            self.keeper.give_back()
            self.teleop.ended(str(error))
            self._notify_devices(str(error))
        else:
            refusal = self.keeper.flight.take_refusal()
            if refusal is not None:
                self.notice = str(refusal)
                self.teleop.refused()

    def _notify_devices(self, notice: str) -> None:
        self.notice = notice
        for device in self.devices.values():
            device.let_go()

    def alarm(self, notice: str) -> None:
        """Shake every pad and ring every bell: the aircraft is out of reach."""
        self.notice = notice
        for device in self.devices.values():
            device.alarm()
