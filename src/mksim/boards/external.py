"""External control inside a FlightCtrl: what it holds, for how long, and how it is added to the pilot's sticks.

Source: docs/firmware-notes, "External control"; docs/safety.md, "Silence is not a release";
docs/protocol.md, "ExternalControl".
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

from mkdaemon.protocol.flags import ControlConfig
from mkdaemon.protocol.messages import ControlStateV1, ControlStateV2, ControlStateV3
from mksim.boards.aircraft import Transmitter
from mksim.boards.generations import SLOW_TICK, FcFirmware
from mksim.config import GasLaw

FULL: Final = 127
"""Full stick [count]."""
RC_LOST: Final = 100
"""Reception quality below which the transmitter counts as lost."""


@dataclass(frozen=True, slots=True)
class ExternalSticks:
    """Channels on the firmware's axes [count]: `roll` positive to the LEFT, `yaw` positive to the left."""

    pitch: float
    roll: float
    yaw: float
    throttle: float

    @classmethod
    def from_receiver(cls, transmitter: Transmitter) -> ExternalSticks:
        """Take the pilot's sticks."""
        return cls(transmitter.pitch, transmitter.roll, transmitter.yaw, transmitter.gas)


def _clip(value: float) -> float:
    return max(-FULL, min(FULL, value))


class ExternalControl:
    """The structure `b` is copied into, and its dead-man.

    Attributes:
        held: the structure as `G` shows it.
        confirm: frame number waiting to be confirmed with `B`; 0 none.
        expired: how often the dead-man cleared a valid control.
    """

    def __init__(self, generation: FcFirmware, gas_law: GasLaw) -> None:
        self._generation = generation
        self._gas_law = gas_law
        self._ticks = 0
        self._next_tick = 0.0
        self.expired = 0
        self.confirm = 0
        self.held: ControlStateV1 | ControlStateV2 | ControlStateV3 = self._decode(bytes(generation.control.spec.size))

    def _decode(self, raw: bytes) -> ControlStateV1 | ControlStateV2 | ControlStateV3:
        return self._generation.control.decode(raw)

    @property
    def size(self) -> int:
        """Bytes a `b` frame is read for, whatever its length."""
        return self._generation.control.spec.size

    def accepts(self, frame_chars: int) -> bool:
        """Whether a `b` frame of this length is looked at."""
        longest = self._generation.longest_control
        return longest is None or frame_chars < longest

    def take(self, raw: bytes) -> None:
        """Copy a `b` payload in."""
        self.held = self._decode(raw)
        self.confirm = self.held.frame

    def refresh(self, command: str) -> None:
        """A command was handled: some keep the sticks alive."""
        if self._generation.dead_man.is_refreshed_by(command):
            self._ticks = self._generation.dead_man.ticks

    def start_dead_man_at(self, when: float) -> None:
        """Count the dead-man from `when` [s] on; after a reset it runs late."""
        self._next_tick = when

    def tick_until(self, now: float) -> None:
        """Count the dead-man down to `now`."""
        while self._next_tick <= now:
            self._next_tick += SLOW_TICK
            if self._ticks:
                self._ticks -= 1
                if not self._ticks:
                    self._expire()

    def _expire(self) -> None:
        if self.held.config & ControlConfig.VALID:
            self.expired += 1
        self.held = self.held.model_copy(update={"config": ControlConfig.NONE})

    def clear(self) -> None:
        """Forget everything, as a reboot does."""
        self._ticks = 0
        self.confirm = 0
        self.held = self._decode(bytes(self.size))

    @property
    def is_valid(self) -> bool:
        """Whether the held structure asks to control."""
        return bool(self.held.config & ControlConfig.VALID)

    @property
    def tolerates_rc_loss(self) -> bool:
        """Whether it may fly on without a transmitter (2.14 and later)."""
        return (
            isinstance(self.held, ControlStateV3)
            and self.is_valid
            and bool(self.held.config & ControlConfig.IGNORE_RC_LOST)
        )

    def mix(self, receiver: ExternalSticks) -> ExternalSticks:
        """Add what is held to the receiver's sticks; the caller has checked gate and reception."""
        held = self.held
        if isinstance(held, ControlStateV1):
            return self._mix_old(receiver, held)
        if isinstance(held, ControlStateV3) and held.config & ControlConfig.IGNORE_RC_STICKS:
            receiver = ExternalSticks(0.0, 0.0, 0.0, float(FULL))
        return ExternalSticks(
            _clip(receiver.pitch + held.pitch),
            _clip(receiver.roll + held.roll),
            _clip(receiver.yaw + held.yaw),
            _clip(self._gas(receiver.throttle, held.throttle, held.config)),
        )

    def _mix_old(self, receiver: ExternalSticks, held: ControlStateV1) -> ExternalSticks:
        """The eleven-byte form: no clipping, yaw of the opposite sign, throttle on the receiver's scale plus 127."""
        throttle: float = held.throttle - FULL
        if self._gas_law is GasLaw.STOCK:
            throttle = min(receiver.throttle, throttle)
        return replace(
            receiver,
            pitch=receiver.pitch + held.pitch,
            roll=receiver.roll + held.roll,
            yaw=receiver.yaw - held.yaw,
            throttle=_clip(throttle),
        )

    def _gas(self, receiver: float, value: int, config: ControlConfig) -> float:
        if self._gas_law is GasLaw.FORK:
            return value
        if config & ControlConfig.THROTTLE_ADD:
            return receiver + value
        return min(receiver, value)
