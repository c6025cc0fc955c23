"""The goals of docs/lab/accuracy.md: each is a claim about rows of the results, and is met or missed by them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from math import inf
from typing import Any, Final, NamedTuple

from tools.markdown import table

Results = Mapping[str, Any]
"""docs/results/vision.json."""
Row = Mapping[str, Any]
WITH, WITHOUT = "eyes_with_attitude", "eyes_without"
NEAR, FAR = "to_4_m", "to_8_m"
"""Keys of the campaigns behind cameras: vision with and without attitude, by distance."""


class Goal(NamedTuple):
    """Every value is in a range.

    Attributes:
        words: what is wanted.
        values: of the results.
        least: of the range.
        most: of the range.
        form: of one value; `%` for a share.
    """

    words: str
    values: Callable[[Results], Sequence[float]]
    least: float = -inf
    most: float = inf
    form: str = "%"

    def row(self, results: Results) -> tuple[str, str, str]:
        """Return what is wanted, the least and the largest value, and whether it is met."""
        values = self.values(results)
        shown = list(dict.fromkeys(self._shown(value) for value in (min(values), max(values))))
        unit = shown[0].lstrip("0123456789.")
        words = "-".join(one.removesuffix(unit) for one in shown) + unit
        return self.words, words, _verdict([self.least <= value <= self.most for value in values])

    def _shown(self, value: float) -> str:
        return f"{100 * value:.1f}".removesuffix(".0") + " %" if self.form == "%" else self.form.format(value)


class Never(NamedTuple):
    """Something happens in none of many.

    Attributes:
        words: what never happens.
        counts: how often it did, and of how many.
    """

    words: str
    counts: Callable[[Results], Iterable[tuple[int, int]]]

    def row(self, results: Results) -> tuple[str, str, str]:
        """Return what is wanted, the counts, and whether it is met."""
        hits, of = (sum(column) for column in zip(*self.counts(results), strict=True))
        return f"{self.words}: 0", f"{hits} of {of:,}", _verdict([hits == 0])


def _verdict(holds: Sequence[bool]) -> str:
    if all(holds):
        return "met"
    return f"**missed** in {holds.count(False)} of {len(holds)}" if len(holds) > 1 else "**missed**"


def rows_of(tree: Any, *words: str) -> Iterator[Row]:
    """Yield the rows below a part of the results in whose path every word stands; a row has a count `wrong`."""

    def walk(part: Any, path: tuple[str, ...]) -> Iterator[Row]:
        if isinstance(part, Mapping) and "wrong" in part:
            if all(any(word in place for place in path) for word in words):
                yield part
            return
        for name, below in part.items() if isinstance(part, Mapping) else ():
            yield from walk(below, (*path, name))

    yield from walk(tree, ())


def _wrong(rows: Iterable[Row]) -> list[tuple[int, int]]:
    """Wrong poses of each row, and all of them."""
    return [(row["wrong"], row["published"] if "published" in row else row["posed"]) for row in rows]


def _shares(rows: Iterable[Row]) -> list[float]:
    """Posed of the images of each row."""
    return [row["posed"] / row["images"] for row in rows]


def _stills(results: Results, key: str, *conditions: str) -> list[float]:
    rows = results["conditions"]["by_condition"]
    return [row[key] for row in rows if row["condition"].startswith(conditions)]


def _cold(results: Results, target: str, key: str, near: float, far: float) -> list[float]:
    return [row[key] for row in results["cold"][target] if near <= row["distance"] <= far]


def _distances(results: Results, near: float, far: float) -> list[Row]:
    return [row for row in results["accuracy"]["by_distance"] if near <= row["distance"] <= far]


def _steep(results: Results, degrees: int) -> list[float]:
    return [row["posed"] for where in ("centre", "edge") for row in results["view_angle"][where]
            if row["angle_deg"] == degrees]  # fmt: skip


def _honest(words: str, values: Callable[[Results], Sequence[float]]) -> Goal:
    return Goal(f"NEES 0.7-1.5, {words}", values, 0.7, 1.5, "{:.2f}")


def _hardships(results: Results, *words: str) -> Iterator[Row]:
    return rows_of(results["conditions"]["flights"], *words)


def _eyes(results: Results, case: str) -> list[Row]:
    return [row for eyes in (WITH, WITHOUT) for row in rows_of(results[case], eyes)]


def _every(results: Results) -> list[tuple[int, int]]:
    """Wrong poses of all campaigns in which whole targets are seen, and of those that leave the image."""
    parts: list[Iterable[Row]] = [rows_of(results["flights"]), rows_of(results["published"]), _hardships(results)]
    parts += [rows_of(results["decks"]), _eyes(results, "adverse"), _eyes(results, "real")]
    return [count for part in (*parts, [results["leaving"]["whole"]]) for count in _wrong(part)]


def _flown(results: Results, key: str, *words: str) -> list[Any]:
    return [row[key] for row in rows_of(results["flights"], *words)]


def _easy(results: Results) -> list[float]:
    """Shares posed with attitude where AprilTag poses half of the images."""
    trials = [trial for trial in results["adverse"].values() if isinstance(trial, dict)]
    return [share for trial in trials for share in _shares([trial[WITH]]) if _shares([trial["apriltag"]])[0] >= 0.5]


GOALS: Final[Mapping[str, tuple[Goal | Never, ...]]] = {
    "goals": (
        Goal("capability >= 150 Hz", lambda r: [r["rates"]["pipeline_hz"]], least=150, form="{:.0f} Hz"),
        Goal("30 images a second in real time", lambda r: [r["rates"]["loop_30fps"]["images_per_second"]], 29,
             form="{:.1f}"),
        Goal("60 images a second in real time", lambda r: [r["rates"]["loop_60fps"]["images_per_second"]], 58,
             form="{:.1f}"),
        Goal("loop lag p99 <= 2 ms above idle at 30 fps (real-time priority)",
             lambda r: [r["rates"]["loop_30fps"]["above_idle_p99_ms"]], most=2, form="{:.1f} ms"),
        Goal("nested >= 95 % cold with attitude, 0.15-8 m", lambda r: _cold(r, "nested", "posed", 0.15, 8.0), 0.95),
        Goal("single tag >= 85 % at 10 m", lambda r: _cold(r, "single", "posed", 10.0, 10.0), 0.85),
        Goal("the same at 15 m on 1280x720", lambda r: _cold(r, "single_720p", "posed", 15.0, 15.0), 0.85),
        Goal("mean 3-D error 0.5-3.5 m <= 0.05 cm", lambda r: [one["mean_3d_cm"] for one in _distances(r, 0.5, 3.5)],
             most=0.05, form="{:.3f} cm"),
        Goal("the same at 15 ft <= 0.2 cm", lambda r: [one["mean_3d_cm"] for one in _distances(r, 4.5, 4.6)],
             most=0.2, form="{:.3f} cm"),
        Goal("angle sd <= 0.02 deg at 2 ft", lambda r: _angle_sd(r, 0.6), most=0.02, form="{:.3f}"),
        Goal("the same <= 0.05 deg at 4 and 6 ft", lambda r: _angle_sd(r, 1.2) + _angle_sd(r, 1.8), most=0.05,
             form="{:.3f}"),
        Goal("view angle >= 90 % at 75 deg, centre and edge", lambda r: _steep(r, 75), 0.9),
        Goal("the same >= 75 % at 80 deg", lambda r: _steep(r, 80), 0.75),
        Goal("side cut 5-30 % >= 98 % with attitude", lambda r: _stills(r, "posed", "side_cut"), 0.98),
        Goal("patches 10 % >= 75 %", lambda r: _stills(r, "posed", "patches_10"), 0.75),
        Goal("patches 20 % >= 65 %", lambda r: _stills(r, "posed", "patches_20"), 0.65),
        Goal("patches 30 % >= 40 %", lambda r: _stills(r, "posed", "patches_30"), 0.4),
        Goal("shadow 2-5:1 >= 98 %", lambda r: _stills(r, "posed", "shadow"), 0.98),
        Goal("glare >= 85 / 40 %", lambda r: _stills(r, "posed", "glare"), 0.85),
        Goal("gradient, exposure 6 %, noise 40, JPEG q20, defocus 5 px 100 %",
             lambda r: _stills(r, "posed", "gradient", "exposure", "noise", "jpeg", "defocus"), 1.0),
        Goal("flights posed >= 98 % with attitude", lambda r: _flown(r, "posed", "with_attitude"), 0.98),
        Goal("flights posed >= 88 % without", lambda r: _flown(r, "posed", "without_attitude"), 0.88),
        Never("wrong poses of all campaigns", _every),
        Never("wrong poses in flights", lambda r: _wrong(rows_of(r["flights"]))),
        Never("mirrored poses in flights",
              lambda r: zip(_flown(r, "flips"), _flown(r, "published"), strict=True)),
        Never("mirrored poses of single views", lambda r: [(r["flips"]["flipped"], r["flips"]["published"])]),
        Never("tags where there are none",
              lambda r: [(r["false_positives"]["false_positives"], r["false_positives"]["images"])]),
        _honest("measured and published", lambda r: [one["nees_per_dof"] for one in r["nees"].values()
                                                     if isinstance(one, dict)]),
        Goal("labelled tags within 0.5 px >= 45", lambda r: [r["photographs"]["labelled"]["corners_within_half_px"]],
             45, form="{:g}"),
        Goal("rotation series sd <= 1.4 deg", lambda r: [r["photographs"]["rotation"]["step_error_sd_deg"]], most=1.4,
             form="{:.2f}"),
    ),
    "camera_goals": (
        Goal(">= 95 % posed with attitude to 4 m", lambda r: _shares(rows_of(r["real"], WITH, NEAR)), 0.95),
        Goal(">= 80 % without", lambda r: _shares(rows_of(r["real"], WITHOUT, NEAR)), 0.8),
        Goal(">= 80 % with attitude, 4-8 m", lambda r: _shares(rows_of(r["real"], WITH, FAR)), 0.8),
        Goal(">= 80 % without, 4-8 m", lambda r: _shares(rows_of(r["real"], WITHOUT, FAR)), 0.8),
        Never("wrong poses of whole targets", lambda r: _wrong(_eyes(r, "real"))),
        Never("wrong poses of all published with attitude",
              lambda r: _wrong(rows_of(r["published"], WITH))),
        Never("the same without", lambda r: _wrong(rows_of(r["published"], WITHOUT))),
        Goal("range bias <= 0.2 % under gamma",
             lambda r: [abs(one["range_bias_percent"]) for one in rows_of(r["real"]["gamma"], WITH)], most=0.2,
             form="{:.3f} %"),
        _honest("with attitude", lambda r: [one["nees_mean"] for one in rows_of(r["real"], WITH)]),
        _honest("without", lambda r: [one["nees_mean"] for one in rows_of(r["real"], WITHOUT)]),
    ),
    "hardship_goals": (
        Goal(">= 90 % posed with attitude", lambda r: _shares(_hardships(r, WITH)), 0.9),
        Never("wrong poses with attitude", lambda r: _wrong(_hardships(r, WITH))),
        Never("wrong poses without", lambda r: _wrong(_hardships(r, WITHOUT))),
        _honest("with attitude", lambda r: [one["nees_mean"] for one in _hardships(r, WITH)]),
        _honest("without", lambda r: [one["nees_mean"] for one in _hardships(r, WITHOUT)]),
    ),
    "adverse_goals": (
        Goal(">= 80 % posed with attitude where AprilTag poses 50 %", _easy, 0.8),
        Never("wrong poses with attitude", lambda r: _wrong(rows_of(r["adverse"], WITH))),
        Never("wrong poses without", lambda r: _wrong(rows_of(r["adverse"], WITHOUT))),
    ),
    "deck_goals": (
        Never("wrong poses", lambda r: _wrong(rows_of(r["decks"]))),
        Goal(">= 90 % posed", lambda r: _shares(rows_of(r["decks"])), 0.9),
        _honest("nested", lambda r: [one["nees_mean"] for one in rows_of(r["decks"], "nested")]),
        _honest("single", lambda r: [one["nees_mean"] for one in rows_of(r["decks"], "single")]),
    ),
    "leaving_goals": (
        Never("faults", lambda r: [(r["leaving"]["whole"]["faults"], r["leaving"]["whole"]["images"])]),
        Never("wrong poses", lambda r: _wrong([r["leaving"]["whole"]])),
    ),
}  # fmt: skip
"""By the names that the page gives the tables."""


def _angle_sd(results: Results, near: float) -> list[float]:
    """Deviation of roll or pitch, the worse one, at a distance that 2010 measured [deg]."""
    return [max(row["sd_rpy_deg"][:2]) for row in _distances(results, near, near + 0.03)]


def goals_of(name: str) -> Callable[[Results], Iterator[str]]:
    """Return what makes a table of goals."""
    return lambda results: table(("goal", "measured", ""), (goal.row(results) for goal in GOALS[name]))
