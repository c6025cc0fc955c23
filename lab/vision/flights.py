"""Campaigns of flights: troubles that come and go, cameras as they are, one hardship at a time, wrong attitudes.

The eyes look at every image, with the vehicle's attitude and without.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final

from lab.vision.adverse import TRIALS
from lab.vision.decks import LIES
from lab.vision.flight import FPS, VGA, FlightFrame, fly
from lab.vision.looks import Look, eyes, figures, look_at, summed
from lab.vision.parts import Case, Part
from lab.vision.real import DEVICES
from lab.vision.stills import SeedSet, target_named
from lab.vision.weather import SKIES, SkyWeather
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.tags.tagmap import Target
from mkdaemon.vision.track.attitude import AttitudeHistory

NEAR_M, FAR_M, MIDDLE_M = 0.35, 8.0, 4.0
"""Heights of the flights behind cameras, and the distance that divides their figures."""
WEATHER: Final = SKIES | TRIALS


def frames_of(scene: str, which: str, target: Target, seed: int, seconds: float) -> Iterator[FlightFrame]:
    """Render a flight.

    Args:
        scene: `cameras`, `hardships`, `decks`, or anything else for troubles that come and go.
        which: camera, hardship or lie.
        target: what lies on the ground.
        seed: draws it.
        seconds: how long.
    """
    match scene:
        case "cameras":
            device = DEVICES[which]
            return fly(target, seed, seconds=seconds, near=NEAR_M, far=FAR_M, troubled=False, device=device)
        case "hardships":
            sky = WEATHER[which]
            weather = SkyWeather(sky, seed, target.tags[0].size, 0x5C7 if which in SKIES else 0xAD5E)
            lens = VGA if sky.lens.model == VGA.model else sky.lens
            flown = partial(fly, target, seed, seconds=seconds, troubled=False)
            return flown(intrinsics=lens, device=sky.device, weather=weather)
        case "decks":
            return _lied(which, target, seed, seconds)
        case _:
            return fly(target, seed, seconds=seconds)


def _lied(which: str, target: Target, seed: int, seconds: float) -> Iterator[FlightFrame]:
    """Over a deck, or with an attitude that is wrong."""
    lie = LIES[which]
    for frame in fly(target, seed, seconds=seconds, deck=lie.deck):
        yield replace(frame, attitude=AttitudeHistory(lie.report(sample) for sample in frame.attitude.samples))


def lens_of(scene: str, which: str) -> Intrinsics:
    """What the eyes take the camera of a flight for."""
    if scene == "hardships":
        return WEATHER[which].lens
    return VGA.model_copy(update={"line_time": DEVICES[which].line_time}) if scene == "cameras" else VGA


@dataclass(frozen=True, slots=True)
class Kind:
    """Flights of one kind.

    Attributes:
        scene: of `frames_of`.
        rows: which one, and over which target, by the name of the row.
        first: seed of the first flight of each row, above that of the seed set.
        count: flights of each row.
        seconds: of each.
        whole: only images that show the whole target count.
        figures: of what the eyes made of them.
    """

    scene: str
    rows: Mapping[str, tuple[str, str]]
    first: int
    count: int = 6
    seconds: float = 4.0
    whole: bool = True
    figures: Callable[[Sequence[Look]], dict[str, Any]] = figures


def _near_and_far(looks: Sequence[Look]) -> dict[str, Any]:
    return {
        "to_4_m": figures([one for one in looks if one.distance <= MIDDLE_M]),
        "to_8_m": figures([one for one in looks if one.distance > MIDDLE_M]),
    }


BOTH: Final = ("nested", "single")
KINDS: Final = {
    "flights": Kind("flights", {name: ("", name) for name in BOTH}, 0, 12, 8.0, whole=False),
    "decks": Kind("decks", {f"{name}_{target}": (name, target) for name in LIES for target in BOTH}, 1200),
    "real": Kind("cameras", {name: (name, "nested") for name in DEVICES}, 1300, figures=_near_and_far),
    "published": Kind("cameras", {name: (name, "nested") for name in DEVICES}, 1400, 15, whole=False),
    "hardships": Kind("hardships", {name: (name, "nested") for name in SKIES}, 1400),
    "adverse": Kind("hardships", {name: (name, "nested") for name in TRIALS}, 1500),
}
"""By the name of the campaign."""


def fly_row(name: str, kind: str, seed: int, seconds: float | None = None) -> dict[str, list[Look]]:
    """One flight of a row, by the eyes with attitude and without.

    Args:
        name: of the row.
        kind: a key of `KINDS`.
        seed: draws it.
        seconds: how long; None for as long as the kind says.
    """
    flown = KINDS[kind]
    which, target_name = flown.rows[name]
    target = target_named(target_name)
    frames = frames_of(flown.scene, which, target, seed, seconds or flown.seconds)
    return look_at(frames, eyes(target, lens_of(flown.scene, which)), whole=flown.whole)


def _plan(kind: str, quick: bool, seeds: SeedSet) -> list[Part]:
    flown = KINDS[kind]
    return [
        Part(fly_row, (name, kind, seeds.base + flown.first + k), int(FPS * flown.seconds))
        for name in flown.rows
        for k in range(1 if quick else flown.count)
    ]


FLOWN: Final = {kind: Case(partial(_plan, kind), partial(summed, flown.figures)) for kind, flown in KINDS.items()}
"""Posed, wrong, errors and NEES of each row."""
