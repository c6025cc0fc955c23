"""The goals of each part of docs/lab/accuracy.md beside what its campaign has measured."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

from tools import accuracy_counts as counts
from tools.accuracy_verdicts import honest_verdict, percent, percents, span, verdict
from tools.accuracy_words import CAMERAS, FAR, NEAR, SKIES, TRIALS, WITH, WITHOUT, Results
from tools.markdown import table

HEAD: Final = ("goal", "measured", "")


def camera_goals(results: Results) -> Iterator[str]:
    """Goals behind the six cameras, case `real`, and of all that is published behind them."""
    rows = {camera: results["real"][camera] for camera in CAMERAS}

    def shares(eyes: str, part: str) -> dict[str, float]:
        return {camera: row[eyes][part]["posed"] / row[eyes][part]["images"] for camera, row in rows.items()}

    def far(eyes: str) -> tuple[str, str]:
        found = shares(eyes, FAR)
        missed = [CAMERAS[camera] for camera, share in found.items() if share < 0.8]
        words = ", ".join(f"{percent(share)} % {CAMERAS[camera]}" for camera, share in found.items())
        return words, f"**missed** by {'; '.join(missed)}" if missed else "met"

    def nees(eyes: str) -> list[float]:
        return [row[eyes][part]["nees_mean"] for part in (NEAR, FAR) for row in rows.values()]

    near, near_blind = (list(shares(eyes, NEAR).values()) for eyes in (WITH, WITHOUT))
    bias = [abs(rows["gamma"][WITH][part]["range_bias_percent"]) for part in (NEAR, FAR)]
    told, blind = counts.published(results, WITH), counts.published(results, WITHOUT)
    both = counts.total(iter((counts.real(results), told, blind)))
    yield from table(
        HEAD,
        [
            (">= 95 % posed with attitude to 4 m", percents(near), verdict(min(near) >= 0.95)),
            (">= 80 % without", percents(near_blind), verdict(min(near_blind) >= 0.8)),
            (">= 80 % with attitude, 4-8 m", *far(WITH)),
            (">= 80 % without, 4-8 m", *far(WITHOUT)),
            (
                "wrong poses: 0",
                f"{counts.real(results)} whole targets; of all published {told} with attitude, {blind} without",
                verdict(both.wrong == 0),
            ),
            (
                "range bias <= 0.2 % under gamma",
                f"{bias[0]:.3f} % to 4 m, {bias[1]:.3f} % beyond",
                verdict(max(bias) <= 0.2),
            ),
            ("NEES 0.7-1.5 with attitude", span(nees(WITH)), honest_verdict(nees(WITH))),
            ("NEES 0.7-1.5 without", span(nees(WITHOUT)), honest_verdict(nees(WITHOUT))),
        ],
    )


def hardship_goals(results: Results) -> Iterator[str]:
    """Goals under the hardships, case `conditions`."""
    found = results["conditions"]["flights"]
    shares = {sky: found[sky]["with_attitude"]["posed"] / found[sky]["with_attitude"]["images"] for sky in SKIES}
    least = min(shares, key=lambda sky: shares[sky])
    rows = [
        (
            ">= 90 % posed with attitude",
            f"{percents(shares.values())}, least: {SKIES[least]}",
            verdict(shares[least] >= 0.9),
        )
    ]
    for eyes, words in (("with_attitude", "with attitude"), ("without", "without")):
        count = counts.hardships(results, eyes)
        values = [found[sky][eyes]["nees_measured_mean"] for sky in SKIES]
        rows.append((f"wrong poses {words}: 0", str(count), verdict(count.wrong == 0)))
        rows.append((f"NEES 0.7-1.5 {words}", span(values), honest_verdict(values)))
    yield from table(HEAD, rows)


def adverse_goals(results: Results) -> Iterator[str]:
    """Goals where the air, the lens or the link is bad, case `adverse`."""
    found = [results["adverse"][name] for name in TRIALS]

    def share(row: Mapping[str, Any], program: str) -> float:
        return float(row[program]["posed"] / row[program]["images"])

    usual = [share(row, WITH) for row in found if share(row, "apriltag") >= 0.5]
    rows = [
        (">= 80 % posed with attitude where AprilTag poses 50 %", percents(usual), verdict(min(usual) >= 0.8)),
    ]
    plain = counts.adverse(results, "apriltag")
    for program, words in ((WITH, "with attitude"), (WITHOUT, "without")):
        count = counts.adverse(results, program)
        rows.append((f"wrong poses {words}: 0", f"{count}; AprilTag {plain}", verdict(count.wrong == 0)))
    yield from table(HEAD, rows)


def deck_goals(results: Results) -> Iterator[str]:
    """Goals over decks and under attitudes that are wrong, case `decks`."""
    count = counts.decks(results)
    pair = {target: counts.deck_rows(results, target) for target in ("nested", "single")}
    shares = [row["posed"] for rows in pair.values() for row in rows]
    rows = [
        ("wrong poses: 0", str(count), verdict(count.wrong == 0)),
        (">= 90 % posed", percents(shares), verdict(min(shares) >= 0.9)),
    ]
    for target, found in pair.items():
        values = [row["nees_mean"] for row in found]
        rows.append((f"NEES 0.7-1.5, {target}", span(values), honest_verdict(values)))
    yield from table(HEAD, rows)


def leaving_goals(results: Results) -> Iterator[str]:
    """Goals of targets that leave the image, case `leaving`."""
    count, faults = counts.leaving(results), results["leaving"]["whole"]["faults"]
    images = f"{results['leaving']['whole']['images']:,}"
    rows = [("faults: 0", f"{faults} of {images} images", verdict(faults == 0))]
    rows.append(("wrong poses: 0", str(count), verdict(count.wrong == 0)))
    yield from table(HEAD, rows)
