"""What the flight core decides is carried out: stick frames to the line, values to the bus, stamped."""

from __future__ import annotations

import asyncio
from dataclasses import asdict, astuple, fields

from mkdaemon.clock import Clock
from mkdaemon.control.actions import (
    Action,
    PublishError,
    PublishEstimate,
    PublishNavi,
    PublishStatus,
    Release,
    SendSticks,
)
from mkdaemon.daemon.audit import Audit, Outlet
from mkdaemon.daemon.releases import Releases
from mkdaemon.link.link import Link
from mkdaemon.link.session.traffic import SetpointRefused
from mkdaemon.telemetry.control import ControlError, ControlEstimate, ControlOutput, ControlStatus
from mkdaemon.telemetry.navi import ControlNavi
from mkdaemon.translate import extern_control


class Orders:
    """Carries out what the flight core decides."""

    def __init__(self, link: Link, bus: Outlet, audit: Audit, releases: Releases, clock: Clock) -> None:
        self._link, self._bus, self._audit, self._releases, self._clock = link, bus, audit, releases, clock
        self._was_refused = False

    def carry_out(self, action: Action, tasks: asyncio.TaskGroup) -> None:
        """Carry out one action; what takes time goes on in a task of its own."""
        match action:
            case SendSticks():
                self._send(action)
            case Release():
                self._releases.begin(action.reason, tasks)
            case PublishStatus():
                shown = {field.name: getattr(action, field.name) for field in fields(action)}
                self._bus.publish("control/status", ControlStatus(stamp=self._clock.stamp(), **shown))
            case PublishEstimate():
                estimate = ControlEstimate(stamp=self._clock.stamp(), **action.value.__dict__)
                self._bus.publish("control/estimate", estimate)
            case PublishNavi():
                self._bus.publish("control/navi", ControlNavi(stamp=self._clock.stamp(), **action.value.__dict__))
            case PublishError():
                self._bus.publish("control/error", ControlError(stamp=self._clock.stamp(), **action.value.__dict__))
            case _:
                self._audit.report(action)

    def _send(self, order: SendSticks) -> None:
        """Hand stick frames to the line; one that it does not take is said once, until it takes one again."""
        fate = self._link.send_setpoint(
            lambda layout, number: extern_control(layout, order.counts, number), deadline=order.deadline
        )
        was_refused, self._was_refused = self._was_refused, isinstance(fate, SetpointRefused)
        if isinstance(fate, SetpointRefused):
            if not was_refused:
                self._audit.log("warning", f"stick frame {order.sequence} was not sent: {fate.refusal.reason}")
            return
        output = ControlOutput(
            stamp=self._clock.stamp(),
            epoch=order.epoch,
            sequence=order.sequence,
            frame=fate.number,
            age=order.age,
            **asdict(order.counts),
            limited=order.is_limited,
            wanted=None if order.wanted is None else astuple(order.wanted),
        )
        self._bus.publish("control/output", output)
