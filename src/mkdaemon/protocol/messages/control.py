"""External control: offsets the FlightCtrl adds to the sticks of its receiver.

Three layouts that differ in length, in the sense of yaw and in the meaning of throttle; the wrong one can fly the
aircraft, so the dialect chooses before the first frame.
Source: docs/protocol.md, "ExternalControl"; docs/firmware-notes.md, section 6.
"""

from __future__ import annotations

from typing import Annotated

from mkdaemon.protocol.fields import S8, U8
from mkdaemon.protocol.flags import ControlConfig, ControlSwitches
from mkdaemon.protocol.sources import Source
from mkdaemon.protocol.spec import Policy
from mkdaemon.protocol.units import STICK, STICK_FROM_BOTTOM
from mkdaemon.protocol.wire import Board, WireMessage, answer, request
from mkdaemon.telemetry.danger import Danger

_DANGER = Danger(
    effect="flies the aircraft",
    never="stick frames go through the lease and the limiter",
    instead="Take a lease and stream `setpoint/stick`.",
)


class _Sticks(WireMessage):
    pitch: Annotated[int, S8(mk="Nick", unit=STICK, limit=127)]
    """Stick forward is positive; added to the receiver's channel."""
    roll: Annotated[int, S8(mk="Roll", unit=-STICK, limit=127)]
    """Positive on the wire: stick LEFT."""
    yaw: Annotated[int, S8(mk="Yaw", unit=STICK, limit=127)]
    """Positive on the wire: stick LEFT, counter-clockwise; dead band of 4."""
    throttle: Annotated[int, S8(mk="Gas", unit=STICK, limit=127)]
    """0 is the middle; the smaller of this and the receiver's channel rules, or their sum with THROTTLE_ADD."""
    frame: Annotated[int, U8(mk="Frame")] = 0
    """Echoed in the confirmation; 0 asks for none."""
    config: Annotated[ControlConfig, U8(mk="Config", enum=ControlConfig)] = ControlConfig.NONE
    """Without VALID nothing is controlled: the release."""


class _ControlV2(_Sticks):
    reserved: Annotated[int, U8(mk="free")] = 0


class _ControlV3(_Sticks):
    switches: Annotated[ControlSwitches, U8(mk="Switches", enum=ControlSwitches)] = ControlSwitches.NONE
    """In place of the transmitter's switches, with USE_SWITCHES."""
    free_1: Annotated[int, U8(mk="Free1")] = 0
    free_2: Annotated[int, U8(mk="Free2")] = 0


class _ControlV1(WireMessage):
    digital: Annotated[tuple[int, ...], U8(mk="Digital", count=2)] = (0, 0)
    remote_buttons: Annotated[int, U8(mk="RemoteButtons")] = 0
    pitch: Annotated[int, S8(mk="Nick", unit=STICK, limit=127)]
    """Stick forward is positive; added to the receiver's command."""
    roll: Annotated[int, S8(mk="Roll", unit=-STICK, limit=127)]
    """Positive on the wire: stick LEFT."""
    yaw: Annotated[int, S8(mk="Yaw", unit=-STICK, limit=127)]
    """Positive on the wire: CLOCKWISE, opposite to the later layouts; no dead band."""
    throttle: Annotated[int, U8(mk="Gas", unit=STICK_FROM_BOTTOM)]
    """Upper bound of the receiver's throttle, on its scale plus 127."""
    height: Annotated[int, S8(mk="Height")] = 0
    """Added, times the altitude gain, to the altitude set point in height-limit mode."""
    reserved: Annotated[int, U8(mk="free")] = 0
    frame: Annotated[int, U8(mk="Frame")] = 0
    """Echoed in the confirmation; 0 asks for none."""
    config: Annotated[ControlConfig, U8(mk="Config", enum=ControlConfig)] = ControlConfig.NONE
    """Without VALID nothing is controlled: the release."""


@request(
    Board.FC,
    "b",
    name="ExternControl",
    layout="v2",
    reply="B",
    firmware="FC 2.10a to 2.12a",
    since=(2, 10),
    source=Source.FC_RECEIVE,
    danger=_DANGER,
    any_address=True,
    is_forwarded=True,
)
class ExternControlV2(_ControlV2):
    """Offsets the FlightCtrl adds to its receiver's channels.

    Expires 2 s after the last frame on 2.12a: stream it, never send it once.
    """


@request(
    (Board.FC, Board.NC),
    "b",
    name="ExternControl",
    layout="v3",
    reply="B",
    firmware="FC and NC 2.13 beta and later",
    since=(2, 13),
    source=(Source.TOOLS, Source.WIKI),
    danger=_DANGER,
    any_address=True,
    is_forwarded=True,
)
class ExternControlV3(_ControlV3):
    """Offsets the FlightCtrl adds to its receiver's channels; as long on the wire as v2."""


@request(
    Board.FC,
    "b",
    name="ExternControl",
    layout="v1",
    reply="B",
    firmware="FC up to 2.08; 2.09 unverified",
    source=Source.FC_RECEIVE,
    danger=_DANGER,
    any_address=True,
    is_forwarded=True,
)
class ExternControlV1(_ControlV1):
    """Offsets the FlightCtrl adds to its receiver's commands; held 5.3 s, refreshed by any polling."""


@answer(
    (Board.FC, Board.NC),
    "B",
    firmware="FC; never through an NC 0.24; NC 2.13 and later, which takes external control itself",
    source=Source.FC_SEND,
)
class ControlConfirm(WireMessage):
    """An external control frame arrived (about 5 ms after it, before it acts)."""

    frame: Annotated[int, U8(mk="Frame")]
    """That of the confirmed frame; never 0."""


@request(Board.FC, "g", reply="G", firmware="FC", source=Source.FC_RECEIVE, policy=Policy(0.15, 4), any_address=True)
class ControlStateRequest(WireMessage):
    """Ask which external control the FlightCtrl holds; the length of the answer tells its layout."""


@answer(
    Board.FC,
    "G",
    name="ControlState",
    layout="v2",
    firmware="FC 2.10a to 2.12a",
    source=Source.FC_SEND,
    tells_firmware=True,
)
class ControlStateV2(_ControlV2):
    """External control as the FlightCtrl holds it."""


@answer(
    Board.FC,
    "G",
    name="ControlState",
    layout="v3",
    firmware="FC 2.13 beta and later",
    source=(Source.TOOLS, Source.WIKI),
    tells_firmware=True,
)
class ControlStateV3(_ControlV3):
    """External control as the FlightCtrl holds it."""


@answer(
    Board.FC,
    "G",
    name="ControlState",
    layout="v1",
    firmware="FC up to 2.08",
    source=Source.FC_SEND,
    tells_firmware=True,
)
class ControlStateV1(_ControlV1):
    """External control as the FlightCtrl holds it."""
