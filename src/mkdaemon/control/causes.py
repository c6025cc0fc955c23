"""Causes for a missing pose in a flight by the target: the chain from the effect down to the root. Pure.

Each link of the chain is looked for by itself; what is not known is left out.
"""

from __future__ import annotations

from collections import Counter
from typing import Final

from mkdaemon.control.vehicle import VehicleFacts
from mkdaemon.telemetry.control import Cause, CauseKind
from mkdaemon.telemetry.vision import EyeState

ATTITUDE_OVERDUE: Final = 0.4
"""An attitude stream that is silent for longer has missed three periods of its slowest rate, 10 Hz [s]."""


def causes(facts: VehicleFacts, *, pose_age: float, attitude_age: float | None, now: float) -> tuple[Cause, ...]:
    """Causes for a missing pose, the effect first.

    Args:
        facts: what is known of the cameras and the line.
        pose_age: time since the last pose [s].
        attitude_age: time since the last attitude was reported [s]; None where none ever was.
        now: [s].
    """
    chain = [Cause.of(CauseKind.NO_POSE, seconds=pose_age)]
    refused = [each for each in facts.refused_sights if each.stamp.monotonic > now - pose_age]
    if refused:
        ((reason, _),) = Counter(each.refusal.value for each in refused).most_common(1)
        is_decoded = any(each.decode_age is not None and each.decode_age <= pose_age for each in refused)
        kind = CauseKind.REFUSED_IN_VIEW if is_decoded else CauseKind.REFUSED
        chain.append(Cause.of(kind, count=len(refused), detail=reason))
    troubled = [eye for eye in facts.eyes if eye.state is not EyeState.OK]
    chain += [Cause.of(CauseKind.CAMERA, detail=f"{eye.camera} {eye.state.value}: {eye.reason}") for eye in troubled]
    if attitude_age is None:
        chain.append(Cause.of(CauseKind.NEVER_ATTITUDE))
    elif attitude_age > ATTITUDE_OVERDUE:
        chain.append(Cause.of(CauseKind.NO_ATTITUDE, seconds=attitude_age))
    health = facts.health
    if health is not None and health.echo.lost:
        chain.append(Cause.of(CauseKind.UNANSWERED, count=health.echo.lost, of=health.echo.sent))
    return tuple(chain)
