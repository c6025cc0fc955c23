"""Checks of cameras, target and time stamps, for the rows of admission about sight."""

from __future__ import annotations

from typing import Final

from mkdaemon.control.admission.beginnings import BY_TARGET, Concern, NewManoeuvre
from mkdaemon.control.admission.row import Rows, Rule, Verdict, passed, stands, unknown
from mkdaemon.control.admission.situation import Situation
from mkdaemon.control.heights import heights_found
from mkdaemon.control.motionmatch import ALIKE
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.selfcal import HEIGHTS_LIKELY, HEIGHTS_SURE
from mkdaemon.telemetry.vision import Alarm, EyeState, VisionStats

STAMP_LIMIT: Final = 0.045
"""Largest error of the images' stamps, as it is measured [s]: 20 ms are survived, 80 ms crash, and the measurement is
off by up to 20 ms; docs/lab/control.md, "Estimator"."""
EYES_FRESH: Final = 3.0
"""What a camera said of itself longer ago counts no more [s]; it says so once a second."""
LATEST_IMAGES: Final = 500.0
"""Median age of images that have been looked at, with which a flight may begin [ms]: take-offs were flown by images
0.6 s old; of 0.9 s, which the estimator's history no longer holds, they climbed to 12 m."""
_UNFIT: Final = (Alarm.UNCALIBRATED, Alarm.WRONG_SIZE, Alarm.TARGET_MISMATCH)

_TRUSTED: Final = {Concern.TAKE_OFF: "takeoff", Concern.LAND: "landing"}
"""Words of `trusted_for` of a source of poses; `flight` decides whether the core hears of it at all."""

SIGHT_ROWS: Final = Rows()
"""What prevents a manoeuvre by the target: what its cameras show."""


@SIGHT_ROWS.check(
    "camera",
    BY_TARGET,
    "every camera is still being opened, gone, silent or not calibrated",
    Token.CAMERA_UNFIT,
    Token.CAMERA_OPENING,
)
def camera(now: Situation) -> Verdict:
    """Whether a camera can be flown by."""
    if not now.eyes:
        return unknown("no camera of this daemon; poses may come from elsewhere")
    unfit = [f"{stats.camera}: {why}" for stats in now.eyes if (why := _unfit(stats, now.now))]
    if len(unfit) < len(now.eyes):
        return passed(f"{len(now.eyes) - len(unfit)} of {len(now.eyes)} see, calibrated")
    detail = "; ".join(unfit)
    if any(stats.state is EyeState.OPENING for stats in now.eyes):
        return stands(refuse(Token.CAMERA_OPENING, detail=detail))
    return stands(refuse(Token.CAMERA_UNFIT, detail=detail))


def _unfit(stats: VisionStats, now: float) -> str:
    """Why a camera cannot be flown by; empty where it can."""
    age = now - stats.stamp.monotonic
    if age > EYES_FRESH:
        return f"{EyeState.SILENT.value}: nothing was heard of it for {age:.0f} s"
    for alarm in _UNFIT:
        if alarm in stats.alarms:
            return stats.alarms[alarm]
    return "" if stats.state is EyeState.OK else f"{stats.state.value}: {stats.reason}"


@SIGHT_ROWS.row(
    "trusted source",
    tuple(_TRUSTED),
    "only sources of poses can be flown by, and `trusted_for` of none allows it",
    Token.SOURCE_UNTRUSTED,
    rule=Rule.ALWAYS,
)
def trusted(now: Situation, wanted: NewManoeuvre) -> Verdict:
    """Take off and land by a source of poses only where its section allows that."""
    if now.flown is wanted.concern:
        return passed()
    word = _TRUSTED[wanted.concern]
    fit = [stats for stats in now.eyes if not _unfit(stats, now.now)]
    if not fit or any(stats.trusted_for is None or word in stats.trusted_for for stats in fit):
        return passed()
    sources = ", ".join(stats.camera for stats in fit)
    return stands(refuse(Token.SOURCE_UNTRUSTED, name=f"setpoint/{wanted.concern}", sources=sources, word=word))


@SIGHT_ROWS.check("agreement of cameras", BY_TARGET, "a camera contradicts the others", Token.CAMERAS_CONTRADICT)
def agreement(now: Situation) -> Verdict:
    """Whether the cameras agree."""
    if now.contradicting:
        return stands(refuse(Token.CAMERAS_CONTRADICT, cameras=", ".join(now.contradicting)))
    return passed("no camera contradicts another")


@SIGHT_ROWS.check(
    "scale of heights",
    BY_TARGET,
    "the barometer significantly contradicts the heights of images",
    Token.HEIGHTS_CONTRADICTED,
)
def heights(now: Situation) -> Verdict:
    """Whether the barometer agrees with the heights that images show."""
    found = heights_found(now.eyes)
    if found is None:
        return unknown("nothing compares them yet: lift it by hand over the target, from 0.7 m up by a metre and back")
    if found.odds >= HEIGHTS_SURE:
        return stands(found.refusal)
    return unknown(f"watch it: {found.refusal.reason}") if found.odds >= HEIGHTS_LIKELY else passed(found.words)


@SIGHT_ROWS.check(
    "age of images",
    BY_TARGET,
    f"half of the images are older than {LATEST_IMAGES:g} ms after processing",
    Token.IMAGES_LATE,
)
def lateness(now: Situation) -> Verdict:
    """Age of images after processing."""
    if not now.eyes:
        return unknown("no camera of this daemon; poses may come from elsewhere")
    eyes = [stats for stats in now.eyes if now.now - stats.stamp.monotonic <= EYES_FRESH and stats.processed]
    if not eyes:
        return unknown(f"no image of {', '.join(stats.camera for stats in now.eyes)} has been looked at lately")
    best = min(eyes, key=lambda stats: stats.latency_p50_ms)
    if best.latency_p50_ms > LATEST_IMAGES:
        return stands(refuse(Token.IMAGES_LATE, camera=best.camera, late=best.latency_p50_ms, limit=LATEST_IMAGES))
    return passed(f"half of them are looked at within {best.latency_p50_ms:.0f} ms of their exposure")


@SIGHT_ROWS.check("target", BY_TARGET, "never; it reports when the target was last in sight")
def target(now: Situation) -> Verdict:
    """Time since the target was last in sight."""
    age = now.target_age
    if age is None:
        return unknown("none was seen; from the ground that says nothing, in the air autonomous flight waits for it")
    return passed("in sight") if age <= 1.0 else unknown(f"the last image of it is {age:.0f} s old")


@SIGHT_ROWS.check(
    "time stamps",
    BY_TARGET,
    f"camera and boards move more than {1000 * STAMP_LIMIT:g} ms apart, or against each other",
    Token.CAMERA_TURNED,
    Token.STAMPS_OFF,
    is_asked_again=False,
)
def stamps(now: Situation) -> Verdict:
    """Whether camera and boards tell of the same motion at the same time."""
    match = now.stamps
    if match is None:
        return unknown("nothing moved enough in sight of the target: turn it by hand over the target, some degrees")
    if match.likeness <= -ALIKE:
        return stands(refuse(Token.CAMERA_TURNED, likeness=match.likeness))
    if match.likeness < ALIKE:
        return unknown(f"camera and boards tell of different motion (correlation {match.likeness:.1f}): move faster")
    if abs(match.lag) > STAMP_LIMIT:
        return stands(refuse(Token.STAMPS_OFF, lag=1000.0 * match.lag, limit=1000.0 * STAMP_LIMIT))
    return passed(f"camera and boards move together to {1000.0 * match.lag:+.0f} ms")
