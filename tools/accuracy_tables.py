"""The tables of docs/lab/accuracy.md, made from what `python -m lab vision --into docs/results/vision.json` measured.

The prose of the page is written by hand; a table stands between `<!-- table NAME -->` and `<!-- end -->`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any, Final

from tools.markdown import table

Results = Mapping[str, Any]
"""docs/results/vision.json."""
Row = Mapping[str, Any]
Rows = Iterator[tuple[str, ...]]
FEET: Final = {0.6096: "2 ft (0.61 m)", 1.2192: "4 ft (1.22 m)", 1.8288: "6 ft (1.83 m)", 4.572: "15 ft (4.57 m)"}
"""Distances that 2010 measured."""
WORDS: Final = {"rolling_told": "rolling, line time known", "rolling_untold": "rolling, line time unknown"}
"""Names of parts whose keys do not say it."""
COUNTED: Final = ("flights", "published", "hardships", "decks", "adverse", "real", "leaving")
"""Campaigns whose wrong poses are summed."""


def _named(part: Any) -> Iterator[tuple[str, Any]]:
    """The parts of a campaign, each with its name as words, beside figures of the whole."""
    return ((WORDS.get(name, name.replace("_", " ")), row) for name, row in part.items() if isinstance(row, Mapping))


def _counts(tree: Any) -> Iterator[Row]:
    """Yield the rows below a part of the results; a row has a count `wrong`."""
    if isinstance(tree, Mapping):
        if "wrong" in tree:
            yield tree
        else:
            for below in tree.values():
                yield from _counts(below)


def _share(value: float, digits: int = 0) -> str:
    return f"{100 * value:.{digits}f} %"


def _all(values: list[float], digits: int) -> str:
    return " / ".join(f"{value:.{digits}f}" for value in values)


def _first(row: Row) -> str:
    return " / ".join(_share(row[key]) for key in ("posed", "posed_without_attitude"))


def _wrong(results: Results) -> Rows:
    """Poses and wrong ones of each campaign, its first seed, and of all together."""
    sums = [0, 0]
    for name in COUNTED:
        rows = list(_counts(results[name]))
        counts = [sum(row[key] for row in rows) for key in ("posed", "wrong")]
        sums = [whole + count for whole, count in zip(sums, counts, strict=True)]
        yield f"`{name}`", f"{results[name]['base']:,}", f"{counts[0]:,}", str(counts[1])
    yield "all", "", f"{sums[0]:,}", str(sums[1])


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


def _steep(results: Results) -> Rows:
    for centre, edge in zip(results["view_angle"]["centre"], results["view_angle"]["edge"], strict=True):
        wrong = centre["wrong"] + edge["wrong"]
        yield f"{centre['angle_deg']} deg", _share(centre["posed"]), _share(edge["posed"]), str(wrong)


def _stills(results: Results) -> Rows:
    for row in results["conditions"]["by_condition"]:
        yield row["condition"].replace("_", " "), *_first(row).split(" / "), str(row["wrong"])


def _flown(results: Results, *, campaign: str) -> Rows:
    """A campaign of flights: each part, and what was made of it with attitude and without."""
    for words, part in _named(results[campaign]):
        yield words, *map(_figures, _counts(part))


def _figures(row: Row) -> str:
    """Posed of all images and wrong; median errors, largest ones, and NEES, where they were kept."""
    shown = [f"{_share(row['posed'] / row['images'], 1)}, {row['wrong']}"]
    for name, digits in (("median", 2), ("largest", 1)):
        if f"{name}_cm" in row:
            shown.append(f"{row[f'{name}_cm']:.{digits}f} cm, {row[f'{name}_deg']:.{digits}f} deg")
    if "nees_mean" in row:
        shown.append(f"{row['nees_mean']:.2f} ({row['nees_median']:.2f})")
    return "; ".join(shown)


def _leaving(results: Results) -> Rows:
    for words, part in _named(results["leaving"]):
        yield words, f"{part['images']:,}", *(f"{part[name]:,}" for name in ("posed", "wrong", "faults"))


_SHOWN: Final[Mapping[str, tuple[str, Callable[[Results], Rows]]]] = {
    "wrong": ("campaign|reporting seeds from|poses|wrong", _wrong),
    "distances": (
        "distance|posed|mean 3-D|largest|mean range|sd x / y / z|sd roll / pitch / yaw|wrong",
        _distances,
    ),
    "cold": ("distance|nested|single|wrong", _cold),
    "steep": ("angle|in the middle|near the edge of the image|wrong", _steep),
    "stills": ("condition|posed with attitude|without|wrong", _stills),
    "cameras": ("camera|with attitude, to 4 m|4-8 m|without, to 4 m|4-8 m", partial(_flown, campaign="real")),
    "hardships": ("hardship|with attitude|without", partial(_flown, campaign="hardships")),
    "adverse": ("hardship|with attitude|without", partial(_flown, campaign="adverse")),
    "decks": ("attitude, target|with attitude", partial(_flown, campaign="decks")),
    "leaving": ("target, shutter|images|posed|wrong|exceptions", _leaving),
    "flights": ("target|with attitude|without", partial(_flown, campaign="flights")),
}
"""The columns of each table, and its rows."""


def _lines(head: str, rows: Callable[[Results], Rows]) -> Callable[[Results], Iterator[str]]:
    return lambda results: table(tuple(head.split("|")), rows(results))


TABLES: Final[Mapping[str, Callable[[Results], Iterator[str]]]] = {
    name: _lines(*shown) for name, shown in _SHOWN.items()
}
"""The tables by the names that the page gives them."""
