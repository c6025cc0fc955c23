"""What a genuine and a simulated NaviCtrl make of the same bytes: replies, their number, times and fields."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from lab.hil.naviscript import Answers
from mkdaemon.protocol.decoder import MessageDecoder, Unknown
from mkdaemon.protocol.framing import Frame

TOLERANCE: Final = {
    **dict.fromkeys(("position_longitude", "position_latitude"), 200),
    **dict.fromkeys(("home_longitude", "home_latitude", "target_longitude", "target_latitude"), 250),
    **dict.fromkeys(("position_altitude", "home_altitude", "target_altitude"), 3000),
    **dict.fromkeys(("ground_speed", "vertical_speed"), 60),
    **dict.fromkeys(("flying_time", "battery", "target_hold_time", "satellites"), 1),
    **dict.fromkeys(("pitch", "roll"), 4),
    "altitude_setpoint": 400,
    "home_distance": 25,
    "target_distance": 15,
    "altimeter": 30,
    "variometer": 6,
    "throttle": 12,
    "current": 25,
    "used_capacity": 5,
}
"""How far two noisy boards may be apart before a field counts as different; what is not here must be equal."""
ANALOG: Final = {0: 40, 1: 40, 2: 80, 3: 80, 9: 40, 10: 360, 13: 8, 15: 400, 21: 80, 22: 80, 27: 300, 28: 300}
"""The same of the channels of debug data."""
TURNS: Final = {"heading": (360, 8), "course": (360, 360), "home_bearing": (360, 360), "target_bearing": (360, 360)}
"""Angles: a whole turn, and how far they may be apart; a course of an aircraft at rest is anything."""
OWN_WORDS: Final = {"text"}
"""Labels, menus and error texts of the simulator are its own."""
SOONER: Final = 2.5e-3
"""First replies further apart than this are told [s]."""


def differences(genuine: Answers, simulated: Answers) -> Iterator[str]:
    """What the simulated board does otherwise, in words."""
    ours, theirs = simulated.kinds, genuine.kinds
    for kind in sorted(ours.keys() | theirs.keys()):
        few, many = len(ours.get(kind, ())), len(theirs.get(kind, ()))
        if abs(few - many) > (1 if many > 5 else 0):
            yield f"{kind}: {many} frames, simulated {few}"
    if genuine.frames and simulated.frames:
        first, other = genuine.frames[0][0], simulated.frames[0][0]
        if abs(other - first) > SOONER:
            yield f"first reply after {first * 1e3:.1f} ms, simulated {other * 1e3:.1f}"
    for kind in sorted(ours.keys() & theirs.keys()):
        yield from (f"{kind}.{words}" for words in _fields(theirs[kind][-1], ours[kind][-1]))
    if bool(genuine.text) != bool(simulated.text):
        texts = (repr(text.decode("latin-1")) if text else "none" for text in (genuine.text, simulated.text))
        yield "text {}, simulated {}".format(*texts)
    if genuine.held != simulated.held:
        yield f"the FlightCtrl holds {genuine.held}, simulated {simulated.held}"


def _fields(genuine: Frame, simulated: Frame) -> Iterator[str]:
    """Fields of two frames of one kind that differ."""
    decoder = MessageDecoder()
    left, right = decoder.decode(genuine), decoder.decode(simulated)
    if isinstance(left, Unknown) or isinstance(right, Unknown) or type(left) is not type(right):
        if genuine.payload != simulated.payload:
            yield f"payload {genuine.payload.hex()}, simulated {simulated.payload.hex()}"
        return
    for name in type(left).model_fields:
        one, other = getattr(left, name), getattr(right, name)
        if name in OWN_WORDS or one == other or _is_near(name, one, other):
            continue
        if isinstance(one, tuple):
            pairs = enumerate(zip(one, other, strict=True))
            places = [k for k, (a, b) in pairs if abs(a - b) > (ANALOG.get(k, 0) if name == "analog" else 0)]
            if not places:
                continue
            yield f"{name}{places} {[one[k] for k in places]}, simulated {[other[k] for k in places]}"
        else:
            yield f"{name} {one!s}, simulated {other!s}"


def _is_near(name: str, one: object, other: object) -> bool:
    if not isinstance(one, int) or not isinstance(other, int):
        return False
    if name in TURNS:
        turn, allowed = TURNS[name]
        away = abs(one - other) % turn
        return min(away, turn - away) <= allowed
    return abs(one - other) <= TOLERANCE.get(name, 0)
