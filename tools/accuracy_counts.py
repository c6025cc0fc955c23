"""How many poses each campaign of docs/results/vision.json has published, and how many of them are wrong."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from tools.accuracy_words import CAMERAS, FAR, LIES, NEAR, SKIES, TRIALS, WITH, WITHOUT, Results


class Count(NamedTuple):
    """Poses of one campaign."""

    poses: int
    wrong: int

    def __str__(self) -> str:
        """Return the words of a cell."""
        return f"{self.wrong} of {self.poses:,}"


def total(counts: Iterator[Count]) -> Count:
    """Return the sum of several counts."""
    every = list(counts)
    return Count(sum(count.poses for count in every), sum(count.wrong for count in every))


def flights(results: Results) -> Count:
    """Flights over both targets, with and without attitude."""
    return total(Count(row["published"], row["wrong"]) for row in flown(results))


def flown(results: Results) -> list[Mapping[str, Any]]:
    """Return the four rows of the flights: nested and single, each with and without attitude."""
    eyes = ("with_attitude", "without_attitude")
    return [results["flights"][target][which] for target in ("nested", "single") for which in eyes]


def published(results: Results, *eyes: str) -> Count:
    """All that is published behind the six cameras.

    Args:
        results: docs/results/vision.json.
        eyes: `WITH`, `WITHOUT` or both.
    """
    rows = (results["published"]["by_camera"][camera][which] for camera in CAMERAS for which in eyes)
    return total(Count(row["published"], row["wrong"]) for row in rows)


def hardships(results: Results, *eyes: str) -> Count:
    """Whole targets under the hardships; `eyes` are `with_attitude`, `without` or both."""
    rows = (results["conditions"]["flights"][sky][which] for sky in SKIES for which in eyes)
    return total(Count(row["posed"], row["wrong"]) for row in rows)


def deck_rows(results: Results, target: str) -> list[Mapping[str, Any]]:
    """Return the rows over decks of one target, `nested` or `single`."""
    return [results["decks"][f"{lie}_{target}"] for lie in LIES]


def decks(results: Results) -> Count:
    """Whole targets on decks, under attitudes that are wrong."""
    rows = deck_rows(results, "nested") + deck_rows(results, "single")
    return total(Count(round(row["images"] * row["posed"]), row["wrong"]) for row in rows)


def real(results: Results) -> Count:
    """Whole targets behind the six cameras to 8 m."""
    rows = (
        results["real"][camera][eyes][part] for camera in CAMERAS for eyes in (WITH, WITHOUT) for part in (NEAR, FAR)
    )
    return total(Count(row["posed"], row["wrong"]) for row in rows)


def adverse(results: Results, *programs: str) -> Count:
    """Whole targets where air, lens or link are bad; `programs` are `WITH`, `WITHOUT`, `apriltag` or several."""
    rows = (results["adverse"][trial][program] for trial in TRIALS for program in programs)
    return total(Count(row["posed"], row["wrong"]) for row in rows)


def leaving(results: Results) -> Count:
    """Targets that leave the image."""
    whole = results["leaving"]["whole"]
    return Count(whole["published"], whole["wrong"])
