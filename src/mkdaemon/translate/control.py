"""Stick commands to external control, in the layout the aircraft speaks."""

from __future__ import annotations

from mkdaemon.control.limiter import StickCounts
from mkdaemon.protocol.flags import ControlConfig
from mkdaemon.protocol.wire import WireMessage


def extern_control(layout: type[WireMessage], sticks: StickCounts, frame: int) -> WireMessage:
    """Build the external control message that carries these sticks.

    The signs between FLU and the wire, and where throttle is zero, are declared on the fields of each layout.

    Args:
        layout: class the dialect chose: `ExternControlV1`, `V2` or `V3`.
        sticks: limited stick offsets [stick; FLU].
        frame: number the confirmation repeats, 1..255; 0 for no confirmation.

    Raises:
        EncodeError: a stick is beyond what the layout carries.
    """
    fields: dict[str, int] = {name: layout.spec.wire(name).from_si(value) for name, value in sticks._asdict().items()}
    return layout.model_validate({**fields, "frame": frame, "config": ControlConfig.VALID})
