"""The tables of docs/lab/accuracy.md, made from what `python -m lab vision --into docs/results/vision.json` measured.

The prose of the page is written by hand; a table stands between `<!-- table NAME -->` and `<!-- end -->`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final

from tools.accuracy_goals import FAR, GOALS, NEAR, WITH, WITHOUT, Results, Row, goals_of
from tools.markdown import table

Rows = Iterator[tuple[str, ...]]
FEET: Final = {0.6096: "2 ft (0.61 m)", 1.2192: "4 ft (1.22 m)", 1.8288: "6 ft (1.83 m)", 4.572: "15 ft (4.57 m)"}
"""Distances that 2010 measured."""
EYES: Final = ("with_attitude", "without_attitude")
WORDS: Final = {"rolling_told": "rolling, line time known", "rolling_untold": "rolling, line time unknown"}
"""Names of parts whose keys do not say it."""
TARGETS: Final = ("nested", "single")


def _named(part: Any) -> Iterator[tuple[str, Any]]:
    """The parts of a campaign, each with its name as words, beside figures of the whole."""
    return ((WORDS.get(name, name.replace("_", " ")), row) for name, row in part.items() if isinstance(row, Mapping))


def _share(value: float, digits: int = 0) -> str:
    return f"{100 * value:.{digits}f} %"


def _all(values: list[float], digits: int) -> str:
    return " / ".join(f"{value:.{digits}f}" for value in values)


def _posed(row: Row) -> str:
    """Posed of all images, and wrong."""
    return f"{_share(row['posed'] / row['images'], 1)}, {row['wrong']}"


def _first(row: Row) -> str:
    return " / ".join(_share(row[key]) for key in ("decoded", "posed", "posed_without_attitude"))


def _seeds(results: Results) -> Rows:
    """Which reporting seeds each campaign was drawn from."""
    found = ((name, one) for name, one in results.items() if isinstance(one, dict) and "base" in one)
    return ((f"`{name}`", f"{one['base']:,}") for name, one in found)


def _distances(results: Results) -> Rows:
    for row in results["accuracy"]["by_distance"]:
        yield (
            FEET.get(round(row["distance"], 4), f"{row['distance']:g} m"),
            _share(row["posed"]),
            f"{row['mean_3d_cm']:.3f} cm",
            f"{row['max_3d_cm']:.3f} cm",
            f"{row['mean_xyz_cm'][2]:+.3f} cm",
            f"{_all(row['sd_xyz_cm'], 3)} cm",
            f"{_all(row['sd_rpy_deg'], 3)} deg",
            str(row["wrong"]),
        )


def _cold(results: Results) -> Rows:
    for nested, single in zip(results["cold"]["nested"], results["cold"]["single"], strict=True):
        wrong = nested["wrong"] + single["wrong"]
        yield f"{nested['distance']:g} m", _first(nested), _first(single), str(wrong)


def _cold_720p(results: Results) -> Rows:
    return ((f"{row['distance']:g} m", _first(row), str(row["wrong"])) for row in results["cold"]["single_720p"])


def _steep(results: Results) -> Rows:
    for centre, edge in zip(results["view_angle"]["centre"], results["view_angle"]["edge"], strict=True):
        cells = (f"{_share(row['decoded'])} / {_share(row['posed'])}" for row in (centre, edge))
        whole, wrong = f"{edge['posed_whole']} of {edge['whole']}", centre["wrong"] + edge["wrong"]
        yield f"{centre['angle_deg']} deg", *cells, whole, str(wrong)


def _stills(results: Results) -> Rows:
    for row in results["conditions"]["by_condition"]:
        yield row["condition"].replace("_", " "), *_first(row).split(" / "), str(row["wrong"])


def _cameras(results: Results) -> Rows:
    for words, camera in _named(results["real"]):
        cells = []
        for row in (camera[eyes][part] for eyes in (WITH, WITHOUT) for part in (NEAR, FAR)):
            errors = "" if not row["posed"] else (
                f"; {row['median_cm']:.2f} cm, {row['median_deg']:.2f} deg, {row['range_bias_percent']:+.2f} %, "
                f"{row['nees_mean']:.2f} ({row['nees_median']:.2f})"
            )  # fmt: skip
            cells.append(_posed(row) + errors)
        yield words, *cells


def _plain_cameras(results: Results) -> Rows:
    for words, camera in _named(results["real"]):
        rows = [camera[program][part] for program in ("apriltag", "opencv") for part in (NEAR, FAR)]
        yield words, *(f"{_share(row['posed'] / row['images'])}, {row['wrong']}" for row in rows)


def _published(results: Results) -> Rows:
    for words, camera in _named(results["published"]):
        eyes = [camera[which] for which in (WITH, WITHOUT)]
        yield words, str(eyes[0]["images"]), *(f"{one['posed']}, {one['wrong']}" for one in eyes)


def _hardships(results: Results) -> Rows:
    for words, hardship in _named(results["conditions"]["flights"]):
        cells = []
        for row in (hardship[eyes] for eyes in (WITH, WITHOUT)):
            usual = f"{row['median_cm']:.2f} cm, {row['median_deg']:.2f} deg"
            largest = f"{row['largest_cm']:.1f} cm, {row['largest_deg']:.1f} deg"
            measured = f"{row['nees_mean']:.2f} ({row['nees_median']:.2f})"
            cells += [_posed(row), f"{usual}; {largest}", f"{measured}, {row['nees_published_mean']:.2f}"]
        yield words, *cells


def _adverse(results: Results) -> Rows:
    for words, trial in _named(results["adverse"]):
        found = [trial[program] for program in (WITH, WITHOUT, "apriltag", "opencv")]
        yield words, str(found[0]["images"]), *map(_posed, found)


def _decks(results: Results) -> Rows:
    for words, nested in _named(results["decks"]):
        name, _, target = words.rpartition(" ")
        if target != TARGETS[0]:
            continue
        pair = [nested[WITH], results["decks"][f"{name.replace(' ', '_')}_{TARGETS[1]}"][WITH]]
        yield (
            name,
            *(_share(row["posed"] / row["images"], 1) for row in pair),
            str(sum(row["wrong"] for row in pair)),
            ", ".join(f"{row['nees_mean']:.2f} ({row['nees_median']:.2f})" for row in pair),
            ", ".join(f"{row['nees_published_mean']:.2f}" for row in pair),
        )


def _leaving(results: Results) -> Rows:
    """Targets on their way out of the image, by where their middle is."""
    for words, one in _named(results["leaving"]):
        counts = (f"{one[key]:,}" for key in ("images", "published", "wrong", "faults"))
        yield words, *counts, *map(_share, one["posed_by_way_out"].values())


def _flights(results: Results) -> Rows:
    for target in TARGETS:
        for eyes in EYES:
            row = results["flights"][target][eyes]
            usual = f"{row['median_cm']:.3f} cm, {row['median_deg']:.3f} deg"
            largest = f"{row['p99_cm']:.2f} cm, {row['p99_deg']:.2f} deg"
            posed = f"{_share(row['posed'], 1)} of {row['frames']}"
            yield f"{target} {eyes.replace('_', ' ')}", posed, str(row["wrong"]), str(row["flips"]), usual, largest


def _troubles(results: Results) -> Rows:
    """Posed in flights by what was wrong with the image."""
    found = [results["flights"][target][eyes] for target in TARGETS for eyes in EYES]
    names = sorted(found[0]["posed_by_trouble"], key=lambda name: (name != "none", name))
    return ((name, *(_share(one["posed_by_trouble"][name]) for one in found)) for name in names)


def _nees(results: Results) -> Rows:
    for kind, words in (("measurement", "measurement, exact lens"), ("published", "published, lens within the floor")):
        pair = [results["nees"][f"{kind}_{target}"] for target in TARGETS]
        yield words, *(f"{one['nees_per_dof']:.2f} ({one['median']:.2f})" for one in pair)


_SHOWN: Final[Mapping[str, tuple[str, Callable[[Results], Rows]]]] = {
    "seeds": ("campaign|reporting seeds from", _seeds),
    "distances": ("distance|posed|mean 3-D|largest|mean range|sd x / y / z|sd roll / pitch / yaw|wrong", _distances),
    "cold": ("distance|nested|single|wrong", _cold),
    "cold_720p": ("distance|single, 1280x720|wrong", _cold_720p),
    "steep": ("angle|in the middle|near the edge of the image|whole tags there, posed|wrong", _steep),
    "stills": ("condition|decoded|posed with attitude|without|wrong", _stills),
    "cameras": ("camera|with attitude, to 4 m|4-8 m|without, to 4 m|4-8 m", _cameras),
    "plain_cameras": ("posed, wrong|AprilTag, to 4 m|4-8 m|OpenCV, to 4 m|4-8 m", _plain_cameras),
    "published": ("camera|images|with attitude: published, wrong|without", _published),
    "hardships": ("hardship|with attitude|errors|NEES|without|errors|NEES", _hardships),
    "adverse": ("posed, wrong|images|with attitude|without|AprilTag|OpenCV", _adverse),
    "decks": ("attitude|nested|single|wrong|NEES of the measurement, mean (median)|as published", _decks),
    "leaving": (
        "target, shutter|images|published|wrong|faults|at 35 % of the way out|75 %|100 %|125 %",
        _leaving,
    ),
    "flights": ("target|posed|wrong|flips|median error|99 %", _flights),
    "troubles": ("trouble|nested with attitude|without|single with attitude|without", _troubles),
    "nees": ("mean (median) NEES per degree of freedom|nested|single", _nees),
}
"""The columns of each table, and its rows."""


def _lines(head: str, rows: Callable[[Results], Rows]) -> Callable[[Results], Iterator[str]]:
    return lambda results: table(tuple(head.split("|")), rows(results))


TABLES: Final[Mapping[str, Callable[[Results], Iterator[str]]]] = {
    **{name: _lines(*shown) for name, shown in _SHOWN.items()},
    **{name: goals_of(name) for name in GOALS},
}
"""The tables by the names that the page gives them."""
