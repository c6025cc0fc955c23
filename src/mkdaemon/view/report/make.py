"""Makes the report of a recording: reads it, counts, draws, and puts the page together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from mkdaemon.errors import ConfigError, MkError
from mkdaemon.reading import Sort
from mkdaemon.record.summary import summarise
from mkdaemon.view.report import facts, thumbnails
from mkdaemon.view.report.against import chapters_of
from mkdaemon.view.report.flight import FlightReader, RecordedFlight
from mkdaemon.view.report.happenings import refusals
from mkdaemon.view.report.page import Card, Report, plotly_source, render
from mkdaemon.view.report.pieces import Piece, Settled, pieces_of
from mkdaemon.view.report.plots import plots_of
from mkdaemon.view.report.verdict import flown_time, head_of, sentences

Progress = Callable[[int], None]
_NOTHING: Final = "nothing to report: it has no value of a vehicle"


def make_page(path: Path, vehicle: str | None, progress: Progress = lambda position: None) -> bytes:
    """The page of a recording; see `report_of`.

    Raises:
        ConfigError: plotly is not installed, or the recording is not of this vehicle, or of several.
        MkError: the file cannot be opened, or has nothing in it.
    """
    library = plotly_source()
    return render(report_of(path, vehicle, progress), library)


def report_of(
    path: Path, vehicle: str | None, progress: Progress = lambda position: None, against: str | None = None
) -> Report:
    """What the page of a recording shows.

    Args:
        path: the recording, whole or damaged.
        vehicle: whose flight; None where the recording has only one.
        progress: hears how many bytes of the file have been read; it is read twice where it has images.
        against: source of poses that the cameras are compared with; None for no comparison.

    Raises:
        ConfigError: the recording is not of this vehicle, or of several, or has no poses to compare.
        MkError: the file cannot be opened, or has nothing in it.
    """
    reader = FlightReader(has_sights=against is not None)
    summary = summarise(path, progress, reader.taker)
    reader.count(summary)
    flight = _chosen(path, reader, vehicle)
    pieces = pieces_of(flight)
    happenings = sorted(flight.happenings, key=lambda one: one.at)
    chosen, note = thumbnails.choose(flight, happenings), ""
    try:
        pictures = thumbnails.read(path, chosen, progress)
    except ConfigError as error:
        pictures, note = {}, str(error)
    tables = {"Link": facts.link_rows(flight)}
    tables |= {f"Vision: camera {camera}": facts.eyes_rows(flight, camera) for camera in flight.cameras}
    tables |= {
        "Battery": facts.battery_rows(flight),
        "Versions and model": facts.version_rows(flight, summary.session),
    }
    return Report(
        file=path.name,
        vehicle=flight.vehicle,
        head=head_of(flight),
        cards=_cards(flight, pieces),
        sentences=sentences(flight, pieces, facts.seconds_of(summary)),
        losses=facts.losses(summary, flight),
        plots=plots_of(flight, pieces),
        pieces=pieces,
        refusals=refusals(happenings),
        happenings=happenings,
        pictures=pictures,
        picture_note=note,
        tables=tables,
        parameters=facts.parameter_rows(flight),
        configuration=facts.configuration(summary.session),
        chapters=[] if against is None else chapters_of(flight, against, path),
    )


def _chosen(path: Path, reader: FlightReader, vehicle: str | None) -> RecordedFlight:
    """The flight that is wanted.

    Raises:
        ConfigError: there is no such vehicle in the recording, or there are several and none was named.
        MkError: there is none at all.
    """
    flights = {name: flight for name, flight in reader.flights.items() if name}
    if not flights:
        raise MkError(f"{path}: {_NOTHING}; `mkctl log info` shows what it holds, `mkctl log list` shows recordings")
    known = ", ".join(sorted(flights)[:20])
    if vehicle is None and len(flights) > 1:
        raise ConfigError(f"{path}: a recording of several vehicles; choose one with --vehicle: {known}")
    name = next(iter(flights)) if vehicle is None else vehicle
    if name not in flights:
        raise ConfigError(f"{path}: it has no values of vehicle {name}, only of {known}")
    return flights[name]


def _cards(flight: RecordedFlight, pieces: Sequence[Piece]) -> list[Card]:
    """Figures that are seen first."""
    cards = [Card(f"{flown_time(flight):.1f} s", "automatic flight")]
    if (settled := Settled.of(pieces)) is not None:
        cards.append(Card(f"{settled.rms_cm:.1f} cm", f"horizontal RMS error{settled.left_out}"))
        cards.append(Card(f"{settled.worst_cm:.1f} cm", "largest error"))
    count = {sort: sum(one.sort is sort for one in flight.happenings) for sort in Sort}
    cards.append(Card(str(count[Sort.FAILSAFE]), "failsafes", count[Sort.FAILSAFE] > 0))
    cards.append(Card(str(count[Sort.REFUSAL]), "refusals"))
    cards.append(Card(str(count[Sort.WARNING]), "warnings"))
    trips = flight.series.get("link.echo_p95")
    if trips is not None:
        cards.append(Card(f"{max(trips.values):.0f} ms", "largest round trip (p95)"))
    voltage = flight.series.get("battery.voltage")
    if voltage is not None:
        cards.append(Card(f"{min(voltage.values):.1f} V", "lowest battery voltage"))
    return cards
