"""Common parts of mission file readers: the place of a mistake, and the returned draft."""

from __future__ import annotations

import math
import unicodedata
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final

from pydantic import ValidationError

from mkdaemon.errors import ConfigError
from mkdaemon.foreignfiles import parse_number
from mkdaemon.telemetry.mission import Mission, MissionPoint

MOST_POINTS: Final = 2000
"""Points, or items of a plan, that one file may have; no NaviCtrl holds more than 254 points."""


class AltitudeReference(StrEnum):
    """What the altitudes in a file are measured from."""

    START = "start"
    """The place where the motors are started; also what files call relative."""
    SEA_LEVEL = "sea level"
    """Mean sea level; needs the elevation of the starting place."""
    ABSENT = "absent"
    """The file gives no altitude that counts; the user has to."""


@dataclass(frozen=True, slots=True)
class MissionDraft:
    """A mission as a file has it, before its altitudes mean ours.

    Attributes:
        mission: points; `altitude` is measured from `reference` [m].
        reference: what the altitudes are measured from.
        notes: what the file holds beside the mission and is left out, each in words.
        origins: of items, for each point the number of the item it was made of, from 0.
    """

    mission: Mission
    reference: AltitudeReference = AltitudeReference.START
    notes: tuple[str, ...] = ()
    origins: tuple[int, ...] = ()

    def settled(self, name: str, *, start_elevation: float | None = None, altitude: float | None = None) -> Mission:
        """Return the mission with altitudes above the starting place.

        Args:
            name: the file, for the message.
            start_elevation: elevation of the starting place above mean sea level [m].
            altitude: put every point at this height above the starting place [m].

        Raises:
            ConfigError: the file's altitudes need one of the two arguments, or end outside the range of a point.
        """
        if altitude is not None:
            points = (point.model_copy(update={"altitude": altitude}) for point in self.mission.points)
            return Mission(points=tuple(points), name=self.mission.name)
        if self.reference is AltitudeReference.START:
            return self.mission
        if self.reference is AltitudeReference.ABSENT:
            msg = f"{name}: the file gives no altitudes; put every point at one height with --altitude METRES"
            raise ConfigError(msg)
        if start_elevation is None:
            msg = (
                f"{name}: altitudes are above sea level but the NaviCtrl flies above the starting place; "
                "add --start-elevation METRES (elevation of that place) or --altitude METRES"
            )
            raise ConfigError(msg)
        try:
            return self.mission.raised(-start_elevation)
        except ValueError as error:
            msg = f"{name}: --start-elevation {start_elevation:g} puts a point out of range: {reason(error)}"
            raise ConfigError(msg) from error


@dataclass(frozen=True, slots=True)
class FilePlace:
    """Where in a file something stands, for messages.

    Attributes:
        name: the file.
        line: counted from 1.
    """

    name: str
    line: int

    def __str__(self) -> str:
        return f"{self.name}:{self.line}"

    def wrong(self, what: str, fix: str) -> ConfigError:
        """Return the error that says what is wrong here and how to mend it."""
        return ConfigError(f"{self}: {what}; {fix}")

    def number(self, word: str, text: str | None) -> float:
        """Read a decimal number.

        Raises:
            ConfigError: it is absent or no finite number.
        """
        try:
            value = parse_number(text or "")
        except ValueError:
            shown = "is missing" if text is None or not text.strip() else f"is {text.strip()!r}, no number"
            raise self.wrong(f"{word} {shown}", "write a decimal number such as 48.137") from None
        if not math.isfinite(value):
            raise self.wrong(f"{word} is {(text or '').strip()!r}, no finite number", "write a decimal number")
        return value

    def given(self, word: str, value: Any) -> float | None:
        """A number of a document; None where it is not given, which NaN says too.

        Raises:
            ConfigError: it is not a number, or infinite.
        """
        if value is None or (isinstance(value, float) and math.isnan(value)):
            return None
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.wrong(f"{word} is {value!r}, no number", "save the mission again")
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if math.isinf(number):
            raise self.wrong(f"{word} is infinite", "correct the value")
        return number

    def whole(self, word: str, text: str | None) -> int:
        """Read a whole number; a fraction of zero ("3.0") is one too.

        Raises:
            ConfigError: it is absent or not whole.
        """
        value = self.number(word, text)
        if value != int(value):
            raise self.wrong(f"{word} is {(text or '').strip()}", "write a whole number")
        return int(value)

    def point(self, **fields: Any) -> MissionPoint:
        """Make a point from what was read here.

        Raises:
            ConfigError: a value is out of range.
        """
        try:
            return MissionPoint(**fields)
        except ValidationError as error:
            raise self.wrong(reason(error), "correct the value") from error


def short_name(text: str | None) -> str:
    """A name of another program as a point can carry it: at most four ASCII characters, accents left out."""
    plain = unicodedata.normalize("NFKD", text or "").encode("ascii", "ignore").decode()
    return "".join(letter for letter in plain if letter.isprintable()).strip()[:4]


def reason(error: ValueError) -> str:
    """Shorten a validation error to its first finding, in one line."""
    if not isinstance(error, ValidationError):
        return str(error)
    first = error.errors()[0]
    where = ".".join(str(part) for part in first["loc"] if isinstance(part, str) and not part.startswith("constrained"))
    message = first["msg"].removeprefix("Value error, ")
    return f"{where} is {first['input']!r}: {message[0].lower()}{message[1:]}" if where else message


def require_few(name: str, count: int) -> None:
    """Refuse a file of too many points before the work of reading them.

    Raises:
        ConfigError: there are more than `MOST_POINTS`.
    """
    if count > MOST_POINTS:
        msg = f"{name}: more than {MOST_POINTS} points; export a shorter route, no NaviCtrl holds more than 254"
        raise ConfigError(msg)


def assemble(name: str, points: list[MissionPoint], title: str = "") -> Mission:
    """Join points to a mission.

    Raises:
        ConfigError: there is none, or a point looks at one that is not a point of interest.
    """
    if not points:
        msg = f"{name}:1: no waypoint in this file; export a route with at least one point"
        raise ConfigError(msg)
    try:
        return Mission(points=tuple(points), name=title)
    except ValidationError as error:
        msg = f"{name}: {reason(error)}; correct the number"
        raise ConfigError(msg) from error
