"""Looks at what a manoeuvre itself needs: a target, an estimate, an aircraft that flies or stands."""

from __future__ import annotations

import math
from typing import Final

from mkdaemon.control.admission.beginnings import BY_HAND, BY_TARGET, MANOEUVRES, Concern, NewManoeuvre
from mkdaemon.control.admission.row import Rows, Rule, Verdict, passed, stands, when
from mkdaemon.control.admission.situation import ASIDE, EntryEstimate, Situation
from mkdaemon.control.estimator.values import GAS_CENTRE
from mkdaemon.control.path.stored import KEPT
from mkdaemon.telemetry.control import Obstacle
from mkdaemon.telemetry.preflight import CheckState
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.setpoint import SetpointFrame
from mkdaemon.telemetry.vision import EyeState

STANDS: Final = 0.15
"""Up to this height above its standing height the aircraft is on the ground [m]."""
CARRIES: Final = 0.6
"""With more throttle the aircraft may be in the air [share of hover]: a third of its weight is carried."""

_IN_SIGHT: Final = tuple(kind for kind in BY_TARGET if kind is not Concern.TAKE_OFF)
_TAKE_OFF: Final = (Concern.TAKE_OFF,)

NEED_ROWS: Final = Rows()
"""Without which a manoeuvre is not even looked at. `entry_...` are options of `control.autopilot`."""
BEGIN_ROWS: Final = Rows()
"""What it begins with. Where a flight goes on whose sticks had no answer, a pilot flew meanwhile: the aircraft is as he
left it, and what is compared with sticks says nothing."""


@NEED_ROWS.row(
    "frame", (Concern.VELOCITY, Concern.POSITION), "it is given in frame home", Token.NO_FRAME, rule=Rule.ALWAYS
)
def frame(now: Situation, wanted: NewManoeuvre) -> Verdict:
    """Nothing is flown in frame home."""
    if wanted.frame is not SetpointFrame.HOME:
        return passed()
    return stands(refuse(Token.NO_FRAME, name=f"setpoint/{wanted.concern}", frame=SetpointFrame.HOME.value))


@NEED_ROWS.row("path", (Concern.PATH,), "no path of this id is stored", Token.NO_PATH, rule=Rule.ALWAYS)
def stored_path(now: Situation, wanted: NewManoeuvre) -> Verdict:
    """A path must be uploaded before it is flown."""
    if not wanted.path or wanted.path in now.paths:
        return passed()
    return stands(refuse(Token.NO_PATH, path=wanted.path, kept=KEPT - 1))


@NEED_ROWS.row(
    "estimate", _IN_SIGHT, "no camera or source of poses has shown a target yet", Token.NO_ESTIMATE, rule=Rule.ALWAYS
)
def estimate(now: Situation, wanted: NewManoeuvre) -> Verdict:
    """Without an estimate no manoeuvre by the target; a landing that stands has none, and continues."""
    if now.flown is wanted.concern or now.entry is not None:
        return passed()
    return stands(refuse(Token.NO_ESTIMATE, name=f"setpoint/{wanted.concern}"))


@NEED_ROWS.row(
    "one target",
    BY_TARGET,
    f"it names no target, and two are in sight, or the one of a take-off is more than {ASIDE:g} m aside",
    Token.TARGET_UNCLEAR,
)
def one_target(now: Situation, wanted: NewManoeuvre) -> Verdict:
    """Without a name, the target is the one in use, else the one in sight or below."""
    if wanted.target or (now.flown is not None and now.flown.is_by_target):
        return passed()
    entry, name = now.entry, f"setpoint/{wanted.concern}"
    if len(now.in_sight) > 1:
        found = ", ".join(now.in_sight)
        detail = "more than one target is in sight"
        return stands(refuse(Token.TARGET_UNCLEAR, name=name, found=f"one of {found}", detail=detail))
    sees_nothing = bool(now.eyes) and all(stats.state is not EyeState.OK for stats in now.eyes)
    if wanted.concern is not Concern.TAKE_OFF or entry is None or sees_nothing:
        return passed()  # the estimate drifts where nothing is seen, and the row of the cameras says why
    if entry.offset > ASIDE:
        detail = f"the aircraft stands {entry.offset:.1f} m beside its middle"
        return stands(refuse(Token.TARGET_UNCLEAR, name=name, found=entry.target, detail=detail))
    return passed()


@NEED_ROWS.row(
    "target in use",
    BY_TARGET,
    "it names another target than the one in use",
    Token.TARGET_UNCLEAR,
    rule=Rule.ALWAYS,
)
def flown_target(now: Situation, wanted: NewManoeuvre) -> Verdict:
    """In flight by a target no other one takes its place."""
    if not wanted.target or now.flown is None or not now.flown.is_by_target or now.entry is None:
        return passed()
    if wanted.target == now.entry.target:
        return passed()
    name, detail = f"setpoint/{wanted.concern}", f"{wanted.target} is asked for"
    return stands(refuse(Token.TARGET_UNCLEAR, name=name, found=now.entry.target, detail=detail))


@BEGIN_ROWS.row("take-off from the ground", _TAKE_OFF, "a client flies by sticks or attitudes", Token.NOT_ON_GROUND)
def on_ground(now: Situation, wanted: object) -> Verdict:
    """A take-off starts on the ground, not from a flight by sticks or attitude."""
    return when(refuse(Token.NOT_ON_GROUND) if now.flown in BY_HAND else None)


@BEGIN_ROWS.row(
    "board that listens",
    MANOEUVRES,
    "a board is busy and receives nothing",
    Token.NOT_READY,
    rule=Rule.WAITS,
)
def board_listens(now: Situation, wanted: NewManoeuvre) -> Verdict:
    """Begin no flight while a board does not listen: the first frame it hears must be one of neutral sticks."""
    return _waiting(wanted, now.line.reason) if now.line.obstacle is Obstacle.DEAF else passed()


@BEGIN_ROWS.row(
    "answer to the sticks",
    BY_TARGET,
    "a board reports that the gate is shut, or the aircraft does not answer its sticks",
    Token.NO_ANSWER,
    rule=Rule.WAITS,
)
def answer(now: Situation, wanted: NewManoeuvre) -> Verdict:
    """Begin no flight whose sticks would not act: they would wind up until the gate is opened."""
    if not now.unanswered:
        return passed()
    refusal = refuse(Token.NO_ANSWER, detail=now.unanswered)
    return Verdict(CheckState.STANDS, f"an answer to the sticks: {now.unanswered}", refusal)


@BEGIN_ROWS.row(
    "ground contact",
    BY_TARGET,
    "in a take-off that no image has confirmed, or in the last centimetres of a landing",
    Token.NOT_FLYING,
    rule=Rule.ALWAYS,
)
def off_ground(now: Situation, wanted: NewManoeuvre) -> Verdict:
    """A take-off or landing that touches the ground ends by itself, by an abort or by a release."""
    if now.flown is None or now.flown is wanted.concern or not now.is_touching:
        return passed()
    return _grounded(wanted, f"its {now.flown} has not left the ground, or is about to touch it")


@BEGIN_ROWS.row(
    "flying aircraft",
    _IN_SIGHT,
    f"the motors are off, the board reports that it does not fly, or its feet are at most "
    f"{100 * STANDS:g} cm above the target",
    Token.NOT_FLYING,
    rule=Rule.ENTRY,
)
def in_air(now: Situation, wanted: NewManoeuvre) -> Verdict:
    """Nothing that integrates begins while the aircraft stands or is held by hand: its throttle would wind up."""
    entry, detail = now.entry, now.grounded
    feet = math.inf if entry is None or entry.age > now.cfg.autopilot.entry_age else _feet(now, entry)
    if not detail and feet <= STANDS:
        detail = f"its feet are {100.0 * max(feet, 0.0):.0f} cm above the target"
    return _grounded(wanted, detail) if detail else passed()


@BEGIN_ROWS.row(
    "named target", _IN_SIGHT, "it names another target than the one in sight", Token.NOT_READY, rule=Rule.ENTRY
)
def named_target(now: Situation, wanted: NewManoeuvre) -> Verdict:
    """A target that is named must be the one in sight."""
    entry = now.entry
    if entry is None or wanted.target in ("", entry.target):
        return passed()
    return _waiting(wanted, f"an image of {wanted.target}: {entry.target} is in sight")


@BEGIN_ROWS.row(
    "fresh image", _IN_SIGHT, "the newest image is older than `entry_age`", Token.NOT_READY, rule=Rule.ENTRY
)
def fresh_image(now: Situation, wanted: NewManoeuvre) -> Verdict:
    """The newest image must be young."""
    entry = now.entry
    if entry is None or entry.age <= now.cfg.autopilot.entry_age:
        return passed()
    return _waiting(wanted, f"a fresh image of {entry.target}: the last is {entry.age:.2f} s old")


@BEGIN_ROWS.row(
    "speed",
    _IN_SIGHT,
    "it moves faster than `entry_speed` against the target",
    Token.NOT_READY,
    rule=Rule.ENTRY,
    is_asked_again=False,
)
def slow(now: Situation, wanted: NewManoeuvre) -> Verdict:
    """The aircraft must hover."""
    entry = now.entry
    if entry is None or entry.speed <= now.cfg.autopilot.entry_speed:
        return passed()
    return _waiting(wanted, f"a slower aircraft: it moves at {entry.speed:.1f} m/s over {entry.target}")


@BEGIN_ROWS.row(
    "offset",
    _IN_SIGHT,
    "it is more than `entry_offset` of its height beside the target",
    Token.NOT_READY,
    rule=Rule.ENTRY,
    is_asked_again=False,
)
def near(now: Situation, wanted: NewManoeuvre) -> Verdict:
    """The aircraft must be over the target."""
    entry = now.entry
    if entry is None or entry.offset <= now.cfg.autopilot.entry_offset * entry.height:
        return passed()
    where = f"it is {entry.offset:.1f} m beside its middle, {entry.height:.1f} m up"
    return _waiting(wanted, f"a place nearer over {entry.target}: {where}")


@BEGIN_ROWS.row(
    "certainty",
    _IN_SIGHT,
    "the standard deviation of its position, when the next image comes, is above `entry_sd`",
    Token.NOT_READY,
    rule=Rule.ENTRY,
)
def certain(now: Situation, wanted: NewManoeuvre) -> Verdict:
    """The position must stay certain until the next image: with two images a second it does not."""
    entry = now.entry
    if entry is None or entry.sd <= now.cfg.autopilot.entry_sd:
        return passed()
    return _waiting(wanted, f"a certain position: its standard deviation is {100 * entry.sd:.0f} cm")


@BEGIN_ROWS.row(
    "clean images",
    _IN_SIGHT,
    "images have agreed with the model for less than `entry_clean`",
    Token.NOT_READY,
    rule=Rule.ENTRY,
    is_asked_again=False,
)
def clean(now: Situation, wanted: NewManoeuvre) -> Verdict:
    """Images must have agreed with the model for a while."""
    entry = now.entry
    if entry is None or entry.clean >= now.cfg.autopilot.entry_clean:
        return passed()
    return _waiting(wanted, f"images that agree with the model for {now.cfg.autopilot.entry_clean:g} s")


@BEGIN_ROWS.row("running motors", _TAKE_OFF, "the motors are off", Token.NOT_READY, rule=Rule.WAITS)
def motors_run(now: Situation, wanted: NewManoeuvre) -> Verdict:
    """A take-off needs motors that the pilot has started."""
    if now.motors_running is not False:
        return passed()
    return _waiting(wanted, "running motors: the pilot starts them, throttle at its lowest")


@BEGIN_ROWS.row(
    "feet on the ground",
    _TAKE_OFF,
    f"its feet are more than {100 * STANDS:g} cm above the target",
    Token.NOT_READY,
    rule=Rule.WAITS,
)
def feet_down(now: Situation, wanted: NewManoeuvre) -> Verdict:
    """A take-off begins with the lowest throttle, which would drop an aircraft that a pilot holds in the air."""
    entry = now.entry
    if entry is None or entry.age > now.cfg.autopilot.entry_age or wanted.target not in ("", entry.target):
        return passed()
    if _feet(now, entry) <= STANDS:
        return passed()
    return _waiting(wanted, f"an aircraft on the ground: its feet are {_feet(now, entry):.1f} m above the target")


@BEGIN_ROWS.row(
    "throttle at its lowest",
    _TAKE_OFF,
    f"it flies with more than {100 * CARRIES:g} % of the hover throttle",
    Token.NOT_READY,
    rule=Rule.WAITS,
)
def throttle_low(now: Situation, wanted: NewManoeuvre) -> Verdict:
    """The pilot's throttle must not carry the aircraft."""
    gas = now.gas_in_use
    if gas is None or gas <= CARRIES * now.hover_gas:
        return passed()
    found = f"it is at {gas - GAS_CENTRE:+.0f}, which may carry the aircraft"
    return _waiting(wanted, f"the pilot's throttle at its lowest: {found}")


def _waiting(wanted: NewManoeuvre, detail: str) -> Verdict:
    """Say what a manoeuvre waits for; the words stand after "waiting for"."""
    refusal = refuse(Token.NOT_READY, name=wanted.concern.value, detail=detail)
    return Verdict(CheckState.STANDS, detail, refusal)


def _grounded(wanted: NewManoeuvre, detail: str) -> Verdict:
    refusal = refuse(Token.NOT_FLYING, name=f"setpoint/{wanted.concern}", detail=detail)
    return Verdict(CheckState.STANDS, f"an aircraft in the air: {detail}", refusal)


def _feet(now: Situation, entry: EntryEstimate) -> float:
    """Height of the feet above the target [m]."""
    return entry.height - now.cfg.autopilot.stand_height
