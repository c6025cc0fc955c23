"""A vehicle in one sentence: the worst of what is known. Every screen begins with it. Pure."""

from __future__ import annotations

from typing import Any, Final

from mkdaemon.client.summary import VehicleStatus, fresh_for
from mkdaemon.telemetry.control import ControlStatus, Phase, Tone
from mkdaemon.telemetry.link import LinkCondition, LinkState
from mkdaemon.telemetry.state import Battery, Flight
from mkdaemon.telemetry.vehicle import VehicleHealth

LINK_WORDS: Final = {
    LinkCondition.UP: "link up",
    LinkCondition.DEGRADED: "link degraded",
    LinkCondition.ONE_WAY: "the board does not hear us",
    LinkCondition.MUTE: "the board is mute",
    LinkCondition.GARBAGE: "only garbage arrives",
    LinkCondition.DOWN: "the port cannot be used",
    LinkCondition.ABSENT: "there is no port",
    LinkCondition.CLOSED: "the port is closed",
}
"""Conditions of the link for a screen."""

STANDS_ON: Final[dict[str, type[Any]]] = {
    "control/status": ControlStatus,
    "health": VehicleHealth,
    "state/flight": Flight,
    "link/state": LinkState,
    "state/battery": Battery,
}
"""Keys and kinds of the arguments of `verdict_of`, in order."""
Verdict = tuple[str, Tone]
"""The sentence, and how good the state is."""


def verdict_of(
    control: ControlStatus | None,
    health: VehicleHealth | None,
    flight: Flight | None,
    link: LinkState | None,
    battery: Battery | None,
) -> Verdict:
    """The worst of what is known.

    Args:
        control: `control/status`; like all of them None where none is known or it is stale.
        health: `health`.
        flight: `state/flight`.
        link: `link/state`.
        battery: `state/battery`.
    """
    if control is None and health is None:
        return "Nothing fresh from the daemon", Tone.BAD
    if health is not None and not health.is_alive:
        return f"The aircraft is silent: {health.reason}", Tone.BAD
    if flight is not None and flight.emergency_landing:
        return "EMERGENCY LANDING: receiver lost", Tone.BAD
    if control is not None and control.pilots_throttle is not None:
        return f"The pilot {control.hands}", Tone.BAD
    if control is not None and control.trouble:
        return control.trouble, Tone.BAD
    if health is not None and health.error:
        return f"ERROR: {health.error}", Tone.BAD
    if battery is not None and battery.is_low:
        return f"BATTERY LOW: {battery.voltage:.1f} V", Tone.BAD
    words, tone = _authority(control, flight)
    if link is None or link.condition.is_usable:
        return words, tone
    return f"{words}; {LINK_WORDS[link.condition]}", Tone.WARN


def _authority(control: ControlStatus | None, flight: Flight | None) -> Verdict:
    if control is None or control.phase is Phase.FREE:
        free = {True: "The pilot flies", False: "On the ground", None: "The pilot has it"}
        return free[None if flight is None else flight.is_flying], Tone.OK
    return phase_words(control), control.phase.tone


def verdict_of_status(status: VehicleStatus) -> Verdict:
    """The worst of the last values of a vehicle; those that are older than their keys allow do not count."""

    def fresh(suffix: str) -> Any:
        sample = status.samples.get(suffix)
        return None if sample is None or (sample.age or 0.0) > fresh_for(suffix) else sample.value

    return verdict_of(*map(fresh, STANDS_ON))


def phase_words(control: ControlStatus) -> str:
    """Who flies and what, as a sentence."""
    words = control.phase.words.format(holder=holder_of(control))
    manoeuvre = f": {manoeuvre_words(control)}" if control.phase is Phase.FLYING and control.manoeuvre else ""
    return words[:1].upper() + words[1:] + manoeuvre


def holder_of(control: ControlStatus) -> str:
    """Who holds the lease."""
    return "nobody" if control.lease is None else control.lease.holder


def manoeuvre_words(control: ControlStatus) -> str:
    """What is flown, and how far it is."""
    if control.manoeuvre is None:
        return f"ended: {control.outcome.replace('_', ' ')}" if control.outcome else "none"
    stage = f", {control.stage}" if control.stage else ""
    return f"{control.manoeuvre}{stage}{', done' if control.is_done and 'done' not in stage else ''}"
