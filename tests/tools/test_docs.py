from __future__ import annotations

import re
from pathlib import Path

import pytest

from mkdaemon.bus.keys import KEYS
from mkdaemon.cli.program import run
from mkdaemon.protocol.sources import Source
from mkdaemon.protocol.wire import MESSAGES, Board
from mkdaemon.telemetry.control import Phase
from tests.places import CAPTURES, ROOT
from tools import docs
from tools.coverage_table import coverage, shown_releases
from tools.docs import GENERATED, app, make_page, stale_pages

PARTS = ("src", "lab", "tools", "tests")
HOW_TO = (
    *(
        "quickstart",
        "first-flight",
        "first-aircraft",
        "record-and-look",
        "troubles",
        "flying",
        "look",
        "teleop",
        "cameras",
        "settings",
        "waypoints",
    ),
    *("recording", "replay", "security", "operations", "simulator"),
)
"""Pages that tell how something is done."""


def test_generated_pages_are_up_to_date():
    assert stale_pages(ROOT) == []


def test_pages_are_written_and_then_agree(capsys, monkeypatch, tmp_path):
    some = {name: GENERATED[name] for name in ("docs/library-reference.md", "configs/zenoh/daemon-tls.json5")}
    monkeypatch.setattr(docs, "GENERATED", some)
    (tmp_path / "docs").mkdir()
    assert run(app, ["--check", "--root", str(tmp_path)]) == 1
    assert f"not up to date: {', '.join(some)}" in capsys.readouterr().err
    assert run(app, ["--root", str(tmp_path)]) == 0
    assert run(app, ["--check", "--root", str(tmp_path)]) == 0
    page = tmp_path / "docs" / "library-reference.md"
    page.write_text(page.read_text(encoding="utf-8") + "edited", encoding="utf-8")
    assert stale_pages(tmp_path) == ["docs/library-reference.md"]


@pytest.mark.parametrize("page", HOW_TO)
def test_a_how_to_page_shows_a_picture_with_words_for_it(page):
    text = (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8")
    shown = re.findall(r"^!\[(.+)\]\((figures/[^)]+)\)$", text, re.MULTILINE)
    assert shown
    assert all((ROOT / "docs" / picture).stat().st_size > 0 for _, picture in shown)


def test_every_picture_is_shown_on_a_page():
    pages = "".join(page.read_text(encoding="utf-8") for page in (ROOT / "README.md", *(ROOT / "docs").rglob("*.md")))
    assert [file.name for file in (ROOT / "docs" / "figures").iterdir() if f"figures/{file.name})" not in pages] == []


def test_the_picture_of_the_modes_has_every_phase():
    picture = (ROOT / "docs" / "figures" / "phases.svg").read_text(encoding="utf-8")
    assert [phase for phase in Phase if f">{phase.value}<" not in picture] == []


def test_a_tree_without_docs_is_refused(capsys, tmp_path):
    assert run(app, ["--root", str(tmp_path)]) == 1
    assert "has no docs/" in capsys.readouterr().err


def test_the_protocol_page_shows_every_message_field_and_danger():
    page = make_page("docs/protocol.md", ROOT)
    for cls in MESSAGES.values():
        assert f"### {cls.spec.name} (`{cls.spec.id}`" in page
        assert f"/{cls.spec.key}`" in page
        assert cls.spec.danger is None or cls.spec.danger.effect in page
        for slot in cls.spec.slots:
            assert f"`{slot.name}`" in page


def test_the_coverage_table_says_what_each_release_knows():
    fc, nc = table(Board.FC), table(Board.NC)
    assert fc["b", "ExternControl"] == {
        **dict.fromkeys(("0.78", "0.84", "0.90", "2.00"), "v1"),
        "0.71": "v1 S",
        "2.08": "v1 S",
        "2.12": "v2 SR",
        "2.14": "v3 S",
        "2.22": "v3",
    }
    assert (fc["n", "MixerRequest"]["0.71"], fc["N", "Mixer"]["0.71"]) == ("·", "·")
    assert [fc["P", "Receiver"][release] for release in ("0.71", "0.84", "2.12")] == ["071 S", "077", "200 SR"]
    assert fc["V", "Version"]["0.90"] == "classic"
    assert fc["x", "ArmMotors (fork)"]["2.12"] == "1 S"
    assert list(nc["O", "OsdData"].values()) == ["4", "5 SR", "5", "5", "5 S"]
    assert list(nc["O", "OsdTiny"].values()) == ["·"] * 4 + ["10 S"]
    assert nc["w", "WriteWaypoint"]["0.24"] == "024 SR"


def table(board):
    rows = coverage(board, CAPTURES)
    return {(row.letter, row.name): dict(zip(shown_releases(board), row.cells, strict=True)) for row in rows}


def test_tables_are_not_broken_by_bars():
    for line in make_page("docs/protocol.md", ROOT).splitlines():
        if line.startswith("| ") and line.count("|") != line.count("\\|"):
            assert line.endswith(" |")


def test_every_source_of_a_message_is_explained():
    page = (ROOT / "docs" / "firmware-notes.md").read_text(encoding="utf-8")
    assert [source.name for source in Source if f"| {source} |" not in page] == []
    used = {source for cls in MESSAGES.values() for source in cls.spec.sources}
    assert used == set(Source)


def test_citations_name_documents_of_this_repository():
    outside = re.compile(r"WIRE [0-9]|WIRE\.md|firmware\.md")
    texts = {path: path.read_text(encoding="utf-8") for part in PARTS for path in (ROOT / part).rglob("*.py")}
    own = Path(__file__)
    assert [str(path) for path, text in texts.items() if outside.search(text) and path != own] == []


def test_the_keys_page_says_who_publishes_answers_or_reads_each_key():
    page = make_page("docs/keys.md", ROOT)
    for spec in KEYS:
        who = "simulator" if spec.suffix.startswith("sim/") else "daemon"
        if spec.suffix != "client/<holder>":
            assert f"| `{spec.suffix}` | {who} | " in page


def test_the_keys_page_says_where_what_is_required_and_what_every_word_can_be():
    page = make_page("docs/keys.md", ROOT)
    assert "`tcp/127.0.0.1:7447`" in page
    assert "| `action` | `take` \\| `renew` \\| `release` \\| `show` \\| `probe` | required | What to do; " in page
    assert "| `ttl` | float \\| null | default null, >= 0.5, <= 60 |" in page
    for name in re.findall(r"\]\(#([a-z0-9]+)\)", page):
        assert f'<a id="{name}"></a>' in page or name in re.sub(r"\.", "", page.lower()), name
    assert '<a id="linkcondition"></a>LinkCondition | `up`, `degraded`, `one_way`' in page
