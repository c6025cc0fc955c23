"""The page of a report: one HTML file with everything in it, which asks no network for anything.

A recording is untrusted: every text of it is escaped, and a policy in the page lets no script run but the two whose
hashes it names.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib import resources
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from mkdaemon.errors import ConfigError
from mkdaemon.reading import EventLine
from mkdaemon.view.report.against import Chapter
from mkdaemon.view.report.facts import Row
from mkdaemon.view.report.happenings import RefusalCount
from mkdaemon.view.report.pieces import Piece
from mkdaemon.view.report.plots import Plot
from mkdaemon.view.report.verdict import Head

MOST_EVENTS: Final = 500
"""Lines of the table of events."""
MOST_PIECES: Final = 200
"""Lines of the table of manoeuvres."""


class Html(str):
    """A text that is HTML already."""

    __slots__ = ()


@dataclass(frozen=True, slots=True)
class Card:
    """A figure that is seen first.

    Attributes:
        value: of it.
        words: what it is.
        is_bad: whether it deserves a look.
    """

    value: str
    words: str
    is_bad: bool = False


@dataclass(frozen=True, slots=True)
class Report:
    """Everything that the page shows.

    Attributes:
        file: name of the recording.
        vehicle: that flew.
        head: how the flight ended, and why.
        cards: figures that are seen first.
        sentences: the flight in words.
        losses: what the recording lacks.
        plots: tracks first.
        pieces: of the manoeuvres.
        refusals: by token.
        happenings: in order.
        pictures: data URIs by the place of the happening.
        picture_note: why there are no pictures; empty where there are, or nothing to show.
        tables: further figures, by title.
        parameters: title and rows of the active parameter set.
        configuration: of the daemon, as JSON.
        chapters: cameras against a reference, where one was named.
    """

    file: str
    vehicle: str
    head: Head
    cards: Sequence[Card]
    sentences: Sequence[str]
    losses: Sequence[str]
    plots: Sequence[Plot]
    pieces: Sequence[Piece]
    refusals: Sequence[RefusalCount]
    happenings: Sequence[EventLine]
    pictures: Mapping[int, str]
    picture_note: str
    tables: Mapping[str, Sequence[Row]]
    parameters: tuple[str, Sequence[Row]]
    configuration: str
    chapters: Sequence[Chapter] = ()


def plotly_source() -> str:
    """The source of plotly.js, as its package brings it.

    Raises:
        ConfigError: it is not installed.
    """
    # Importing the package takes a second and gives nothing but this file.
    spec = find_spec("plotly")
    folders = [] if spec is None else list(spec.submodule_search_locations or ())
    for folder in folders:
        source = Path(folder) / "package_data" / "plotly.min.js"
        if source.is_file():
            return source.read_text(encoding="utf-8")
    raise ConfigError('a report needs plotly: pip install "mkdaemon[report]"')


def render(report: Report, library: str) -> bytes:
    """The page as UTF-8.

    Args:
        report: what it shows.
        library: source of plotly.js.
    """
    script, style = _asset("page.js"), _asset("page.css")
    hashes = " ".join(f"'sha256-{_hash(text)}'" for text in (script, library))
    policy = f"default-src 'none'; script-src {hashes}; style-src 'unsafe-inline'; img-src data: blob:"
    packed = base64.b64encode(gzip.compress(library.encode(), 4, mtime=0)).decode()
    compared = (plot for chapter in report.chapters for plot in chapter.plots)
    figures = _script_json([plot.as_json() for plot in (*report.plots, *compared)])
    title = escape(f"{report.vehicle}: {report.file}")
    parts = [
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">',
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{title}</title>\n<style>{style}</style></head>\n<body><main>",
        *_body(report),
        "</main>",
        f'<script type="application/json" id="figures">{figures}</script>',
        f'<script type="text/plain" id="library">{packed}</script>',
        f"<script>{script}</script></body></html>\n",
    ]
    # A half of a letter, which JSON can name, is not UTF-8.
    return "\n".join(parts).encode("utf-8", "replace")


def _asset(name: str) -> str:
    return resources.files(__package__ or __name__).joinpath(name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def _script_json(value: object) -> str:
    """JSON in which nothing ends a script or begins a comment."""
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


def _body(report: Report) -> Iterable[str]:
    yield f"<h1>{escape(report.vehicle or 'a recording')}</h1>"
    yield f'<p class="file">{escape(report.file)}</p>'
    yield _head(report.head)
    if report.losses:
        yield _section("The recording is not whole", _list(report.losses), css="warn")
    yield f'<div class="cards">{"".join(map(_card, report.cards))}</div>'
    yield _section("Summary", _list(report.sentences, css="said"), name="words")
    if report.plots or any(chapter.plots for chapter in report.chapters):
        yield '<p class="note" id="plots-note">The plots need JavaScript.</p>'
    tracks = [plot for plot in report.plots if plot.times]
    if tracks:
        yield _section("From above", f'<div class="pair">{"".join(map(_place, tracks))}</div>')
    timed = [plot for plot in report.plots if not plot.times]
    if timed:
        words = (
            '<p class="note screen">Drag to zoom all plots, double click to see everything again; the pointer shows '
            "the same moment everywhere. Shaded blue: every second manoeuvre or stage; red: blind flight, without a "
            "pose.</p>"
        )
        yield _section("Over time", words + "".join(map(_place, timed)))
    for chapter in report.chapters:
        yield _chapter(chapter)
    if report.pieces:
        yield _section("Manoeuvres", _pieces(report.pieces), name="pieces")
    if report.refusals:
        yield _section("Refusals and remedies", _refusals(report.refusals), name="refusals")
    if report.happenings:
        yield _section("Events", _happenings(report), name="events")
    yield from _figures(report)


def _section(title: str, content: str, *, css: str = "", name: str = "") -> str:
    attributes = (f' class="{css}"' if css else "") + (f' id="{name}"' if name else "")
    return f"<section{attributes}><h2>{escape(title)}</h2>{content}</section>"


def _head(head: Head) -> str:
    """The verdict, and the chain of causes; a click on one shows its moment in the plots."""
    rows = [(f"{at:.1f}", text) for at, text in head.chain]
    chain = _table(("since (s)", "why"), rows, [at for at, _ in head.chain]) if rows else ""
    end = f'<p class="{escape(head.tone)}" id="end">At the end: {escape(head.end)}</p>'
    return _section(head.text, end + chain, css="bad" if head.is_bad else "", name="verdict")


def _list(sentences: Iterable[str], css: str = "") -> str:
    return f'<ul class="{css}">' + "".join(f"<li>{escape(one)}</li>" for one in sentences) + "</ul>"


def _card(card: Card) -> str:
    css = "card bad" if card.is_bad else "card"
    return f'<div class="{css}"><b>{escape(card.value)}</b><span>{escape(card.words)}</span></div>'


def _place(plot: Plot) -> str:
    return f'<div class="plot"><h3>{escape(plot.title)}</h3><div id="plot-{escape(plot.name)}"></div></div>'


def _table(head: Sequence[str], rows: Iterable[Sequence[str]], times: Sequence[float] = (), numbers: int = 0) -> str:
    """A table; its last `numbers` columns are numbers. Rows with a time show it in the plots."""
    texts = len(head) - numbers
    cells = (f"<th{_right(place >= texts)}>{escape(word)}</th>" for place, word in enumerate(head))
    lines = [f"<tr>{''.join(cells)}</tr>"]
    for index, row in enumerate(rows):
        at = f' data-at="{times[index]:.3f}"' if times else ""
        shown_cells = (
            f"<td{_right(place >= texts)}>{cell if isinstance(cell, Html) else escape(cell)}</td>"
            for place, cell in enumerate(row)
        )
        lines.append(f"<tr{at}>{''.join(shown_cells)}</tr>")
    return f'<div class="scroll"><table>{"".join(lines)}</table></div>'


def _right(is_number: bool) -> str:
    return ' class="n"' if is_number else ""


def _pieces(pieces: Sequence[Piece]) -> str:
    head = ("manoeuvre", "goal (m)", "from (s)", "for (s)", "there after (s)", "blind (s)")
    errors = ("level, RMS / max (cm)", "height, RMS / max (cm)", "level at its end (cm)")
    rows = []
    for piece in pieces[:MOST_PIECES]:
        goal = "" if piece.goal is None else ", ".join(f"{part:.2f}" for part in piece.goal)
        found, level, height = piece.errors, "-", "-"
        if found is not None:
            level = f"{found.level_rms_cm:.1f} / {found.level_max_cm:.1f}"
            height = f"{found.height_rms_cm:.1f} / {found.height_max_cm:.1f}"
        times = (f"{piece.begin:.1f}", f"{piece.end - piece.begin:.1f}", _number(piece.reached))
        blind = f"{piece.blind:.1f}" if piece.blind else "-"
        rows.append((piece.name, goal, *times, blind, level, height, _number(piece.level_end_cm)))
    note = (
        '<p class="note">Errors are the distance between estimate and goal. For a manoeuvre that flies to a position, '
        "they count from its arrival, otherwise from 2 s after its start; for a stage, from its start. "
        "Blind flight is excluded, because an estimate without images has no error.</p>"
    )
    more = _more(len(pieces) - MOST_PIECES, "manoeuvres")
    return _table((*head, *errors), rows, [piece.begin for piece in pieces[:MOST_PIECES]], numbers=8) + more + note


def _chapter(chapter: Chapter) -> str:
    """A camera against a reference."""
    parts = [_list(chapter.sentences, css="said")]
    parts += [f'<div class="pair">{"".join(map(_place, chapter.plots))}</div>'] if chapter.plots else []
    for sheet in chapter.sheets:
        table = _table(sheet.head, sheet.rows, numbers=len(sheet.head) - 1)
        parts.append(f"<h3>{escape(sheet.title)}</h3>{table}")
    css = "" if chapter.is_answered else "warn"
    return _section(
        f"{chapter.camera} against {chapter.reference}", f'<div class="against">{"".join(parts)}</div>', css=css
    )


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"


def _more(left: int, what: str) -> str:
    return f'<p class="note">... and {left} more {what}.</p>' if left > 0 else ""


def _refusals(refusals: Sequence[RefusalCount]) -> str:
    rows = [(one.token or "-", one.text, one.fix, str(one.count), f"{one.first:.1f}") for one in refusals[:100]]
    head = ("token", "first of them", "remedy", "times", "first at (s)")
    return _table(head, rows, [one.first for one in refusals[:100]], numbers=2) + _more(len(refusals) - 100, "tokens")


def _happenings(report: Report) -> str:
    listed = report.happenings[:MOST_EVENTS]
    rows = []
    for place, one in enumerate(listed):
        sort = Html(f'<span class="sort {escape(one.sort.value)}">{escape(one.sort.value)}</span>')
        fix = f'<div class="fix">{escape(one.fix)}</div>' if one.fix else ""
        picture = report.pictures.get(place)
        image = Html(f'<img alt="what the camera saw" src="{escape(picture)}">') if picture else Html("")
        token = f" [{one.token}]" if one.token else ""
        rows.append((f"{one.at:.2f}", sort, Html(escape(one.text + token) + fix), image))
    note = f'<p class="note">{escape(report.picture_note)}</p>' if report.picture_note else ""
    more = _more(len(report.happenings) - MOST_EVENTS, "events; `mkctl log export` has them all")
    return _table(("at (s)", "what", "", "camera"), rows, [one.at for one in listed]) + more + note


def _figures(report: Report) -> Iterable[str]:
    for title, rows in report.tables.items():
        if rows:
            yield _section(title, _table(("", ""), rows))
    name, parameters = report.parameters
    if parameters:
        title = f"Parameter set {name}: {len(parameters)} parameters"
        yield _section("Parameter set in flight", _details(title, f'<div class="columns">{_columns(parameters)}</div>'))
    if report.configuration:
        yield _section("Configuration", _details("as the daemon had it", f"<pre>{escape(report.configuration)}</pre>"))


def _details(title: str, content: str) -> str:
    return f"<details><summary>{escape(title)}</summary>{content}</details>"


def _columns(rows: Iterable[Row]) -> str:
    return "".join(f"<div><span>{escape(name)}</span>{escape(value)}</div>" for name, value in rows)
