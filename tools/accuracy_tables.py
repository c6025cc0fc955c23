"""The tables of docs/lab/accuracy.md, made from what `python -m lab vision --into docs/results/vision.json` measured.

The prose of the page is written by hand; a table stands between `<!-- table NAME -->` and `<!-- end -->`.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping
from math import radians
from pathlib import Path
from typing import Any, Final

from mkdaemon.errors import MkError
from tools.accuracy_goals import goals
from tools.accuracy_part_goals import adverse_goals, camera_goals, deck_goals, hardship_goals, leaving_goals
from tools.accuracy_words import CAMERAS, FAR, LEAVING, LIES, NEAR, SKIES, TRIALS, TROUBLES, WITH, WITHOUT, Results
from tools.markdown import table

PAGE: Final = "docs/lab/accuracy.md"
PLACE: Final = re.compile(r"(?P<begin><!-- table (?P<name>\w+) -->\n).*?(?P<end><!-- end -->)", re.DOTALL)
FEET: Final = {0.6096: "2 ft (0.61 m)", 1.2192: "4 ft (1.22 m)", 1.8288: "6 ft (1.83 m)", 4.572: "15 ft (4.57 m)"}
"""Distances that 2010 measured."""
ATTITUDES: Final = {"with_attitude": "yes", "without_attitude": "no"}


def accuracy_page(root: Path) -> str:
    """Return docs/lab/accuracy.md with fresh tables.

    Raises:
        MkError: a table that is not known, or that has no results.
    """
    results: Results = json.loads((root / "docs/results/vision.json").read_text(encoding="utf-8"))

    def made(place: re.Match[str]) -> str:
        name = place["name"]
        if name not in TABLES:
            msg = f"{PAGE}: no table '{name}'; known are {', '.join(TABLES)}"
            raise MkError(msg)
        try:
            lines = list(TABLES[name](results))
        except KeyError as missing:
            msg = f"{PAGE}, table '{name}': no {missing} in docs/results/vision.json; measure it with --into"
            raise MkError(msg) from None
        return place["begin"] + "\n".join(lines) + "\n" + place["end"]

    return PLACE.sub(made, (root / PAGE).read_text(encoding="utf-8"))


def _share(value: float) -> str:
    return f"{100 * value:.0f} %"


def _tenth(part: float, whole: float) -> str:
    return f"{100 * part / whole:.1f} %"


def _all(values: list[float], digits: int) -> str:
    return " / ".join(f"{value:.{digits}f}" for value in values)


def _seeds(results: Results) -> Iterator[str]:
    """Which reporting seeds each campaign was drawn from."""
    rows = [(f"`{name}`", f"{found['base']:,}") for name, found in results.items() if "base" in _dict(found)]
    yield from table(("campaign", "reporting seeds from"), rows)


def _dict(found: Any) -> Mapping[str, Any]:
    return found if isinstance(found, dict) else {}


def _distances(results: Results) -> Iterator[str]:
    head = ("distance", "posed", "mean 3-D", "largest", "mean range", "sd x / y / z", "sd roll / pitch / yaw", "wrong")
    rows = [
        (
            FEET.get(round(row["distance"], 4), f"{row['distance']:g} m"),
            _share(row["posed"]),
            f"{row['mean_3d_cm']:.3f} cm",
            f"{row['max_3d_cm']:.3f} cm",
            f"{row['mean_xyz_cm'][2]:+.3f} cm",
            f"{_all(row['sd_xyz_cm'], 3)} cm",
            f"{_all(row['sd_rpy_deg'], 3)} deg",
            str(row["wrong"]),
        )
        for row in results["accuracy"]["by_distance"]
    ]
    yield from table(head, rows)


def _target_frame(results: Results) -> Iterator[str]:
    """Where the vehicle is over the target: an error of the angles counts with the distance."""
    rows = []
    for row in results["accuracy"]["by_distance"]:
        across = 100.0 * row["distance"] * radians(max(row["sd_rpy_deg"][:2]))
        along = row["sd_xyz_cm"][2]
        rows.append((f"{row['distance']:.3g} m", f"{across:.2g} cm", f"{along:.2g} cm", f"{across / along:.0f}"))
    head = ("distance", "deviation across in the target's frame", "in the camera's frame", "times")
    yield from table(head, rows)


def _first(row: Mapping[str, Any]) -> str:
    return " / ".join(_share(row[key]) for key in ("decoded", "posed", "posed_without_attitude"))


def _cold(results: Results) -> Iterator[str]:
    cold = results["cold"]
    pairs = zip(cold["nested"], cold["single"], strict=True)
    rows = [
        (f"{nested['distance']:g} m", _first(nested), _first(single), f"{nested['wrong'] + single['wrong']}")
        for nested, single in pairs
    ]
    yield from table(("distance", "nested", "single", "wrong"), rows)


def _cold_720p(results: Results) -> Iterator[str]:
    rows = [(f"{row['distance']:g} m", _first(row), str(row["wrong"])) for row in results["cold"]["single_720p"]]
    yield from table(("distance", "single, 1280x720", "wrong"), rows)


def _steep(results: Results) -> Iterator[str]:
    def cell(row: Mapping[str, Any]) -> str:
        return f"{_share(row['decoded'])} / {_share(row['posed'])}"

    views = results["view_angle"]
    rows = [
        (
            f"{centre['angle_deg']} deg",
            cell(centre),
            cell(edge),
            f"{edge['posed_whole']} of {edge['whole']}",
            str(centre["wrong"] + edge["wrong"]),
        )
        for centre, edge in zip(views["centre"], views["edge"], strict=True)
    ]
    yield from table(("angle", "in the middle", "near the edge of the image", "whole tags there, posed", "wrong"), rows)


def _stills(results: Results) -> Iterator[str]:
    rows = [
        (
            row["condition"].replace("_", " "),
            *(_share(row[key]) for key in ("decoded", "posed", "posed_without_attitude")),
            str(row["wrong"]),
        )
        for row in results["conditions"]["by_condition"]
    ]
    yield from table(("condition", "decoded", "posed with attitude", "without", "wrong"), rows)


def _eyes(row: Mapping[str, Any]) -> str:
    posed = f"{_tenth(row['posed'], row['images'])}, {row['wrong']}"
    if not row["posed"]:
        return posed
    errors = f"{row['median_cm']:.2f} cm, {row['median_deg']:.2f} deg, {row['range_bias_percent']:+.2f} %"
    return f"{posed}; {errors}, {row['nees_mean']:.2f} ({row['nees_median']:.2f})"


def _plain(row: Mapping[str, Any]) -> str:
    return f"{_share(row['posed'] / row['images'])}, {row['wrong']}"


def _cameras(results: Results) -> Iterator[str]:
    found = results["real"]
    near, far = (found["ideal"][WITH][part]["images"] for part in (NEAR, FAR))
    columns = [(eyes, part) for eyes in (WITH, WITHOUT) for part in (NEAR, FAR)]
    head = (f"with attitude, to 4 m ({near} images)", f"4-8 m ({far})", "without, to 4 m", "4-8 m")
    rows = [(words, *(_eyes(found[name][eyes][part]) for eyes, part in columns)) for name, words in CAMERAS.items()]
    yield from table(("camera", *head), rows)


def _plain_cameras(results: Results) -> Iterator[str]:
    found = results["real"]
    columns = [(program, part) for program in ("apriltag", "opencv") for part in (NEAR, FAR)]
    head = ("posed, wrong", "AprilTag, to 4 m", "4-8 m", "OpenCV, to 4 m", "4-8 m")
    rows = [(words, *(_plain(found[name][who][part]) for who, part in columns)) for name, words in CAMERAS.items()]
    yield from table(head, rows)


def _published(results: Results) -> Iterator[str]:
    found = results["published"]["by_camera"]
    rows = []
    for name, words in CAMERAS.items():
        eyes = [found[name][which] for which in (WITH, WITHOUT)]
        rows.append((words, str(eyes[0]["images"]), *(f"{one['published']}, {one['wrong']}" for one in eyes)))
    yield from table(("camera", "images", "with attitude: published, wrong", "without"), rows)


def _hardships(results: Results) -> Iterator[str]:
    rows = []
    for name, words in SKIES.items():
        cells = []
        for eyes in ("with_attitude", "without"):
            row = results["conditions"]["flights"][name][eyes]
            usual = f"{row['median_cm']:.2f} cm, {row['median_deg']:.2f} deg"
            largest = f"{row['largest_cm']:.1f} cm, {row['largest_deg']:.1f} deg"
            cells += [f"{_tenth(row['posed'], row['images'])}, {row['wrong']}", f"{usual}; {largest}"]
            measured = f"{row['nees_measured_mean']:.2f} ({row['nees_measured_median']:.2f})"
            cells.append(f"{measured}, {row['nees_published_mean']:.2f}")
        rows.append((words, *cells))
    yield from table(("hardship", "with attitude", "errors", "NEES", "without", "errors", "NEES"), rows)


def _adverse(results: Results) -> Iterator[str]:
    programs = ("eyes_with_attitude", "eyes_without", "apriltag", "opencv")
    rows = []
    for name, words in TRIALS.items():
        found = [results["adverse"][name][program] for program in programs]
        counted = (f"{_tenth(row['posed'], row['images'])}, {row['wrong']}" for row in found)
        rows.append((words, str(found[0]["images"]), *counted))
    yield from table(("posed, wrong", "images", "with attitude", "without", "AprilTag", "OpenCV"), rows)


def _decks(results: Results) -> Iterator[str]:
    rows = []
    for name, words in LIES.items():
        pair = [results["decks"][f"{name}_{target}"] for target in ("nested", "single")]
        rows.append(
            (
                words,
                *(_tenth(row["posed"], 1.0) for row in pair),
                str(sum(row["wrong"] for row in pair)),
                ", ".join(f"{row['nees_mean']:.2f} ({row['nees_median']:.2f})" for row in pair),
                ", ".join(f"{row['nees_published_mean']:.2f}" for row in pair),
            )
        )
    head = ("attitude", "nested", "single", "wrong", "NEES of the measurement, mean (median)", "as published")
    yield from table(head, rows)


def _leaving(results: Results) -> Iterator[str]:
    """Targets on their way out of the image, by where their middle is."""
    found = results["leaving"]
    rows = []
    for name, words in LEAVING.items():
        one = found[name]
        posed = (_share(share) for share in one["posed_by_way_out"].values())
        counted = (one["images"], one["published"], one["wrong"], one["faults"])
        rows.append((words, *(f"{count:,}" for count in counted), *posed))
    ways = [f"at {_share(float(way))} of the way out" for way in found["whole"]["posed_by_way_out"]]
    yield from table(("target, shutter", "images", "published", "wrong", "faults", *ways), rows)


def _flights(results: Results) -> Iterator[str]:
    rows = []
    for target in ("nested", "single"):
        for eyes, words in ATTITUDES.items():
            row = results["flights"][target][eyes]
            usual = f"{row['median_cm']:.3f} cm, {row['median_deg']:.3f} deg"
            largest = f"{row['p99_cm']:.2f} cm, {row['p99_deg']:.2f} deg"
            posed = f"{_tenth(row['posed'], 1.0)} of {row['frames']}"
            rows.append((target, words, posed, str(row["wrong"]), str(row["flips"]), usual, largest))
    yield from table(("target", "attitude", "posed", "wrong", "flips", "median error", "99 %"), rows)


def _troubles(results: Results) -> Iterator[str]:
    """Posed in flights by what was wrong with the image."""
    found = [results["flights"][target][eyes] for target in ("nested", "single") for eyes in ATTITUDES]
    names = sorted(found[0]["posed_by_trouble"], key=lambda name: (name != "none", name))
    rows = [(TROUBLES[name], *(_share(one["posed_by_trouble"][name]) for one in found)) for name in names]
    yield from table(("trouble", "nested with attitude", "without", "single with attitude", "without"), rows)


def _nees(results: Results) -> Iterator[str]:
    rows = []
    for kind, words in (("measurement", "measurement, exact lens"), ("published", "published, lens within the floor")):
        pair = [results["nees"][f"{kind}_{target}"] for target in ("nested", "single")]
        rows.append((words, *(f"{one['nees_per_dof']:.2f} ({one['median']:.2f})" for one in pair)))
    yield from table(("mean (median) NEES per degree of freedom", "nested", "single"), rows)


TABLES: Final[Mapping[str, Callable[[Results], Iterator[str]]]] = {
    "seeds": _seeds,
    "goals": goals,
    "distances": _distances,
    "target_frame": _target_frame,
    "cold": _cold,
    "cold_720p": _cold_720p,
    "steep": _steep,
    "stills": _stills,
    "cameras": _cameras,
    "plain_cameras": _plain_cameras,
    "camera_goals": camera_goals,
    "published": _published,
    "hardships": _hardships,
    "hardship_goals": hardship_goals,
    "adverse": _adverse,
    "adverse_goals": adverse_goals,
    "decks": _decks,
    "deck_goals": deck_goals,
    "leaving": _leaving,
    "leaving_goals": leaving_goals,
    "flights": _flights,
    "troubles": _troubles,
    "nees": _nees,
}
"""The tables by the names that the page gives them."""
